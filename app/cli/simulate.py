"""The command `simulate`: frames of the machine simulated in RTL, and their errors."""

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from splatcore.app.cli import describe, options
from splatcore.app.cli.background import Background
from splatcore.app.cli.options import RTL, option
from splatcore.sim.common.output import check_distinct, check_writable, console
from splatcore.sim.frame.metric import Difference, Result, against, metrics_line
from splatcore.sim.frame.picture import write_error_map, write_png
from splatcore.sim.frame.shot import Shot, judge
from splatcore.sim.frame.unseen import note_empty
from splatcore.sim.machine.script import find_timing
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

if TYPE_CHECKING:
    from splatcore.golden import pipeline
    from splatcore.sim.machine.execute import Saves
    from splatcore.sim.machine.machine import Machine, Run
    from splatcore.sim.machine.waves import Recording, Window

TIMING = option(
    "lpddr4", "NAME", "Memory model: 'ideal', 'lpddr4' (64 bits wide) or 'lpddr4-80' (80 % of its "
    "bandwidth).", panel=RTL,
)  # fmt: skip


@dataclass(frozen=True)
class Request:
    """The options of RTL simulation."""

    output: Path = option(..., "OUT.png", "Picture to write.")
    frames: int = option(
        1, "N", "Number of frames, on a small orbit; pictures are numbered.", panel=RTL
    )
    timing: str = TIMING
    error_map: Path | None = option(
        None, "FILE.png", "Draw an error map of the first frame.", panel=RTL
    )
    waves: Path | None = option(
        None,
        "FILE",
        "Record waveforms of --window or --tile (.vcd or .fst), with .gtkw and .sucl files.",
        panel=RTL,
    )
    window: str | None = option(None, "FIRST:LAST", "Cycles for --waves.", panel=RTL)
    tile: str | None = option(
        None, "COLUMN,ROW", "Tile for --waves: the cycles of its group in frame 0.", panel=RTL
    )
    scope: str | None = option(
        None, "MODULE", "Module for --waves, with everything inside, like raster.setup.", panel=RTL
    )
    waves_max: float = option(1000.0, "MB", "Maximum estimated size of --waves.", panel=RTL)
    save_every: int = option(
        0,
        "N",
        "Save the run every N cycles in OUT.saves (or FILE.saves), and go on from a save there.",
        panel=RTL,
        min=0,
    )
    first: int | None = option(
        None, "CYCLE", "Go on from the last save at or before this cycle.", "--from", panel=RTL
    )

    def check(self):
        """Raise InputError for options that do not go together, or an unwritable output."""
        find_timing(self.timing)
        if self.frames < 1:
            raise InputError(f"--frames {self.frames}: must be 1 or more")
        if bool(self.waves) != bool(self.window or self.tile) or (self.window and self.tile):
            raise InputError("--waves: goes with either --window or --tile")
        if self.scope and not self.waves:
            raise InputError("--scope: goes with --waves")
        if self.tile and self.saving:
            raise InputError("--tile: goes without --save-every and --from; use --window")
        if self.waves:
            from splatcore.sim.machine.wave_files import check_kind

            check_kind(self.waves)
        written = [("-o", self.picture(k)) for k in range(self.frames)]
        check_distinct([*written, *[("--error-map", self.error_map)] * bool(self.error_map)])
        for _, path in written:
            check_writable(path)

    @property
    def saving(self) -> bool:
        """Whether the run is saved, or goes on from a save."""
        return self.save_every > 0 or self.first is not None

    def saves(self, window: "Window | None" = None) -> "Saves | None":
        """Return where the run is saved. window: to record, which must not have begun."""
        from splatcore.sim.machine.execute import Saves

        starts = [self.first, window and window.cycles and window.cycles[0]]
        until = min((cycle for cycle in starts if cycle is not None), default=None)
        folder = (self.waves or self.output).with_suffix(".saves")
        needed = self.first is not None
        return Saves(folder, self.save_every, until, needed) if self.saving else None

    def picture(self, k: int) -> Path:
        """Return the path of frame k: OUT.png for a single one, else OUT-000.png etc."""
        path = self.output
        return path if self.frames == 1 else path.with_name(f"{path.stem}-{k:03}{path.suffix}")


@options.command("simulate")
def simulate_command(
    view: options.Viewing,
    request: Request,
    background: Background,
    scene: str = options.SOURCE,
    config: Config = options.PRESET,
) -> dict:
    """Simulate the hardware in RTL: pictures, cycles, waveforms.

    Every frame is compared with the golden model's, to the bit, and with the reference's of the
    same packed model ("machine") and of the original scene ("scene"). Exit status 1 if a pixel
    differs from the golden model's.
    """
    return run(scene, view, request, **background.shot(config, "rtl"))


