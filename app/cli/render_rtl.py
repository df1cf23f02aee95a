"""`splatcore render --engine rtl`: frames of the simulated hardware, and their errors."""

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from splatcore.app.cli import describe
from splatcore.app.cli.options import RTL, option
from splatcore.sim.common.output import (
    check_distinct,
    check_writable,
    console,
    progress_bar,
    write_json,
)
from splatcore.sim.frame.metric import Difference, Result, against, differences, metrics_line
from splatcore.sim.frame.picture import write_error_map, write_png
from splatcore.sim.frame.source import Source, check_fits
from splatcore.sim.frame.unseen import note_empty
from splatcore.sim.machine.script import find_timing
from splatcore.spec.camera import Camera
from splatcore.spec.colour import background_codes
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError

if TYPE_CHECKING:
    from splatcore.golden import pipeline
    from splatcore.sim.machine.machine import Job, Machine, Run
    from splatcore.sim.machine.waves import Recording, Window

WAVES_MAX = 1000.0  # MB, default of --waves-max

FramesOption = option(
    int, "N", "Number of frames, on a small orbit; pictures are numbered.", panel=RTL
)
TimingOption = option(str, "NAME", "Memory model: 'ideal' or 'lpddr4' (64 bits wide).", panel=RTL)
ErrorMapOption = option(Path | None, "FILE.png", "Draw an error map of the first frame.", panel=RTL)
WavesOption = option(
    Path | None,
    "FILE",
    "Record waveforms of --window or --tile (.vcd or .fst), with .gtkw and .sucl files.",
    panel=RTL,
)
WindowOption = option(str | None, "FIRST:LAST", "Cycles for --waves.", panel=RTL)
TileOption = option(
    str | None, "COLUMN,ROW", "Tile for --waves: the cycles of its group in frame 0.", panel=RTL
)
ScopeOption = option(
    str | None,
    "MODULE",
    "Module for --waves, with everything inside, like raster.setup.",
    panel=RTL,
)
WavesMaxOption = option(float, "MB", "Maximum estimated size of --waves.", panel=RTL)


@dataclass(frozen=True)
class Request:
    """The options of RTL simulation, as on the command line."""

    frames: int = 1
    timing: str = "lpddr4"
    error_map: Path | None = None
    waves: Path | None = None
    window: str | None = None
    tile: str | None = None
    scope: str | None = None
    waves_max: float = WAVES_MAX

    def check(self, engine: str, output: Path):
        """Raise InputError for options that do not go together, or an unwritable output."""
        if engine != "rtl":
            for name, value in asdict(self).items():
                if value != getattr(Request(), name):
                    raise InputError(f"--{name.replace('_', '-')}: goes with --engine rtl")
            return
        find_timing(self.timing)
        if self.frames < 1:
            raise InputError(f"--frames {self.frames}: must be 1 or more")
        if bool(self.waves) != bool(self.window or self.tile) or (self.window and self.tile):
            raise InputError("--waves: goes with either --window or --tile")
        if self.scope and not self.waves:
            raise InputError("--scope: goes with --waves")
        if self.waves:
            from splatcore.sim.machine.wave_kind import check_kind

            check_kind(self.waves)
        written = [("-o", numbered(output, k, self.frames)) for k in range(self.frames)]
        check_distinct([*written, *[("--error-map", self.error_map)] * bool(self.error_map)])
        for _, path in written:
            check_writable(path)


def render_rtl(
    source: Source,
    view: Camera,
    camera: str | None,
    config: Config,
    background: tuple[float, float, float],
    request: Request,
    output: Path,
    json: Path | None,
):
    """Simulate frames in RTL, write and compare them; exit with status 1 if one is wrong.

    Every frame is compared with the golden model's, and with the float64 reference on the same
    packed model and on the original scene.
    """
    from splatcore.sim.frame import engines
    from splatcore.sim.frame.choose import packed_model, packing, packing_line
    from splatcore.sim.machine.machine import Job
    from splatcore.sim.machine.path import orbit

    begin = time.perf_counter()
    check_fits(config, view.width, view.height)
    with progress_bar("packing"):
        model = packed_model(source, config, view)
    views = orbit(view, model.position, request.frames)
    codes = background_codes(config, background)
    jobs = [Job(model, view, codes) for view in views]
    expected = [engines.golden(config, job) for job in jobs]
    for each, frame in zip(views, expected, strict=True):
        note_empty(source, each, frame.counts)
    run = simulated(config, jobs, request, expected[0], f"simulating {source.name}")
    for k, frame in enumerate(run.frames):
        if frame.pixels is not None:
            write_png(numbered(output, k, request.frames), frame.pixels)
    if not run.done:
        console.print(f"the machine failed: {run.why}", soft_wrap=True)
        raise typer.Exit(1)
    convention = replace(SPLATCORE, background=background)
    metrics = []
    for k, (frame, view) in enumerate(zip(run.frames, views, strict=True)):
        exact = engines.truths(source, model, view, convention)
        metrics.append(differences(frame.pixels, exact))
        if k == 0 and request.error_map:
            title = f"{source.name}: hardware against the reference on the same packed model"
            write_error_map(request.error_map, frame.pixels, exact["machine"], title)
    if source.packed:
        console.print(packing_line(source), soft_wrap=True)
    console.print(describe.antialiased_line(source), soft_wrap=True)
    same = report(config, run, expected, metrics, output)
    seconds = round(time.perf_counter() - begin, 3)
    result = Result(
        "rtl", config.name, source.name, camera or view.name, (view.width, view.height), seconds,
        expected[0].counts, packing=packing(source), identical=all(same), **source.stated,
        **against(metrics[0]),
    )  # fmt: skip
    write_json(json, facts(run, result, metrics, same, find_timing(request.timing).name))
    if not result.identical:
        raise typer.Exit(1)


