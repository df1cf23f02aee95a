"""Modulo scheduling: the time of each step of a microprogram, and the registers of its values.

A new Gaussian enters every `interval` cycles and several are in flight, so a step that runs at
time t of its own Gaussian occupies its unit in phase t mod interval of every round. Steps do not
depend on other Gaussians. Placing them one after the other, each as late as its readers allow and
its unit is free, always succeeds with the smallest interval that the number of units permits. Late
steps keep few values alive: sums have more inputs than outputs.

A unit outputs a value for one cycle. If it is read later it waits in a register of that unit's
bank, loaded in the same phase of every round; a value that waits longer than a round moves on to a
second register. Values whose waiting times do not overlap share the registers of a bank.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

from splatcore.spec.colour import BASIS, TERMS
from splatcore.spec.config import Config
from splatcore.spec.memory import COMPACT_DEGREE
from splatcore.spec.microprogram import Program, Step, projection

LATENCY_OF_CHOICE = 1
"""Clock cycles of clamp and maximum."""

LATENCY_OF_COMPENSATION = {"product": 3, "minor": 4, "log": 1, "log_sum": 2, "fade": 2}
"""Clock cycles of the units of `spec.compensation`."""


@dataclass(frozen=True)
class Place:
    """A step at time `time` on unit number `number` of its kind."""

    step: Step
    time: int
    number: int


@dataclass(frozen=True)
class Wait:
    """A register that holds a value: loaded at time `begin`, last read at time `end`."""

    value: str
    begin: int
    end: int
    bank: tuple[str, int]  # unit and number
    register: int


@dataclass(frozen=True)
class Schedule:
    """A program's schedule."""

    interval: int  # cycles from one item to the next
    places: tuple[Place, ...]  # all steps, in the order of their times
    waits: tuple[Wait, ...]  # all waiting values
    latencies: tuple[tuple[str, int], ...]  # unit → clock cycles
    length: int
    """Cycles from the first step's start until the last outputs are read."""
    early: tuple[tuple[str, int], ...]  # output → cycles from its read to `length`

    def read_time(self, output: str) -> int:
        """Return the time at which an output is read."""
        return self.length - dict(self.early).get(output, 0)

    @property
    def registers(self) -> int:
        """Registers of all banks together."""
        return len({(wait.bank, wait.register) for wait in self.waits})

    def first_round(self, names: tuple[str, ...]) -> int:
        """Return the round in which the first of these values is read."""
        times = [p.time for p in self.places if set(names) & set(p.step.operands)]
        return min(times, default=self.length) // self.interval

    def utilisation(self, units: int) -> float:
        """Return the share of the PEs' cycles in which a step begins."""
        return sum(place.step.unit == "pe" for place in self.places) / (units * self.interval)


def latencies(config: Config) -> dict[str, int]:
    """Return the clock cycles of each unit."""
    found = {"pe": config.multiply_latency + config.add_latency}
    found |= dict.fromkeys(("reciprocal", "rsqrt"), config.unary_latency)
    found |= dict.fromkeys(("clamp", "maximum"), LATENCY_OF_CHOICE)
    return found | LATENCY_OF_COMPENSATION


OF_POINTS = ("cull", "cull_interval", "place")
"""Programs of points before the projection."""


def basis_machine(config: Config) -> Config:
    """Return the machine of the array that evaluates the colours' polynomials.

    Its numbers are `BASIS`, for which pipelines are shorter, except an FPGA's tables and multiplier
    blocks.
    """
    unary = config.unary_latency if config.logic == "fpga" else 2
    return replace(config, arithmetic=BASIS, multiply_latency=1, add_latency=3, unary_latency=unary)


PACE_MIN = 4
"""Minimum cycles per Gaussian for which units are multiplied."""

POINT_CYCLES = 4
"""Minimum cycles per point of `OF_POINTS`; one fewer if a Gaussian takes `PACE_MIN`."""

COMPENSATING = ("product", "log_sum")
"""Units of which a machine has as many as keep up with its PEs."""