def run(scene: str, view: options.Viewing, request: Request, **machine) -> dict:
    """Simulate frames in RTL, write and compare them; return the result for --json.

    machine: of `Background.shot`
    """
    request.check()
    shot = view.open(scene, **machine)
    from splatcore.sim.frame import engines
    from splatcore.sim.machine.path import orbit

    begin = time.perf_counter()
    shot.check_fits()
    shots = [
        replace(shot, camera=camera, quality=shot.packed and shot.packed.quality)
        for camera in orbit(shot.camera, shot.model.position, request.frames)
    ]
    expected = [engines.golden(each) for each in shots]
    for each, frame in zip(shots, expected, strict=True):
        note_empty(each, frame.counts)
    done = simulated(shots, request, expected[0])
    for k, frame in enumerate(done.frames):
        if frame.pixels is not None:
            write_png(request.picture(k), frame.pixels)
    if not done.done:
        console.print(f"the machine failed: {done.why}")
        raise typer.Exit(1)
    metrics = [judge(*pair) for pair in zip(done.frames, shots, strict=True)]
    if request.error_map:
        title = f"{shot.source.name}: hardware against the reference on the same packed model"
        write_error_map(request.error_map, done.frames[0].pixels, shots[0].reference, title)
    if shot.packed:
        console.print(shots[0].packing_line)
    console.print(describe.antialiased_line(shot.source))
    same = report(shot, done, expected, metrics, request)
    result = Result(
        "rtl", shot.config.name, shot.source.name, view.camera or shot.camera.name, shot.size,
        round(time.perf_counter() - begin, 3), expected[0].counts, packing=shots[0].packing,
        identical=all(same), **shot.source.stated, **against(metrics[0]),
    )  # fmt: skip
    found = facts(done, result, metrics, same, find_timing(request.timing).name)
    return options.result(found, not result.identical)


def simulated(shots: list[Shot], request: Request, first: "pipeline.Frame") -> "Run":
    """Simulate the frames, with waveforms if requested.

    first: the golden model's frame of the first one
    """
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.machine.path import build, simulate
    from splatcore.sim.machine.wave_files import check_kind
    from splatcore.sim.machine.waves import Window, write_waves

    config, jobs = shots[0].config, [shot.job for shot in shots]
    timing, label = find_timing(request.timing), f"simulating {shots[0].source.name}"
    found = frame_cycles(config, first, timing)
    cycles = found.preprocessing + found.rendering + (len(jobs) - 1) * found.frame
    if not request.waves:
        machine = build(config, cycles=cycles, saves=request.saving)
        return simulate(machine, jobs, timing, label, saves=request.saves())
    window = Window.of(config, request.window, request.tile, first)
    machine = build(config, check_kind(request.waves), saves=request.saving)
    recording = planned(machine, window, request, first)
    return write_waves(machine, jobs, timing, recording, label, saves=request.saves(window))


def planned(
    machine: "Machine", window: "Window", request: Request, first: "pipeline.Frame"
) -> "Recording":
    """Plan the recording and print its estimated size; raise InputError if it is too large."""
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.machine.wave_files import DEEPEST, check_kind, estimate, find_scope, within
    from splatcore.sim.machine.waves import Recording, names_of

    timing, names = find_timing(request.timing), names_of(machine)
    found = frame_cycles(machine.config, first, timing)
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
    console.print(f"{request.waves}: {text}")
    return recording


def report(
    shot: Shot,
    run: "Run",
    expected: "list[pipeline.Frame]",
    metrics: list[dict[str, Difference]],
    request: Request,
) -> list[bool]:
    """Print each frame's errors, the cycles and counters.

    Returns for each frame whether it is identical to the golden model's.
    """
    from splatcore.sim.frame import engines
    from splatcore.sim.machine.diagnosis import diagnose

    same = []
    for k, (frame, metric) in enumerate(zip(expected, metrics, strict=True)):
        found = diagnose(shot.config, run, k, frame)
        same.append(found is None)
        console.print(
            f"{request.picture(k)}: "
            f"{'identical to the golden model' if found is None else found}; "
            f"against the reference: {metrics_line(metric)}"
        )
    table = {f"cycles, {name}": value for name, value in engines.cycles(run).items()}
    table["fps_at_800mhz"] = table.pop("cycles, fps_at_800mhz")
    last = run.frames[-1]
    table |= last.counters | {"traffic, MB": sum(last.traffic.values()) / 1e6}
    describe.table(table).print()
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
