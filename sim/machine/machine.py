"""The whole machine in simulation: frames from packed models to pixels in memory.

`Machine` compiles `hdl.top.Top` with a memory and a host (`sim.machine.program`). `run` acts as a
driver: it writes a frame's registers, starts the frame, and starts the next one while the first
one's tiles are rendered.
"""

import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from amaranth.hdl import UnusedElaboratable

from splatcore.hdl.top import Top
from splatcore.sim.machine.areas import IMAGES, Areas, make_memory, place_areas
from splatcore.sim.machine.execute import execute, open_memory
from splatcore.sim.machine.program import compiled
from splatcore.sim.machine.script import IDEAL, PIXELS_WRITTEN, Report, Script, Timing
from splatcore.sim.rtl.build import FAST, QUICK
from splatcore.sim.rtl.convert import kept
from splatcore.sim.rtl.coverage import counted
from splatcore.spec import registers
from splatcore.spec.axi import port_bytes
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.counters import counters
from splatcore.spec.frame import frame_constants
from splatcore.spec.packed import PackedModel
from splatcore.spec.raster import COLOURS
from splatcore.spec.registers import INTERRUPT_FRAME, INTERRUPT_READY, ErrorCode
from splatcore.spec.stages import BLOCKS
from splatcore.spec.work import pixel_bytes, stride

# A machine whose Verilog is kept is never elaborated; Amaranth warns of it once another one was.
warnings.filterwarnings("ignore", category=UnusedElaboratable)

FIRST_HALF = ("preprocessing", *BLOCKS["preprocessing"])
"""Stages whose counters belong to a frame until the next one is started."""

SMALL = 1 << 14  # pixels: machines for smaller images take longer to compile than to run

STATE = ("STATUS", "ERROR", "STARTED", "FINISHED", "NEEDED")
"""Registers read at the end of a run."""


class Job(NamedTuple):
    """A frame to render.

    background: codes of `spec.colour.colour_format`
    rgba: whether its pixels have alpha (`spec.work`)
    """

    model: PackedModel
    camera: Camera
    background: tuple[int, int, int] = (0, 0, 0)
    rgba: bool = False

    def pixels(self, image: np.ndarray) -> np.ndarray:
        """The pixels [H, W, 3 or 4] of the bytes of an image."""
        width, height, pixel = self.camera.width, self.camera.height, pixel_bytes(self.rgba)
        rows = image.reshape(height, -1)[:, : width * pixel]
        return rows.reshape(height, width, pixel).copy()


@dataclass
class Rendered:
    """A rendered frame; fields that the run did not reach are None or empty.

    config: the machine
    pixels: [H, W, 3] uint8, or [H, W, 4] with alpha, the colour premultiplied
    counters: by register, lower case; those of the second half only in a run's last frame, as the
        next frame may change them before they are read
    started, ready, finished: cycles of its start and of its interrupts
    """

    config: Config
    pixels: np.ndarray | None = None
    counters: dict[str, int] = field(default_factory=dict)
    started: int | None = None
    ready: int | None = None
    finished: int | None = None

    @property
    def traffic(self) -> dict[str, int]:
        """Bytes of memory traffic by cause, of the halves whose counters were read.

        Whole beats; of pixels only the bytes that are written.
        """
        parts = [(name, *name.split("_", 1)) for name in self.counters]
        found = {
            cause: self.counters[name] * port_bytes(self.config)
            for name, half, cause in parts
            if half in ("preprocessing", "rendering") and cause != "cycles"
        }
        if PIXELS_WRITTEN in found and self.pixels is not None:
            found[PIXELS_WRITTEN] = self.pixels.size
        return found


