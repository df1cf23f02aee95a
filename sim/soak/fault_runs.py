"""Runs with a fault in a frame, alone or with another frame in flight, and a good frame after it.

A run: frame A is started and handed over to the rendering half. Frame B is started while A's
tiles are rendered, and a fault occurs. Once the machine is at rest, frame C is rendered, which
must be right in every case. Without A, B is alone in the machine.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from splatcore.golden.pipeline import Frame, render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.areas import Areas, make_memory, place_areas
from splatcore.sim.machine.execute import execute
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.sim.machine.script import Report, Script, Timing
from splatcore.sim.soak.machines import graded, machine
from splatcore.spec import registers
from splatcore.spec.config import Config
from splatcore.spec.group import group_pixels
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import CHUNK, HEADER
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import ErrorCode
from splatcore.spec.work import PIXEL, stride

QUIET = 4_000  # cycles in which everything in flight completes
IDLE_MAX = 20_000  # cycles without activity after which a run counts as hung

A, B = 0, 1
"""Frames in flight, and numbers of their images. C's image is A's."""

WHOLE, SPOILT = 0, 1
"""Models in memory: for A and C, for B."""

GAUSSIANS = 250
GROUPED = 8 * CHUNK  # Gaussians of a model with levels: two groups of one group
STEP = 0.1  # shift of B's and C's camera, so that their picture differs from A's

ALL = registers.INTERRUPT_READY | registers.INTERRUPT_FRAME | registers.INTERRUPT_ERROR


@dataclass(frozen=True)
class Fault:
    """A fault, and the expected outcome.

    code, detail: expected fields of ERROR; detail None: any
    values: registers of frame B
    header: fields of the header of B's model
    level: number of a chunk of B's model, and fields of its record (`spec.levels`)
    timing: faults of memory, fields of `Timing`
    after: cycles from B's start, then the host's command and its arguments
    survives: no frame is lost
    reported: the machine reports an error
    twice: a read error occurs, too
    stuck: the machine hangs until the host resets it
    """

    code: ErrorCode
    detail: int | None = 0
    values: dict[str, int] | None = None
    header: dict[str, int] | None = None
    level: tuple[int, dict[str, int]] | None = None
    timing: dict | None = None
    after: tuple | None = None
    survives: bool = False
    reported: bool = True
    twice: bool = False
    stuck: bool = False


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    before: FINISHED when the error was reported
    error, finished, status: registers at rest
    images: of A and B at rest
    good: image of C
    """

    report: Report
    before: int
    error: int
    finished: int
    status: int
    images: tuple[np.ndarray, np.ndarray]
    good: np.ndarray


@dataclass(frozen=True)
class Timetable:
    """Times of a run without a fault.

    begin, ready, end: cycles of B's start, of its READY and of its end
    first, handed, asked: (read beats, write bursts) requested until B's start, until READY and in
        all
    """

    begin: int
    ready: int
    end: int
    first: tuple[int, int]
    handed: tuple[int, int]
    asked: tuple[int, int]