def simulated(
    config: Config, jobs: "list[Job]", request: Request, first: "pipeline.Frame", label: str
) -> "Run":
    """Simulate the jobs, with waveforms if requested.

    first: the golden model's frame of the first job
    """
    from splatcore.sim.machine.path import build, simulate
    from splatcore.sim.machine.wave_kind import check_kind
    from splatcore.sim.machine.waves import Window, write_waves

    timing = find_timing(request.timing)
    if not request.waves:
        return simulate(build(config), jobs, timing, label)
    window = Window.of(config, request.window, request.tile, first)
    machine = build(config, check_kind(request.waves))
    recording = planned(config, machine, window, request, first)
    return write_waves(machine, jobs, timing, recording, label)


def planned(
    config: Config, machine: "Machine", window: "Window", request: Request, first: "pipeline.Frame"
) -> "Recording":
    """Plan the recording and print its estimated size; raise InputError if it is too large."""
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.machine.wave_kind import DEEPEST, check_kind
    from splatcore.sim.machine.wave_names import find_scope, within
    from splatcore.sim.machine.wave_size import estimate
    from splatcore.sim.machine.waves import Recording, names_of

    found, names = frame_cycles(config, first, find_timing(request.timing)), names_of(machine)
    recording = Recording(request.waves, window)
    if request.scope:
        recording = replace(recording, scope=find_scope(names, request.scope), levels=DEEPEST)
    recorded = within(names, recording.scope, recording.levels)
    run = request.frames * (found.preprocessing + found.rendering)
    cycles = window.count(run, found.rendering)
    size = estimate(recorded, cycles, check_kind(request.waves)) / 1e6
    shown = f"{size:.2f}" if size < 10 else f"{size:,.0f}"
    text = f"about {shown} MB, {len(recorded)} signals in {cycles} cycles"
    if size > request.waves_max:
        raise InputError(
            f"--waves {request.waves}: {text} are above --waves-max {request.waves_max:g}; "
            "use --scope, a shorter --window or .fst"
        )
    console.print(f"{request.waves}: {text}", soft_wrap=True)
    return recording


def report(
    config: Config,
    run: "Run",
    expected: "list[pipeline.Frame]",
    metrics: list[dict[str, Difference]],
    output: Path,
) -> list[bool]:
    """Print each frame's errors, the cycles and counters.

    Returns for each frame whether it is identical to the golden model's.
    """
    from splatcore.sim.frame import engines
    from splatcore.sim.machine.diagnosis import diagnose

    same, count = [], len(run.frames)
    for k, (frame, metric) in enumerate(zip(expected, metrics, strict=True)):
        found = diagnose(config, run, k, frame)
        same.append(found is None)
        console.print(
            f"{numbered(output, k, count)}: "
            f"{'identical to the golden model' if found is None else found}; "
            f"against the reference: {metrics_line(metric)}",
            soft_wrap=True,
        )
    table = {f"cycles, {name}": value for name, value in engines.cycles(run).items()}
    table["fps_at_800mhz"] = table.pop("cycles, fps_at_800mhz")
    last = run.frames[-1]
    table |= last.counters | {"traffic, MB": sum(last.traffic.values()) / 1e6}
    console.print(describe.table(table))
    return same


def facts(
    run: "Run", result: Result, metrics: list[dict[str, Difference]], same: list[bool], timing: str
) -> dict:
    """Return the content of `--json` for a run."""
    from splatcore.sim.frame import engines

    found = engines.cycles(run)
    result.cycles, result.fps_at_800mhz = found["frame"], found["fps_at_800mhz"]
    result.traffic_bytes = run.frames[-1].traffic
    frames = [
        against(metric) | {"identical": identical, "counters": frame.counters}
        | {"started": frame.started, "ready": frame.ready, "finished": frame.finished}
        for frame, metric, identical in zip(run.frames, metrics, same, strict=True)
    ]  # fmt: skip
    halves = {"preprocessing": found["preprocessing"], "rendering": found["rendering"]}
    return asdict(result) | {"timing": timing, "halves": halves, "frames": frames}


def numbered(path: Path, k: int, count: int) -> Path:
    """Return the path of frame k of `count`: OUT.png for a single one, else OUT-000.png etc."""
    return path if count == 1 else path.with_name(f"{path.stem}-{k:03}{path.suffix}")