@dataclass
class Run:
    """Results of a run.

    error, detail: of the machine's ERROR register
    state: final values of the registers `STATE`
    areas: the memory map
    memory: the memory's bytes after the run
    """

    frames: list[Rendered]
    report: Report
    error: ErrorCode
    detail: int
    state: dict[str, int]
    areas: Areas
    memory: np.ndarray

    @property
    def done(self) -> bool:
        return self.report.done and self.error == ErrorCode.NONE

    @property
    def why(self) -> str:
        """Outcome of the run, as text."""
        if self.error == ErrorCode.NONE:
            return self.report.why
        return f"{self.report.why}: ERROR {self.error.name}, detail {self.detail}"

    @property
    def preprocessing_cycles(self) -> list[int]:
        """Cycles of each frame from its start to READY."""
        return [f.ready - f.started for f in self.frames if f.ready is not None]

    @property
    def rendering_cycles(self) -> list[int]:
        """Cycles of each frame from when its points and the rendering half are ready to its end."""
        return [end - begin for begin, end in self._rendering()]

    def _rendering(self) -> list[tuple[int, int]]:
        found, before = [], 0
        for frame in self.frames:
            if frame.finished is None:
                break
            found.append((max(frame.ready, before), frame.finished))
            before = frame.finished
        return found

    @property
    def frame_cycles(self) -> list[int]:
        """Cycles of each frame except the last: from when its tiles can be rendered until the next
        frame's can, which includes preprocessing the next frame."""
        spans = self._rendering()
        return [after - before for (before, _), (after, _) in pairwise(spans)]


class Machine:
    """A compiled machine.

    source: Verilog to use instead of the machine's own
    trace: kind of waveforms that it can write, "vcd" or "fst"; empty for none
    options: of `sim.machine.program.compiled`
    """

    def __init__(self, config: Config, source: str | None = None, trace: str = "", **options):
        self.config = config
        self.source = source or machine_source(config)
        small = config.width_max * config.height_max <= SMALL
        self.program = compiled(
            config, self.source, trace, **options, level=QUICK if small else FAST
        )

    def run(
        self,
        jobs: list[Job],
        timing: Timing = IDEAL,
        progress: Callable[[int, int, int], None] | None = None,
        sizes: dict[str, int] | None = None,
        retry: bool = True,
        **options,
    ) -> Run:
        """Render frames one after the other; preprocessing of a frame overlaps with rendering.

        progress: called with cycles, image bytes written, and image bytes in all
        sizes: `pages` and `features` of `sim.machine.areas.place_areas`
        retry: whether to run again with enough list memory if there was too little
        options: of `sim.machine.execute.execute`; `settings` is a function of the areas; `keep`: a
            folder for waveforms
        """
        run = self._run(jobs, timing, progress, sizes or {}, **options)
        if retry and run.error == ErrorCode.PAGES:
            sizes = (sizes or {}) | {"pages": run.state["NEEDED"]}
            options.pop("saves", None)  # they are of a smaller memory
            return self._run(jobs, timing, progress, sizes, **options)
        return run

    def _run(self, jobs, timing, progress, sizes: dict, keep=None, settings=None, **options) -> Run:
        jobs = [Job(*job) for job in jobs]
        models = list({id(job.model): job.model for job in jobs}.values())
        shapes = [(job.camera.width, job.camera.height) for job in jobs]
        areas = place_areas(self.config, models, shapes, **sizes)
        total = sum(job.camera.width * job.camera.height * pixel_bytes(job.rgba) for job in jobs)

        def report_progress(cycles: int, written: int):
            progress(cycles, written, total)

        with TemporaryDirectory(prefix="splatcore") as name:
            folder = Path(name)
            make_memory(folder, areas, models)
            script, marks, last = host_script(self.config, jobs, models, areas)
            report = execute(
                self.program, folder, script, areas, timing,
                progress=report_progress if progress else None,
                settings=settings(areas) if settings else None, **options,
            )  # fmt: skip
            frames = [
                rendered(report, mark, job, folder / f"pixels.{k}")
                for k, (mark, job) in enumerate(zip(marks, jobs, strict=True))
            ]
            if keep:
                for file in folder.glob("waves*"):
                    shutil.move(file, keep / file.name)
            memory = open_memory(folder)
        for bit, name in ((INTERRUPT_READY, "ready"), (INTERRUPT_FRAME, "finished")):
            cycles = [cycle for cycle, bits in report.events if bits & bit]
            for frame, cycle in zip(frames, cycles, strict=False):
                setattr(frame, name, cycle)
        state = {name: report.answers[k].value for name, k in last.items() if k in report.answers}
        error, detail, _ = registers.split_error(state.get("ERROR", 0))
        return Run(frames, report, error, detail, state, areas, memory)


