"""Kinds of faults, drawn at random on several machines, and the check of their outcome."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.sim.soak.fault_runs import (
    SPOILT,
    A,
    B,
    Fault,
    Outcome,
    golden,
    job,
    run_fault,
    timetable,
    values_of,
)
from splatcore.sim.soak.machines import MACHINES
from splatcore.spec import registers
from splatcore.spec.axi import ID_BITS, PREPROCESSING, READERS, RENDERING, WRITERS
from splatcore.spec.colour import EXPONENT_MAX
from splatcore.spec.config import Config
from splatcore.spec.memory import MAGIC, PLACED, VERSIONS
from splatcore.spec.registers import ErrorCode, addresses, frame_registers
from splatcore.spec.work import STRIDE_ALIGNMENT, WORK_ALIGNMENT, stride

KINDS = (
    "read", "write", "stray", "missing", "hand over", "reset", "abort", "start", "locked",
    "pages", "features", "size", "alignment", "range", "parts",
    "magic", "version", "format", "degree",
)  # fmt: skip
"""Kinds of faults."""

PAIR_KINDS = (*KINDS, "both")
"""Kinds of faults with two frames in flight. both: B's model is invalid, and a read fails."""

CHOSEN = ("tiny", "default", "4 rasterizers", "group 4", "2 sub-sorters")

WAYS = [(kind, False) for kind in KINDS] + [(kind, True) for kind in PAIR_KINDS]
WAYS += [("levels", False), ("levels", True)]
"""(kind of fault, whether another frame is in flight). levels: on a machine that has them."""

AROUND = {"abort": range(-20, 8), "read": range(-16, 8), "write": range(-8, 4)}
"""Offsets from B's hand-over: cycle at which ABORT is sent, read beat or write burst that fails."""

SOON = 40  # read beats after B's start in which A is still in flight

CLIENTS = {ErrorCode.READ: READERS, ErrorCode.WRITE: WRITERS}

Below = Callable[[int], int]
"""n → a random number in 0 … n − 1."""


def drawn(config: Config, kind: str, seed: int, pair: bool) -> Fault:
    """Draw a random fault of a kind, for `run_fault` with the same seed."""
    generator = np.random.default_rng([seed, len(kind)])

    def below(n: int) -> int:
        return int(generator.integers(n))

    if kind == "both":
        other = drawn_header(config, ("magic", "version", "degree")[below(3)], below)
        beat = timetable(config, seed, pair).first[0] + below(SOON)
        return replace(other, detail=None, timing={"read_errors": (beat,)}, twice=True)
    if kind == "hand over":
        found = hand_over(config, seed, pair)
        return found[below(len(found))]
    if kind in ("read", "write", "stray", "missing"):
        return drawn_answer(config, kind, seed, pair, below)
    if kind in ("reset", "abort", "start", "locked"):
        return drawn_host(config, kind, seed, pair, below)
    if kind in ("range", "parts"):
        return drawn_place(config, kind, below)
    if kind == "levels":
        return drawn_level(config, below)
    if kind in ("size", "alignment", "pages", "features"):
        return drawn_register(config, kind, below)
    return drawn_header(config, kind, below)


def drawn_header(config: Config, kind: str, below: Below) -> Fault:
    """A model that this machine refuses."""
    if kind == "magic":
        return Fault(ErrorCode.MAGIC, header={"magic": MAGIC ^ (1 << below(32))})
    if kind == "version":
        version = [0, 2, VERSIONS[-1] + 1, 0xFFFF][below(4)]
        return Fault(ErrorCode.VERSION, header={"version": version})
    if kind == "degree":
        degree = config.sh_degree + 1 + below(255 - config.sh_degree)
        return Fault(ErrorCode.DEGREE, degree, header={"sh_degree": degree})
    fields = [{"position": 1}, {"colour_index": below(6)}]
    fields += [{"position_exponent": 256 + below(1000)}]
    fields += [{"exponent": EXPONENT_MAX + 1 + below(1000)}]
    if not config.sh_degree:
        fields += [{"sh_index": 1}]
    return Fault(ErrorCode.FORMAT, header=fields[below(len(fields))])