@cache
def job(config: Config, which: int) -> Job:
    """A's job, or B's and C's: four groups, with lists too long for a small machine's chip."""
    side = group_pixels(config)
    camera = generated_camera("garden", side * 5 // 4, side * 9 // 8)
    camera = replace(camera, translation=camera.translation - [STEP * which, 0, 0])
    if not graded(config):
        return Job(pack(generate("garden", GAUSSIANS), config)[0], camera)
    model, _ = pack(generate("garden", GROUPED), config)
    return Job(with_levels(model, config)[0], replace(camera, lod_pixels=1.0))


@cache
def golden(config: Config, which: int) -> Frame:
    """The golden model's frame of `job`."""
    return render(config, *job(config, which))


@cache
def areas_of(config: Config) -> Areas:
    """Memory areas for two models."""
    frame = job(config, B)
    size = frame.camera.width, frame.camera.height
    return place_areas(config, [frame.model] * 2, [size, size])


def memory_timing(seed: int) -> Timing:
    """Memory of a run: random latency, sometimes stalls."""
    generator = np.random.default_rng(seed)
    stall = float(generator.choice([0, 0, 0.3]))
    latency = int(generator.integers(1, 60))
    return Timing("faulty", latency=latency, stall=stall, seed=seed)


def values_of(config: Config, which: int, model: int, image: int) -> dict[str, int]:
    """Values of a frame's registers."""
    return frame_values(config, job(config, which), model, areas_of(config), image)


def start(script: Script, values: dict[str, int]) -> int:
    """Write a frame's registers and start it; return the number of the start command."""
    for name, value in values.items():
        script.write(name, value)
    return script.write("CONTROL", registers.START)


def begun(config: Config, pair: bool, values: dict[str, int] | None = None) -> tuple[Script, int]:
    """A script up to B's start, and the number of its start command. pair: with A before B."""
    script = Script(config)
    script.write("INTERRUPT_ENABLE", ALL)
    if pair:
        start(script, values_of(config, A, WHOLE, A))
        script.wait(registers.INTERRUPT_READY)
    return script, start(script, values_of(config, B, SPOILT, B) | (values or {}))


@cache
def timetable(config: Config, seed: int, pair: bool) -> Timetable:
    """Simulate the run of a seed without a fault."""
    script, begin = begun(config, pair)
    parts = []
    for wanted in ([], [registers.INTERRUPT_READY], [registers.INTERRUPT_FRAME] * (1 + pair)):
        for bits in wanted:
            script.wait(bits)
        parts.append(_execute(config, script, memory_timing(seed))[0])
    whole = parts[-1]
    assert whole.done, whole.why
    cycles = {
        bits: [cycle for cycle, found in whole.events if found & bits]
        for bits in (registers.INTERRUPT_READY, registers.INTERRUPT_FRAME)
    }
    ready, end = (found[-1] for found in cycles.values())
    return Timetable(whole.answers[begin].cycle, ready, end, *(part.asked for part in parts))


def run_fault(config: Config, fault: Fault, seed: int, pair: bool) -> Outcome:
    """Simulate a run with a fault. pair: A is in flight before B."""
    areas, timing = areas_of(config), replace(memory_timing(seed), **(fault.timing or {}))
    size = stride(job(config, B).camera.width) * job(config, B).camera.height
    script, _ = begun(config, pair, fault.values)
    if fault.after:
        cycles, command, *values = fault.after
        script.cycles(cycles)
        getattr(script, command)(*values)
    if fault.reported:
        script.wait(registers.INTERRUPT_ERROR)
    asked = {"before": script.read("FINISHED")}
    rest = timetable(config, seed, pair).end + QUIET
    script.cycles(rest)
    asked |= {name: script.read(name.upper()) for name in ("error", "finished", "status")}
    for image in (A, B):
        script.save(areas.images[image], size, f"image{image}")
    if fault.stuck:
        script.reset()
    script.write("ERROR", 0)
    start(script, values_of(config, B, WHOLE, A))
    script.cycles(rest)
    script.save(areas.images[A], size, "good")
    files = "image0", "image1", "good"
    report, images = _execute(config, script, timing, fault, files)
    assert report.done, report.why
    *images, good = (_picture(config, image) for image in images)
    found = {name: report.answers[number].value for name, number in asked.items()}
    return Outcome(report, **found, images=tuple(images), good=good)


def _execute(
    config: Config,
    script: Script,
    timing: Timing,
    fault: Fault | None = None,
    files: tuple[str, ...] = (),
) -> tuple[Report, list[np.ndarray]]:
    """Run a script; return its report and the bytes of the files that it writes."""
    areas = areas_of(config)
    with TemporaryDirectory(prefix="splatcore") as name:
        folder = Path(name)
        make_memory(folder, areas, [job(config, B).model] * 2)
        if fault:
            _spoil(folder, areas, fault, job(config, B).model)
        program = machine(config).program
        report = execute(program, folder, script, areas, timing, idle_max=IDLE_MAX)
        found = [folder / file for file in files]
        return report, [np.fromfile(path, np.uint8) for path in found if path.exists()]


def _picture(config: Config, data: np.ndarray) -> np.ndarray:
    """Convert rows of memory into pixels [H, W, 3]."""
    camera = job(config, B).camera
    rows = data.reshape(camera.height, stride(camera.width))
    return rows[:, : camera.width * PIXEL].reshape(camera.height, camera.width, PIXEL)


def _spoil(folder: Path, areas: Areas, fault: Fault, model: PackedModel):
    """Overwrite fields in the header of B's model, or in a record of its levels."""
    memory = np.memmap(folder / "memory", np.uint8, "r+")
    chunk, level = fault.level or (0, {})
    place = model.layout.chunks + chunk * model.format.header_stride
    for record, at, fields in ((HEADER, 0, fault.header or {}), (LEVEL, place, level)):
        row = memory[areas.region(f"model{SPOILT}").at + at :][: record.size]
        codes = record.unpack(row.reshape(1, -1))
        for name, value in fields.items():
            codes[name] = np.full_like(codes[name], value, np.uint64)
        row[:] = record.pack(codes)[0]
    memory.flush()
