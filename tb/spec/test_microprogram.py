"""Microprograms and their schedules, run by a machine that moves names instead of numbers.

Catches operands that are not available in their cycle, units used twice and misspelt fields.
"""

from dataclasses import replace
from itertools import product

import pytest

from splatcore.spec.config import DEFAULT
from splatcore.spec.microprogram import Step, operation_counts, parse, program, projection
from splatcore.spec.programs import CONSTANTS, CORNERS, TEXTS
from splatcore.spec.schedule import Schedule, latencies, pes, schedule, units_of

# The array makes colours of degree 1, on PAPER's PEs.
SHADED = replace(DEFAULT, colours="array", sh_degree=1, pes=6, antialiasing=False)
NINE = replace(DEFAULT, pes=9)

CONFIGS = {
    "one array": NINE,
    "two arrays": replace(DEFAULT, pes=6, pe_arrays=2),
    "four cycles": DEFAULT,
    "slow units": replace(NINE, multiply_latency=4, add_latency=5, unary_latency=9),
    "quick units": replace(NINE, multiply_latency=0, add_latency=1, unary_latency=1),
    "three PEs": replace(DEFAULT, pes=3),
    "3σ square": replace(NINE, tile_test="3sigma"),
    "one array, shaded": SHADED,
    "two arrays, shaded": replace(SHADED, pe_arrays=2),
    "3σ square, shaded": replace(SHADED, tile_test="3sigma"),
}
CYCLES = {
    "one array": 6, "two arrays": 5, "four cycles": 4, "slow units": 6, "quick units": 6,
    "three PEs": 18, "3σ square": 7, "one array, shaded": 11, "two arrays, shaded": 6,
    "3σ square, shaded": 12,
}  # fmt: skip
"""Cycles per Gaussian; the bounds are 12 with one array and 7 with two."""


def test_lines():
    steps = parse("a = x * y  # product\nb = a * z + x\nc = b - a * y\nd = c + z\ne = rsqrt(d)")
    assert steps == (
        Step("a", "pe", "x", "y"),
        Step("b", "pe", "a", "z", "x"),
        Step("c", "pe", "a", "y", "b", negate=True),
        Step("d", "pe", "c", None, "z"),
        Step("e", "rsqrt", "d"),
    )
    assert parse("\n".join(map(str, steps))) == steps
    assert operation_counts(steps) == {"multiply": 3, "add": 3, "rsqrt": 1}


def test_sums_of_products():
    """A sum of products is one step for each, as if they were written one by one."""
    one_by_one = "s0 = a * b\ns1 = c * d + s0\ns = s1 - e * f\nt0 = a * s\nt = t0 - b * s"
    assert parse("s = a * b + c * d - e * f\nt = a * s - b * s") == parse(one_by_one)


@pytest.mark.parametrize(
    "line",
    [
        "a = x / y",
        "a = x * y\na = x * z",
        "a x * y",
        "a = cube(x)",
        "a = rsqrt(x, y, z)",
        "a0 = x * y\na = x * y + y * z",
        "a = x * y + y * z + x",
        "a = x - x * y + y * z",
    ],
)
def test_invalid_line_is_quoted(line):
    with pytest.raises(ValueError, match=r"microprogram line \d: '"):
        parse(line)


INPUTS = {
    "chunk": " ".join((*CORNERS, "chunk_reach", "reach_y")),
    "level": "ray_x ray_y ray_z inward around wide",
    "cull": "ray_x ray_y ray_z",
    "cull_interval": "ray_x ray_y ray_z chunk_reach",
    "place": "ray_x ray_y ray_z z margin_x margin_y",
    "project": "x y z l00 l10 l11 l20 l21 l22 attenuation",
}
INPUTS["square"] = INPUTS["project"]  # fields of the programs: a misspelt operand would add one
INPUTS["project_flat"] = INPUTS["project"] + " colour_red colour_green colour_blue"
INPUTS |= dict.fromkeys(("basis1", "basis2", "basis3"), INPUTS["cull"])


@pytest.mark.parametrize("name", TEXTS)
def test_values_are_made_once_and_before_their_use(name):
    made = set()
    for step in program(name).steps:
        assert step.name not in made | set(CONSTANTS)
        assert not (set(step.operands) & program(name).made) - made
        made.add(step.name)
    assert set(program(name).outputs) <= made | set(program(name).fields)
    if name in INPUTS:
        assert sorted(program(name).fields) == sorted(INPUTS[name].split())


