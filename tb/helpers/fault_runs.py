"""Frames that something goes wrong in, and a good one after each, on a small machine."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from splatcore.golden.pipeline import render
from splatcore.sim.machine.areas import BASE, Areas, make_memory, place_areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.sim.machine.script import Report, Script, Timing, execute
from splatcore.spec import registers
from splatcore.spec.axi import ID_BITS, PREPROCESSING, READERS, WRITERS
from splatcore.spec.colour import EXPONENT_MAX
from splatcore.spec.config import TINY
from splatcore.spec.memory import HEADER, MAGIC, PLACED
from splatcore.spec.registers import ErrorCode, addresses, frame_registers
from splatcore.spec.work import PIXEL, STRIDE_ALIGNMENT, WORK_ALIGNMENT, stride
from tb.helpers.machines import garden, machine, view

QUIET = 4_000  # cycles in which whatever was on its way comes to its end
IDLE_MAX = 20_000  # cycles without any movement after which a run counts as hung

GOOD, BAD = 0, 1
"""Models, and images, of the good frame and of the one that something goes wrong in."""

KINDS = (
    "read", "write", "pages", "features", "magic", "version", "format", "degree",
    "size", "alignment", "reset", "abort", "start", "locked", "stray",
    "range", "parts",
)  # fmt: skip
"""Kinds of what can go wrong."""

ALL = registers.INTERRUPT_READY | registers.INTERRUPT_FRAME | registers.INTERRUPT_ERROR


@dataclass
class Fault:
    """A thing that goes wrong, and what must come of it.

    code, detail: of ERROR (None: any). values: registers of the bad frame. header: fields of its
    model's header. timing: memory's faults. after: cycles from the frame's start, and what the host
    does then. survives: the frame is complete all the same. told: the bits that the host waits for.
    """

    code: ErrorCode
    detail: int | None = 0
    values: dict[str, int] | None = None
    header: dict[str, int] | None = None
    timing: dict | None = None
    after: tuple | None = None
    survives: bool = False
    told: int = registers.INTERRUPT_ERROR


@cache
def job() -> Job:
    """A frame with lists that do not fit on chip."""
    return Job(garden(TINY, 250), view(40, 36))


@cache
def golden():
    """The golden model's frame of it."""
    return render(TINY, *job())


def memory_timing(seed: int) -> Timing:
    """Memory of a run: any latency, some stalls."""
    generator = np.random.default_rng(seed)
    stall = float(generator.choice([0, 0, 0.3]))
    latency = int(generator.integers(1, 60))
    return Timing("faulty", latency=latency, stall=stall, seed=seed)


@dataclass
class Outcome:
    """A run: its report, the machine's ERROR and STATUS after the fault, and the images."""

    report: Report
    error: int
    status: int
    bad: np.ndarray
    good: np.ndarray


def run_frame(seed: int) -> tuple[Report, int, int]:
    """A frame without any fault: its report, the cycles at which it was started and was READY."""
    script, areas = Script(TINY), areas_of()
    script.write("INTERRUPT_ENABLE", ALL)
    begin = start(script, areas, GOOD)
    script.wait(registers.INTERRUPT_FRAME)
    with TemporaryDirectory() as name:
        make_memory(Path(name), areas, [job().model] * 2)
        report = execute(machine(TINY).program, Path(name), script, areas, memory_timing(seed))
    assert report.done, report.why
    ready = next(cycle for cycle, bits in report.events if bits & registers.INTERRUPT_READY)
    return report, report.answers[begin].cycle, ready


@cache
def areas_of() -> Areas:
    """Room for two models."""
    size = job().camera.width, job().camera.height
    return place_areas(TINY, [job().model] * 2, [size, size])


def start(script: Script, areas: Areas, which: int, values: dict[str, int] | None = None) -> int:
    """Write a frame's registers and start it; the number of the last command."""
    found = frame_values(TINY, job(), which, areas, which) | (values or {})
    for name, value in found.items():
        script.write(name, value)
    return script.write("CONTROL", registers.START)


