"""Mutation: faults planted in a component's Verilog, to see whether its tests would notice.

All faults (`sim.planted.faults`) go into one text and one build; each is asleep until the
simulation is started with its number, `+mutant=17`. Number 0 is the component as it is.
"""

import random
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from amaranth.back import verilog
from amaranth.lib import wiring

from splatcore.sim.planted.faults import KINDS, Fault
from splatcore.sim.planted.faults import faults as possible_faults
from splatcore.sim.planted.netlist import ASSIGN, IF, STATEMENT, Expression, Module, Place
from splatcore.sim.rtl.streams import IDLE_MAX, Result, Rows, Simulation

PACKAGE = "package mutation;\n  int selected = 0;\nendpackage\n"
"""What all modules see: the number of the fault that is awake."""

SELECT = (
    '  initial if ($value$plusargs("mutant=%d", mutation::selected) == 0) mutation::selected = 0;'
)

PATIENCE = 4
"""How many times the cycles of the clean run a mutant is given."""

PROCESSES = 2
"""Mutants that run at the same time."""


class Mutant(NamedTuple):
    """One fault. module: in Verilog, "top.queue"; lines: of Verilog, before and after."""

    number: int
    module: str
    kind: str
    line_before: str
    line_after: str

    def __str__(self):
        return f"{self.number} {self.module}, {self.kind}: {self.line_before} → {self.line_after}"


@dataclass(frozen=True)
class Trial:
    """A mutant and what became of it; reason: how it was caught, or that it was not."""

    mutant: Mutant
    caught: bool
    reason: str


def mutants(source: str, count: int, seed: int) -> tuple[str, list[Mutant]]:
    """Verilog with `count` faults in it (fewer if there are no more places), and which they are.

    The faults are drawn from all possible ones, evenly over the kinds and in a kind evenly over
    the modules, and numbered from 1 as they stand in the text. The first module is the top.
    """
    rng = random.Random(seed)
    lines = source.splitlines()
    groups = defaultdict(lambda: defaultdict(list))  # by kind, by module
    for module, place, faults in possible_faults(lines, rng):
        for fault in faults:
            groups[fault.kind][module.name].append((module, place, fault))
    drawn = sorted(_draw(groups, count, rng), key=lambda one: (one[1].line, one[2]))
    listed, by_line = [], defaultdict(list)
    for number, (module, place, fault) in enumerate(drawn, 1):
        before, after = lines[place.line], _replaced(lines[place.line], fault.value)
        shown = [" ".join(line.split()) for line in (before, after)]
        listed.append(Mutant(number, module.name, fault.kind, *shown))
        by_line[place.line].append((number, module, place, fault))
    for line, faults in by_line.items():
        lines[line] = _switched(lines[line], faults)
    top = next(k for k, line in enumerate(lines) if line.startswith("module "))
    lines[top] += "\n" + SELECT
    return PACKAGE + "\n".join(lines) + "\n", listed


def run_mutants(
    component: wiring.Component,
    inputs: Rows,
    *,
    count: int,
    seed: int = 0,
    outputs: Rows | None = None,
    samples: Iterable[str] = (),
    ports: Iterable[str] = (),
    timing: bool = False,
    **options,
) -> list[Trial]:
    """Plant `count` faults in a component, run each as `Simulation.run` does, say which show.

    A mutant is caught if an out stream gives other rows than the clean component, too few or too
    many, if one of the `samples` is another in any cycle or one of the `ports` at the end, if the
    stream rule or an assertion breaks, or if it is not done in `PATIENCE` times the cycles; with
    `timing` also if the last row comes earlier or later. A component without streams gets its
    inputs cycle by cycle, as arrays in `constants`, and is watched by `samples`.

    outputs: what the clean component must give, as its tests know. options: constants, stall and
    so on. AssertionError if the clean component gives something else, or if the one with all
    faults asleep, mutant 0, differs from it in anything.
    """
    source = verilog.convert(component, name="top", emit_src=False)
    mutated, listed = mutants(source, count, seed)
    original = Simulation(component, samples, source)
    options = {"seed": seed, **options}
    counted = original.run(inputs, **options).outputs
    options["expected"] = {name: len(rows) for name, rows in counted.items()}
    clean = original.run(inputs, **options)
    right = replace(clean, outputs=clean.outputs | (outputs or {}))
    _check("the clean component", clean, right)
    asleep = Simulation(component, samples, mutated)
    _check("with all faults asleep", asleep.run(inputs, **options), right)
    total = max([right.cycles, *map(len, right.samples.values())])
    options["cycles_max"] = PATIENCE * total + options.get("idle_max", IDLE_MAX)

    def tried(mutant: Mutant) -> Trial:
        try:
            found = asleep.run(inputs, mutant=mutant.number, **options)
        except AssertionError as error:
            return Trial(mutant, True, str(error))
        reason = _difference(found, right, ports, timing)
        return Trial(mutant, bool(reason), reason or "nothing differs")

    with ThreadPoolExecutor(PROCESSES) as pool:
        return list(pool.map(tried, listed))