def drawn_register(config: Config, kind: str, below: Below) -> Fault:
    """A register of the frame with an invalid value, or one too small for the frame."""
    frame = golden(config, B)
    if kind == "pages":
        return Fault(ErrorCode.PAGES, values={"LISTS_PAGES": below(frame.binned.lists.needed)})
    if kind == "features":
        return Fault(ErrorCode.FEATURES, values={"FEATURES_MAX": below(len(frame.binned.kept))})
    if kind == "alignment":
        name = list(registers.ALIGNED)[below(len(registers.ALIGNED))]
        value = values_of(config, B, SPOILT, B)[name] + 1 + below(registers.ALIGNED[name] - 1)
        return Fault(ErrorCode.ALIGNMENT, number(config, name), values={name: value})
    width = job(config, B).camera.width
    sides = {"WIDTH": config.side_max - below(31), "HEIGHT": config.side_max - below(31)}
    choices = [({"WIDTH": 0}, 0), (sides, 0), ({"HEIGHT": 0}, 1)]
    choices += [({"STRIDE": stride(width) + 1 + below(STRIDE_ALIGNMENT - 1)}, 2)]
    choices += [({"STRIDE": stride(width) - STRIDE_ALIGNMENT}, 2)]
    values, detail = choices[below(len(choices))]
    return Fault(ErrorCode.SIZE, detail, values=values)


def number(config: Config, name: str) -> int:
    """The number of a frame's register, as in an error's detail."""
    return [register.name for register in frame_registers(config)].index(name)


def drawn_place(config: Config, kind: str, below: Below) -> Fault:
    """An area that ends beyond 4 GiB, or a model header with wrongly placed parts."""
    at = {name: job(config, B).model.value(name) for name in PLACED}
    if kind == "parts":
        fields = [{"count": 4 * at["colours"] + 1 + below(1 << 20)}, {"end": at["colours"] - 1}]
        fields += [{"positions": at["attributes"] + 1 + below(1000)}, {"colours": 0}]
        return Fault(ErrorCode.PARTS, header=fields[below(len(fields))])
    name = ["MODEL", "GROUPS", "LISTS", "FEATURES", "SCRATCH", "PIXELS"][below(6)]
    if name == "MODEL":
        beyond = {"header": {"end": at["end"] + (1 << 26 + below(6))}}
    else:
        beyond = {"values": {name: (1 << 32) - WORK_ALIGNMENT}}
    return Fault(ErrorCode.RANGE, number(config, name), **beyond)


def drawn_level(config: Config, below: Below) -> Fault:
    """A record of a level that contradicts its place."""
    levels = job(config, B).model.levels
    chunk = below(len(levels["jump"]))
    choices = [{"jump": below(chunk + 1)}, {"jump": len(levels["jump"]) + 1 + below(1000)}]
    choices += [{"last": 0}, {"error": 1}] if not levels["error"][chunk] else [{"error": 0}]
    return Fault(ErrorCode.LEVELS, level=(chunk, choices[below(len(choices))]))


def drawn_answer(config: Config, kind: str, seed: int, pair: bool, below: Below) -> Fault:
    """Memory that answers with an error, does not answer, or answers without a request.

    The fault comes after B's start.
    """
    times = timetable(config, seed, pair)
    first, end = (dict(zip(("read", "write"), n, strict=True)) for n in (times.first, times.asked))

    def one(way: str) -> tuple[int]:
        return (first[way] + below(end[way] - first[way]),)

    way = kind if kind in ("read", "write") else ("read", "write")[below(2)]
    if kind == "missing":
        timing = {f"{way}_missing": one(way)}
        return Fault(ErrorCode.NONE, timing=timing, reported=False, stuck=True)
    if kind == "stray":
        unused = (1 << ID_BITS) - 1
        detail = unused + (1 << ID_BITS if way == "write" else 0)
        timing = {f"{way}_strays": one(way)}
        return Fault(ErrorCode.STRAY, detail, timing=timing, survives=True)
    code = ErrorCode.READ if way == "read" else ErrorCode.WRITE
    return Fault(code, None, timing={f"{way}_errors": one(way)})


def hand_over(config: Config, seed: int, pair: bool) -> list[Fault]:
    """ABORT and memory errors in all cycles, read beats and write bursts around B's hand-over."""
    times = timetable(config, seed, pair)
    handed = dict(zip(("read", "write"), times.handed, strict=True))
    found = [aborted(times.ready - times.begin + cycles) for cycles in AROUND["abort"]]
    for way, code in (("read", ErrorCode.READ), ("write", ErrorCode.WRITE)):
        numbers = [handed[way] + n for n in AROUND[way]]
        found += [Fault(code, None, timing={f"{way}_errors": (n,)}) for n in numbers]
    return found