def run_fault(fault: Fault, seed: int) -> Outcome:
    """A frame with a fault, what is to be done about it, and a good frame."""
    script, areas = Script(TINY), areas_of()
    size = stride(job().camera.width) * job().camera.height
    script.write("INTERRUPT_ENABLE", ALL)
    start(script, areas, BAD, fault.values)
    if fault.after:
        cycles, command, *values = fault.after
        script.cycles(cycles)
        getattr(script, command)(*values)
    if fault.told:
        script.wait(fault.told)
    error = script.read("ERROR")
    script.write("ERROR", 0)
    if fault.survives:
        script.wait(registers.INTERRUPT_FRAME)
    script.cycles(QUIET)
    status = script.read("STATUS")
    script.save(areas.images[BAD], size, "bad")
    script.write("INTERRUPT_ENABLE", ALL)
    start(script, areas, GOOD)
    script.wait(registers.INTERRUPT_FRAME)
    script.save(areas.images[GOOD], size, "good")
    timing = replace(memory_timing(seed), **(fault.timing or {}))
    with TemporaryDirectory() as name:
        folder = Path(name)
        make_memory(folder, areas, [job().model] * 2)
        _spoil(folder, areas, fault.header or {})
        report = execute(machine(TINY).program, folder, script, areas, timing, idle_max=IDLE_MAX)
        assert report.done, report.why
        images = [np.fromfile(folder / name, np.uint8) for name in ("bad", "good")]
    answers = report.answers
    return Outcome(report, answers[error].value, answers[status].value, *map(picture, images))


def picture(data: np.ndarray) -> np.ndarray:
    """Rows of memory as pixels [H, W, 3]."""
    camera = job().camera
    rows = data.reshape(camera.height, stride(camera.width))
    return rows[:, : camera.width * PIXEL].reshape(camera.height, camera.width, PIXEL)


def _spoil(folder: Path, areas: Areas, fields: dict[str, int]):
    """Other values in the bad model's header."""
    memory = np.memmap(folder / "memory", np.uint8, "r+")
    for name, value in fields.items():
        at = areas.models[BAD] - BASE + HEADER.offset(name) // 8
        width = HEADER[name].width // 8
        memory[at : at + width] = np.frombuffer(value.to_bytes(width, "little"), np.uint8)
    memory.flush()


def drawn(kind: str, seed: int) -> Fault:
    """A fault of a kind, drawn at random."""
    generator = np.random.default_rng([seed, len(kind)])

    def below(n: int) -> int:
        return int(generator.integers(n))

    frame = golden()
    if kind in ("read", "write", "stray"):
        return drawn_answer(kind, seed, below)
    if kind == "pages":
        return Fault(ErrorCode.PAGES, values={"LISTS_PAGES": below(frame.binned.lists.needed)})
    if kind == "features":
        return Fault(ErrorCode.FEATURES, values={"FEATURES_MAX": below(len(frame.binned.kept))})
    if kind == "magic":
        return Fault(ErrorCode.MAGIC, header={"magic": MAGIC ^ (1 << below(32))})
    if kind == "version":
        return Fault(ErrorCode.VERSION, header={"version": [0, 2, 4, 0xFFFF][below(4)]})
    if kind == "format":
        fields = [{"sh_degree": 2 + below(2)}, {"position": 1}, {"colour_index": below(6)}]
        fields += [{"position_exponent": 256 + below(1000)}, {"sh_index": 1}]
        fields += [{"exponent": EXPONENT_MAX + 1 + below(1000)}]
        return Fault(ErrorCode.FORMAT, header=fields[below(len(fields))])
    if kind == "degree":
        degree = TINY.sh_degree + 1 + below(255 - TINY.sh_degree)
        return Fault(ErrorCode.DEGREE, degree, header={"sh_degree": degree})
    if kind == "alignment":
        names = [register.name for register in frame_registers(TINY)]
        name = list(registers.ALIGNED)[below(len(registers.ALIGNED))]
        values = frame_values(TINY, job(), BAD, areas_of(), BAD)
        value = values[name] + 1 + below(registers.ALIGNED[name] - 1)
        return Fault(ErrorCode.ALIGNMENT, names.index(name), values={name: value})
    if kind == "size":
        return drawn_size(below)
    if kind in ("range", "parts"):
        return drawn_place(kind, below)
    return drawn_host(kind, seed, below)