def test_operations_with_and_without_zeros():
    """Skipping zeros saves 22 multiplications and 14 additions, and loses no value."""
    saved = {}
    for degree, tile_test in product((0, 1), ("exact", "3sigma")):
        config = replace(SHADED, sh_degree=degree, tile_test=tile_test)
        sparse, dense = projection(config), projection(replace(config, skip_zeros=False))
        assert sparse.made < dense.made and sparse.outputs == dense.outputs
        less, more = (operation_counts(program.steps) for program in (sparse, dense))
        saved[degree, tile_test] = {kind: more[kind] - less[kind] for kind in more}
    assert all(
        save == {"multiply": 22, "add": 14} | dict.fromkeys(save.keys() - {"multiply", "add"}, 0)
        for save in saved.values()
    )


def test_every_constant_is_used():
    used = {constant for name in TEXTS for constant in program(name).constants}
    assert set(CONSTANTS) == used


@pytest.mark.parametrize("program_name", TEXTS)
@pytest.mark.parametrize("name", CONFIGS)
def test_units_are_never_taken_twice(name, program_name):
    config, steps = CONFIGS[name], program(program_name)
    plan = schedule(config, steps)
    assert {place.step for place in plan.places} == set(steps.steps)
    slots = [(p.step.unit, p.number, p.time % plan.interval) for p in plan.places]
    assert len(set(slots)) == len(slots)
    units = units_of(config, steps)
    assert all(p.number < units[p.step.unit] for p in plan.places)
    assert min(p.time for p in plan.places) == 0


@pytest.mark.parametrize("name", CONFIGS)
def test_cycles_per_gaussian(name):
    config = CONFIGS[name]
    steps = projection(config)
    plan = schedule(config, steps)
    assert plan.interval == CYCLES[name]
    assert plan.utilisation(pes(config, steps)) > 0.516  # the paper's
    assert schedule(config, program("cull")).interval == (3 if plan.interval == 4 else 4)


def run_names(plan: Schedule, outputs, latency: dict[str, int], gaussians: int) -> set:
    """Run the schedule cycle by cycle on (Gaussian, value) pairs, and check every step's operands.

    A register loads in the cycle in which its wait begins and can be read from the next one on.
    Returns the pairs computed.
    """
    results: dict[tuple[str, int], dict[int, tuple[int, str]]] = {}  # unit → cycle → value
    registers: dict = {}
    done = set()
    reads = 0
    made = {place.step.name for place in plan.places}
    for cycle in range(gaussians * plan.interval + plan.length):
        takeover = {}
        for output in made & set(outputs):
            gaussian, phase = divmod(cycle - plan.read_time(output), plan.interval)
            if not phase and 0 <= gaussian < gaussians:
                assert (gaussian, output) in visible(plan, output, cycle, results, registers)
        for place in plan.places:
            gaussian, phase = divmod(cycle - place.time, plan.interval)
            if phase or not 0 <= gaussian < gaussians:
                continue
            for operand in place.step.operands:
                if operand in made:
                    assert (gaussian, operand) in visible(plan, operand, cycle, results, registers)
                    reads += 1
            unit = (place.step.unit, place.number)
            results.setdefault(unit, {})[cycle + latency[place.step.unit]] = (
                gaussian, place.step.name,
            )  # fmt: skip
            done.add((gaussian, place.step.name))
        for wait in plan.waits:
            gaussian, phase = divmod(cycle - wait.begin, plan.interval)
            if phase or not 0 <= gaussian < gaussians:
                continue
            source = visible(plan, wait.value, cycle, results, registers)
            assert (gaussian, wait.value) in source
            takeover[wait.bank, wait.register] = (gaussian, wait.value)
        registers.update(takeover)
    return done


def visible(plan, value, cycle, results, registers) -> set:
    """Return the pairs readable from a value's unit in a cycle: its result and its registers."""
    place = next(p for p in plan.places if p.step.name == value)
    unit = (place.step.unit, place.number)
    seen = {held for (bank, _), held in registers.items() if bank == unit}
    return seen | {results.get(unit, {}).get(cycle)}


@pytest.mark.parametrize("program_name", TEXTS)
@pytest.mark.parametrize("name", CONFIGS)
def test_every_step_finds_its_operands(name, program_name):
    config, steps = CONFIGS[name], program(program_name)
    plan = schedule(config, steps)
    done = run_names(plan, steps.outputs, latencies(config), 12)
    assert len(done) == 12 * len(plan.places)


def test_missing_wait_is_detected():
    steps = projection(DEFAULT)
    plan, outputs = schedule(DEFAULT, steps), steps.outputs
    for k in range(0, len(plan.waits), 7):
        broken = replace(plan, waits=plan.waits[:k] + plan.waits[k + 1 :])
        with pytest.raises(AssertionError):
            run_names(broken, outputs, latencies(DEFAULT), 12)
