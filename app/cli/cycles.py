"""The command `cycles`: cycles of a frame by stage, from the cycle model."""

from functools import partial
from itertools import takewhile
from pathlib import Path

from splatcore.app.cli import describe, options, path
from splatcore.app.cli.options import argument
from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table, shown
from splatcore.sim.frame.metric import against, decibels
from splatcore.sim.frame.shot import Shot, judge
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.error import InputError

FPS = f"FPS at {CLOCK_HZ / 1e6:.0f} MHz"
"""Label of the frames per second."""

TRUTHS = ("machine", "scene")

HALVES = ("preprocessing", "rendering", "frame")
COLUMNS = [Column(name, digits=0, per=1000) for name in HALVES]
COLUMNS += [Column(FPS, digits=1, get="fps"), *path.ERRORS]
"""Columns of a table of cameras."""


@options.command("cycles")
def cycles_command(
    view: options.NextCameras,
    scene: list[str] = argument(
        ..., "SCENE|MODEL …", "Scenes or models to render; a single one with --cameras."
    ),
    config: Config = options.PRESET,
    quality: str | None = options.QUALITY,
    scheduler: str | None = options.SCHEDULER,
) -> dict:
    """Estimate a frame's cycles by stage, and measure its error.

    The cycle model uses the golden model's counts and agrees with the RTL within 3 % for each
    single stage; preprocessing and rendering include the latency of LPDDR4, not its bandwidth. The
    picture is compared with the reference's of the same packed model ("machine") and of the
    original scene ("scene"). --cameras prints one row per camera, and minimum, mean and maximum;
    the default quality is then chosen from up to four of the cameras.
    """
    options.check_quality(quality, *scene)
    path.check(view, scheduler)
    machine, facts = {"config": config, "quality": quality}, {}
    if view.cameras:
        if len(scene) > 1:
            raise InputError("--cameras: needs a single SCENE")
        shots = path.open_all(scene[0], view, True, **machine)
        rows = list(path.along(measured, shots, scheduler=scheduler))
        about = {"preset": config.name, "scene": shots[0].source.name}
        return about | path.print_table(shots[0], rows, COLUMNS, "cycles / 1000")
    for text in scene:
        shot = view.open(text, **machine)
        shot.check_fits()
        facts[text] = measured(shot)
        note_empty(shot, facts[text]["counts"])
        name = shot.source.name
        console.print(f"{name}: {describe.antialiased_line(shot.source)}")
        if shot.packed:
            console.print(f"{name}: {shot.packing_line}")
    table(facts).print()
    return {"preset": config.name, "scenes": facts}


def table(facts: dict[str, dict]) -> Table:
    """Return a table with one column per scene."""
    names = takewhile(lambda key: key != "fps", next(iter(facts.values())))
    rows = {name: lambda row, name=name: shown(row[name], ",.0f", 1000) for name in names}
    rows |= {FPS: lambda row: f"{row['fps']:.1f}"}
    rows |= {f"dB, {name}": partial(decibels, name=name) for name in TRUTHS}
    scenes = [Column(Path(text).name.split(".")[0], digits=1) for text in facts]
    cells = [[name, *map(show, facts.values())] for name, show in rows.items()]
    return Table("cycles", "", [Column("cycles / 1000"), *scenes], cells)


def measured(shot: Shot) -> dict:
    """Return a frame's cycles by stage, frames per second, counts and errors, and the packing of
    a scene."""
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.frame.engines import golden

    frame = golden(shot)
    with shot.bar("counting cycles"):
        found = frame_cycles(shot.config, frame)
    facts = found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)}
    facts |= against(judge(frame, shot)) | {"counts": frame.counts}
    facts |= shot.source.stated
    return facts | ({"packing": shot.packing} if shot.packed else {})