def drawn_answer(kind: str, seed: int, below: Callable[[int], int]) -> Fault:
    """A beat or a burst is answered by an error, or there is an answer that nobody asked for."""
    way = kind if kind != "stray" else ("read", "write")[below(2)]
    report, *_ = run_frame(seed)
    if way == "read":
        count, code = sum(report.read.values()), ErrorCode.READ
    else:
        bursts = {"features": 2, "lists": 2, "groups": 2, "buckets": 2, "pixels": 3}
        count = sum(n // bursts[name] for name, n in report.written.items())
        code = ErrorCode.WRITE
    if kind == "stray":
        timing, nobody = {f"{way}_strays": (below(count),)}, (1 << ID_BITS) - 1
        detail = nobody + (1 << ID_BITS if way == "write" else 0)
        return Fault(ErrorCode.STRAY, detail, timing=timing, survives=True)
    return Fault(code, None, timing={f"{way}_errors": (below(count),)})


def drawn_place(kind: str, below: Callable[[int], int]) -> Fault:
    """Something ends beyond 4 GiB, or the model's header places its parts wrongly."""
    at = {name: job().model.value(name) for name in PLACED}
    if kind == "parts":
        fields = [{"count": 4 * at["colours"] + 1 + below(1 << 20)}, {"end": at["colours"] - 1}]
        fields += [{"positions": at["attributes"] + 1 + below(1000)}, {"colours": 0}]
        return Fault(ErrorCode.PARTS, header=fields[below(len(fields))])
    names = [register.name for register in frame_registers(TINY)]
    name = ["MODEL", "GROUPS", "LISTS", "FEATURES", "SCRATCH", "PIXELS"][below(6)]
    beyond = {"header": {"end": at["end"] + (1 << 26 + below(6))}}
    if name != "MODEL":
        beyond = {"values": {name: (1 << 32) - WORK_ALIGNMENT}}
    return Fault(ErrorCode.RANGE, names.index(name), **beyond)


def drawn_size(below: Callable[[int], int]) -> Fault:
    """An image that cannot be."""
    width = job().camera.width
    choices = [({"WIDTH": 0}, 0), ({"WIDTH": TINY.width_max + 1 + below(63)}, 0)]
    choices += [({"HEIGHT": 0}, 1), ({"HEIGHT": TINY.height_max + 1 + below(63)}, 1)]
    choices += [({"STRIDE": stride(width) + 1 + below(STRIDE_ALIGNMENT - 1)}, 2)]
    choices += [({"STRIDE": stride(width) - STRIDE_ALIGNMENT}, 2)]
    values, detail = choices[below(len(choices))]
    return Fault(ErrorCode.SIZE, detail, values=values)


def drawn_host(kind: str, seed: int, below: Callable[[int], int]) -> Fault:
    """The host does what it must not, or changes its mind."""
    report, begin, ready = run_frame(seed)
    whole, points = report.cycles - begin, ready - begin
    if kind == "reset":
        return Fault(ErrorCode.NONE, after=(below(whole + 100) + 1, "reset"), told=0)
    if kind == "abort":
        after = below(whole * 3 // 4) + 1, "write", "CONTROL", registers.ABORT
        return Fault(ErrorCode.NONE, after=after, told=0)
    wait = below(points - 300) + 1
    if kind == "start":
        after = wait, "write", "CONTROL", registers.START
        return Fault(ErrorCode.START, after=after, survives=True)
    names = [register.name for register in frame_registers(TINY)]
    number, value = below(len(names)), below(1 << 32)
    name = names[number]
    assert addresses(TINY)[name] == registers.FRAME_START + number * registers.WORD
    return Fault(ErrorCode.LOCKED, number, after=(wait, "write", name, value), survives=True)


def check_outcome(fault: Fault, outcome: Outcome):
    """The right error was told; all is quiet, and the good frame is the golden model's."""
    above, code = divmod(outcome.error, 1 << registers.CODE_BITS)
    halves, detail = divmod(above, 1 << registers.DETAIL_BITS)
    assert ErrorCode(code) == fault.code
    bus = {ErrorCode.READ: READERS, ErrorCode.WRITE: WRITERS}
    if fault.code in bus:  # the other half may have failed, too, by what was read wrong
        assert halves >> [*bus[fault.code].values()][detail] & 1
    else:
        assert halves == (0 if fault.survives or not fault.code else 1 << PREPROCESSING)
    if fault.detail is not None:
        assert detail == fault.detail
    elif fault.code != ErrorCode.NONE:
        assert detail < len(READERS if fault.code == ErrorCode.READ else WRITERS)
    assert outcome.status == registers.READY
    if fault.code != ErrorCode.READ:  # what was read wrong may be an address
        assert not outcome.report.outside, outcome.report.why
    assert np.array_equal(outcome.good, golden().pixels)
    if fault.survives:
        assert np.array_equal(outcome.bad, golden().pixels)