def pace(config: Config, program: Program) -> int:
    """Return the cycles per item of a program's PEs, at least `PACE_MIN`."""
    steps = sum(step.unit == "pe" for step in program.steps)
    return max(-(-steps // pes(config, program)), PACE_MIN)


def point_cycles(config: Config) -> int:
    """Return the minimum cycles per point of `OF_POINTS`."""
    return POINT_CYCLES - (pace(config, projection(config)) == PACE_MIN)


def colour_turns(config: Config) -> list[list[int]]:
    """Return the terms that are summed in each cycle of a Gaussian outside the array, as indices of
    `TERMS`: one per cycle, or two if the projection's PEs are faster than that.

    The base is added to the first term.
    """
    terms = [k for k, term in enumerate(TERMS) if term.degree <= config.sh_degree]
    two = len(terms) > pace(config, projection(config))
    turns: list[list[int]] = []
    for k in terms:
        if two and TERMS[k].follower:
            turns[-1].append(k)
        else:
            turns.append([k])
    return turns


def colour_terms(config: Config) -> int:
    """Return the cycles of a Gaussian's sum of colours outside the array."""
    return max(len(colour_turns(config)), 2) if config.sh_degree else 1  # two terms are G's


def colour_cycles(config: Config) -> int:
    """Return the cycles per colour: its sum, or one per codebook stage."""
    degree = min(config.sh_degree, COMPACT_DEGREE)
    entries = len(config.colour_index[degree]) + len(config.sh_index[degree])
    return max(colour_terms(config), entries)


def pes(config: Config, program: Program) -> int:
    """Return the PEs of a program's array.

    `Config` sets those of the projection, with which polynomials keep up.
    """
    steps = sum(step.unit == "pe" for step in program.steps)
    if program.name.startswith("basis"):
        return -(-steps // schedule(config, projection(config)).interval)
    if program.name == "place":
        return -(-steps // point_cycles(config))
    return 1 if program.name in ("chunk", "level", *OF_POINTS) else config.pes * config.pe_arrays


def units_of(config: Config, program: Program) -> dict[str, int]:
    """Return the number of units of each kind on a machine's array for a program."""
    demand = Counter(step.unit for step in program.steps)
    found = dict.fromkeys(latencies(config), 1) | {"pe": pes(config, program)}
    for unit in COMPENSATING:
        found[unit] = max(-(-demand[unit] // pace(config, program)), 1)
    return found


@cache
def schedule(config: Config, program: Program) -> Schedule:
    """Return the schedule of a program on a machine's array for it."""
    units, demand = units_of(config, program), Counter(step.unit for step in program.steps)
    interval = max(-(-demand[unit] // units[unit]) for unit in units)
    if program.name in OF_POINTS:
        interval = max(interval, point_cycles(config))
    if config.colours == "beside" and program.name == projection(config).name:
        interval = max(interval, colour_cycles(config))
    if program.name.startswith("basis"):  # in step with the projection
        interval = max(interval, schedule(config, projection(config)).interval)
    latency, early = latencies(config), early_outputs(config, program)
    places = place_steps(program.steps, units, latency, interval, early)
    length = max(p.time + latency[p.step.unit] + early.get(p.step.name, 0) for p in places)
    read = {name: length - early.get(name, 0) for name in program.outputs}
    waits = place_waits(places, latency, interval, read)
    return Schedule(interval, places, waits, tuple(latency.items()), length, tuple(early.items()))


def early_outputs(config: Config, program: Program) -> dict[str, int]:
    """Return the outputs that are read before the last ones, and by how many cycles.

    These are the polynomials: those of one turn (`colour_turns`) are read per cycle.
    """
    if not program.name.startswith("basis"):
        return {}
    turns = colour_turns(config)
    return {
        name: len(turns) - 1 - turn
        for turn, terms in enumerate(turns)
        for k in terms
        for name in TERMS[k].polynomials
    }


def readers(steps: tuple[Step, ...]) -> dict[str, list[str]]:
    """Return the names of the steps that read each value."""
    found: dict[str, list[str]] = {}
    for step in steps:
        for operand in set(step.operands):
            found.setdefault(operand, []).append(step.name)
    return found


def place_steps(
    steps: tuple[Step, ...],
    units: dict[str, int],
    latency: dict[str, int],
    interval: int,
    early: Mapping[str, int],
) -> tuple[Place, ...]:
    """Place all steps on units; the earliest begins at time 0.

    units: unit → number of units
    latency: unit → clock cycles
    interval: cycles from one item to the next
    early: output → cycles by which it must be ready before the last
    """
    reading = readers(steps)
    time: dict[str, int] = {}  # counted backwards from the end
    number: dict[str, int] = {}
    busy: dict[tuple[str, int], int] = {}  # (unit, phase) → units taken
    depth = depths(steps, latency)
    waiting = list(reversed(steps))
    while waiting:
        # Of the steps whose readers are all placed, take the one with the longest path before it.
        ready = [step for step in waiting if all(r in time for r in reading.get(step.name, []))]
        step = max(ready, key=lambda step: depth[step.name])
        waiting.remove(step)
        latest = min((time[r] for r in reading.get(step.name, [])), default=0)
        latest = min(latest, -early.get(step.name, 0))
        latest -= latency[step.unit]
        while busy.get((step.unit, latest % interval), 0) == units[step.unit]:
            latest -= 1
        key = (step.unit, latest % interval)
        number[step.name] = busy.get(key, 0)
        busy[key] = number[step.name] + 1
        time[step.name] = latest
    first = min(time.values())
    placed = [Place(step, time[step.name] - first, number[step.name]) for step in steps]
    return tuple(sorted(placed, key=lambda place: (place.time, place.number)))


def depths(steps: tuple[Step, ...], latency: dict[str, int]) -> dict[str, int]:
    """Return the cycles from the inputs to the end of each step, with unlimited units."""
    depth: dict[str, int] = {}
    for step in steps:
        begin = max((depth.get(operand, 0) for operand in step.operands), default=0)
        depth[step.name] = begin + latency[step.unit]
    return depth


def place_waits(
    places: tuple[Place, ...], latency: dict[str, int], interval: int, outputs: dict[str, int]
) -> tuple[Wait, ...]:
    """Return the registers of all values that are read after the cycle in which they appear.

    outputs: output → time at which it is read
    """
    at = {place.step.name: place for place in places}
    reading = readers(tuple(place.step for place in places))
    waits: list[Wait] = []
    taken: dict[tuple[tuple[str, int], int], set[int]] = {}  # (bank, register) → phases
    for place in places:
        appears = place.time + latency[place.step.unit]
        last = max((at[r].time for r in reading.get(place.step.name, [])), default=appears)
        last = max(last, outputs.get(place.step.name, last))
        bank = (place.step.unit, place.number)
        for begin in range(appears, last, interval):
            end = min(last, begin + interval)
            phases = {t % interval for t in range(begin + 1, end + 1)}
            register = 0
            while taken.get((bank, register), set()) & phases:
                register += 1
            taken.setdefault((bank, register), set()).update(phases)
            waits.append(Wait(place.step.name, begin, end, bank, register))
    return tuple(waits)