@cache
def machine_source(config: Config) -> str:
    """The machine's Verilog."""
    return kept(Top(config), emit_src=counted())


def frame_values(config: Config, job: Job, model: int, areas: Areas, image: int) -> dict[str, int]:
    """Register values of a frame.

    model: number of its model in `areas`
    image: number of its image and of its work area
    """
    camera, model_of = job.camera, job.model.value
    frame = frame_constants(
        config, camera, model_of("position_exponent"), model_of("factor_exponent")
    )
    values = {"WIDTH": camera.width, "HEIGHT": camera.height}
    values["STRIDE"] = stride(camera.width, job.rgba)
    if config.rgba:
        values["FORMAT"] = registers.RGBA * job.rgba
    values |= registers.address_values(config, "MODEL", areas.models[model])
    values |= areas.registers[image]
    values |= registers.address_values(config, "PIXELS", areas.images[image])
    for name, code in zip(COLOURS, job.background, strict=True):
        values[f"BACKGROUND_{name.upper()}"] = int(code)
    return values | registers.camera_values(config, frame)


def host_script(
    config: Config, jobs: list[Job], models: list[PackedModel], areas: Areas
) -> tuple[Script, list[dict[str, int]], dict[str, int]]:
    """A driver's script for these frames.

    Returns the script, the numbers of each frame's commands by register or mark, and the numbers of
    the last part's reads by register.
    """
    script, marks = Script(config), [{} for _ in jobs]
    places = {id(model): k for k, model in enumerate(models)}

    def start(k: int):
        values = frame_values(config, jobs[k], places[id(jobs[k].model)], areas, k % IMAGES)
        for name, value in values.items():
            script.write(name, value)
        marks[k]["START"] = script.write("CONTROL", registers.START)

    def read(k: int, first: bool):
        """Read the counters of a half."""
        for stage, names in counters(config).items():
            for name in names if (stage in FIRST_HALF) == first else ():
                register = f"{stage}_{name}".upper()
                marks[k][register] = script.read(register)

    enabled = INTERRUPT_READY | INTERRUPT_FRAME | registers.INTERRUPT_ERROR
    script.write("INTERRUPT_ENABLE", enabled)
    start(0)
    for k, job in enumerate(jobs):
        script.wait(INTERRUPT_READY)
        read(k, True)
        if k + 1 < len(jobs):
            start(k + 1)
        script.wait(INTERRUPT_FRAME)
        if k + 1 == len(jobs):
            read(k, False)
        size = stride(job.camera.width, job.rgba) * job.camera.height
        marks[k]["PIXELS"] = script.save(areas.images[k % IMAGES], size, f"pixels.{k}")
    script.last_part()
    return script, marks, {name: script.read(name) for name in STATE}


def rendered(report: Report, marks: dict[str, int], job: Job, path: Path) -> Rendered:
    """Assemble a frame from the answers to its commands. path: file of its pixels."""
    found = {name: report.answers[k] for name, k in marks.items() if k in report.answers}
    frame = Rendered(report.config)
    if "START" in found:
        frame.started = found.pop("START").cycle
    if "PIXELS" in found:
        del found["PIXELS"]
        frame.pixels = job.pixels(np.fromfile(path, np.uint8))
    frame.counters = {name.lower(): answer.value for name, answer in found.items()}
    return frame