def by_kind(trials: Iterable[Trial]) -> list[tuple[str, int, int]]:
    """(kind, caught, all) for each kind that occurs, for a table."""
    everything = Counter(trial.mutant.kind for trial in trials)
    caught = Counter(trial.mutant.kind for trial in trials if trial.caught)
    return [(kind, caught[kind], everything[kind]) for kind in KINDS if everything[kind]]


def _check(what: str, found: Result, right: Result) -> None:
    """AssertionError unless two runs are the same in everything."""
    wrong = _difference(found, right, right.ports, timing=True)
    if wrong:
        raise AssertionError(f"{what}: {wrong}")


def _difference(found: Result, right: Result, ports: Iterable[str], timing: bool) -> str:
    """In what a run differs from the right one; empty if in nothing."""
    if not found.finished:
        return found.stopped
    for name, rows in right.outputs.items():
        given = found.outputs[name]
        both = min(len(rows), len(given))
        wrong = (rows[:both] != given[:both]).any(axis=1)
        if wrong.any():
            return f"{name}: row {wrong.argmax()} differs"
        if len(given) != len(rows):
            return f"{name}: {len(given)} rows instead of {len(rows)}"
    for name, values in right.samples.items():
        both = min(len(values), len(found.samples[name]))
        wrong = values[:both] != found.samples[name][:both]
        if wrong.any():
            return f"{name} differs in cycle {np.argwhere(wrong)[0, 0]}"
    for name in ports:
        if found.ports[name] != right.ports[name]:
            return f"{name} ends as {found.ports[name]} instead of {right.ports[name]}"
    if timing and found.cycles != right.cycles:
        return f"{found.cycles} cycles instead of {right.cycles}"
    return ""


def _draw(groups: Mapping, count: int, rng: random.Random) -> list[tuple[Module, Place, Fault]]:
    """`count` faults: the kinds take turns, and in each kind the modules."""
    queues = {}
    for kind in sorted(groups):
        turns = list(groups[kind].values())
        rng.shuffle(turns)
        for group in turns:
            rng.shuffle(group)
        rounds = range(max(map(len, turns)))
        queues[kind] = [group[k] for k in rounds for group in turns if k < len(group)]
    rounds = range(max(map(len, queues.values()), default=0))
    return [queue[k] for k in rounds for queue in queues.values() if k < len(queue)][:count]


def _replaced(line: str, value: str) -> str:
    """A line with another value or condition."""
    match = ASSIGN.fullmatch(line) or STATEMENT.fullmatch(line) or IF.fullmatch(line)
    start, end = match.span("value")
    return line[:start] + value + line[end:]


def _switched(line: str, faults: list[tuple[int, Module, Place, Fault]]) -> str:
    """A line that is right unless one of its faults is awake.

    The values are kept apart, in wires or statements of their own: within one expression they
    would give each other their width and sign.
    """
    _, module, place, _ = faults[0]
    awake = [f"mutation::selected == {number}" for number, *_ in faults]
    values = [fault.value for *_, fault in faults]
    if ASSIGN.fullmatch(line):
        wire = f"  wire [{Expression(module, place.target).width() - 1}:0] mutation_"
        text = [f"{wire}right_{place.line} = {place.value};"]
        choice = f"mutation_right_{place.line}"
        for (number, *_), when, value in zip(faults, awake, values, strict=True):
            text.append(f"{wire}wrong_{number} = {value};")
            choice = f"({when}) ? mutation_wrong_{number} : {choice}"
        return "\n".join([*text, _replaced(line, choice)])
    if STATEMENT.fullmatch(line):
        ways = [
            f"if ({when}) {_replaced(line, value).strip()} else"
            for when, value in zip(awake, values, strict=True)
        ]
        return " ".join(["begin", *ways, line.strip(), "end"])
    choice = f"({place.value})"
    for when, value in zip(awake, values, strict=True):
        choice = f"({when}) ? {value} : {choice}"
    return _replaced(line, choice)