def aborted(cycles: int) -> Fault:
    """ABORT `cycles` cycles after B's start."""
    after = cycles, "write", "CONTROL", registers.ABORT
    return Fault(ErrorCode.NONE, after=after, reported=False)


def drawn_host(config: Config, kind: str, seed: int, pair: bool, below: Below) -> Fault:
    """A host that breaks the rules, or aborts or resets the machine."""
    times = timetable(config, seed, pair)
    whole, points = times.end - times.begin, times.ready - times.begin
    if kind == "reset":
        return Fault(ErrorCode.NONE, after=(below(whole + 100) + 1, "reset"), reported=False)
    if kind == "abort":
        return aborted(below(whole) + 1)
    wait = below(points - 300) + 1
    if kind == "start":
        after = wait, "write", "CONTROL", registers.START
        return Fault(ErrorCode.START, after=after, survives=True)
    names = [register.name for register in frame_registers(config)]
    detail, value = below(len(names)), below(1 << 32)
    assert addresses(config)[names[detail]] == registers.FRAME_START + detail * registers.WORD
    after = wait, "write", names[detail], value
    return Fault(ErrorCode.LOCKED, detail, after=after, survives=True)


def check_outcome(config: Config, fault: Fault, outcome: Outcome, pair: bool):
    """Check the outcome of a fault.

    Raises AssertionError unless the right error was reported, the machine came to rest, and C and
    all frames that the fault spares are the golden model's.
    """
    code, detail, halves = registers.split_error(outcome.error)
    flight = [A, B] if pair else [B]
    expected = {fault.code} | ({ErrorCode.READ} if fault.twice else set())
    assert code in expected, f"reported {code.name}, not {fault.code.name}"
    if code in CLIENTS:
        half = [*CLIENTS[code].values()][detail]
        assert fault.twice or halves == 1 << half, f"half {half} failed, ERROR has {halves:02b}"
    elif fault.detail is not None:
        assert detail == fault.detail, f"detail {detail}, not {fault.detail}"
    if code != ErrorCode.READ:  # a wrongly read value may be an address
        assert not outcome.report.outside, outcome.report.why
    assert fault.stuck == (outcome.status != registers.READY), f"STATUS {outcome.status}"
    right = {k: np.array_equal(outcome.images[k], golden(config, k).pixels) for k in flight}
    if fault.after and fault.after[1] == "reset":
        done = []
    elif not (fault.reported or fault.survives):  # each frame in flight is aborted or stuck
        done = flight[: outcome.finished]
        assert not fault.stuck or len(done) < len(flight)
        assert fault.stuck or outcome.before == outcome.finished, "a frame outlives ABORT"
    else:
        done = [k for k in flight if k not in lost(fault, outcome, halves, pair)]
        assert outcome.finished == len(done), f"{outcome.finished} frames are complete"
    assert all(right[k] for k in done), f"wrong pixels: of A and B these are right: {right}"
    assert np.array_equal(outcome.good, golden(config, B).pixels), "C has wrong pixels"


def lost(fault: Fault, outcome: Outcome, halves: int, pair: bool) -> set[int]:
    """The frames that an error aborts. halves: bits of the halves that failed, from ERROR."""
    found = set()
    if halves >> PREPROCESSING & 1:
        found.add(B)
    if halves >> RENDERING & 1:
        found.add(A if pair and not outcome.before else B)
    assert bool(found) != fault.survives, f"halves {halves:02b} failed"
    return found


def fault_run(seed: int, number: int) -> dict:
    """Simulate run `number`; return its machine, kind and, in "wrong", the failed check as text."""
    (kind, pair), turn = WAYS[number % len(WAYS)], number // len(WAYS)
    name = "alpha" if kind == "levels" else CHOSEN[turn % len(CHOSEN)]
    config, own = MACHINES[name], (seed << 20) + turn
    wrong = ""
    try:
        fault = drawn(config, kind, own, pair)
        check_outcome(config, fault, run_fault(config, fault, own, pair), pair)
    except AssertionError as error:
        wrong = str(error) or "an assertion failed"
    flight = "with a frame in flight" if pair else "alone"
    return {"machine": name, "number": number, "kind": f"{kind}, {flight}", "wrong": wrong}
