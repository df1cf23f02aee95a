"""The command `cycles`: cycles of a frame by stage, from the cycle model."""

from itertools import takewhile
from pathlib import Path

from splatcore.app.cli import describe, options, path
from splatcore.app.cli.bench import SchedulerOption
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.frame.metric import against, decibels, differences
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import Source, View, check_fits
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

FPS = f"FPS at {CLOCK_HZ / 1e6:.0f} MHz"
"""Label of the frames per second."""

TRUTHS = ("machine", "scene")

COLUMNS = {name: path.cell(name, scale=1000) for name in ("preprocessing", "rendering", "frame")}
COLUMNS |= {FPS: path.cell("fps", form=".1f")} | path.ERRORS
"""Columns of a table of cameras."""

SceneArgument = options.argument(
    list[str], "SCENE|MODEL …", "Scenes or models to render; a single one with --cameras."
)


@options.app.command("cycles")
def cycles_command(
    scene: SceneArgument,
    camera: options.NextCameraOption = None,
    cameras: options.CamerasOption = None,
    size: options.SizeOption = None,
    antialiased: options.AntialiasedOption = None,
    axes: options.AxesOption = None,
    near: options.NearOption = None,
    preset: options.PresetOption = "DEFAULT",
    quality: options.QualityOption = None,
    scheduler: SchedulerOption = None,
    json: options.JsonOption = None,
):
    """Estimate a frame's cycles by stage, and measure its error.

    The cycle model uses the golden model's counts and agrees with the RTL within 3 % for each
    single stage; preprocessing and rendering include the latency of LPDDR4, not its bandwidth. The
    picture is compared with the reference's of the same packed model ("machine") and of the
    original scene ("scene"). --cameras prints one row per camera, and minimum, mean and maximum;
    the default quality is then chosen from up to four of the cameras.
    """
    options.check_quality(quality, *scene)
    path.check(camera, cameras, scheduler)
    config, facts = find_preset(preset), {}
    reading = Reading(antialiased, axes, near)
    if cameras:
        if len(scene) > 1:
            raise InputError("--cameras: needs a single SCENE")
        source, views = path.open_all(cameras, size, scene[0], reading, config)
        quality = quality or path.quality_of(source, config, views)
        rows = list(path.along(measured, source, views, (config, quality), scheduler))
        about = {"preset": config.name, "scene": source.name}
        write_json(json, about | path.print_table(source, rows, COLUMNS, "cycles / 1000"))
        return
    for text in scene:
        with progress_bar(f"reading {text}"):
            source, view = View(text, size=size, file=camera, reading=reading).open()
            check_fits(config, view.width, view.height)
        facts[text] = measured(source, view, config, quality)
        note_empty(source, view, facts[text]["counts"])
        console.print(f"{source.name}: {describe.antialiased_line(source)}", soft_wrap=True)
        if source.packed:
            from splatcore.sim.frame.choose import packing_line

            console.print(f"{source.name}: {packing_line(source)}", soft_wrap=True)
    table = new_table("cycles / 1000", [Path(text).name.split(".")[0] for text in scene])
    for name in takewhile(lambda key: key != "fps", next(iter(facts.values()))):
        table.add_row(name, *(shown(row[name], ",.0f", 1000) for row in facts.values()))
    table.add_row(FPS, *(f"{row['fps']:.1f}" for row in facts.values()))
    for name in TRUTHS:
        table.add_row(f"dB, {name}", *(decibels(row, name) for row in facts.values()))
    print_whole(table)
    write_json(json, {"preset": config.name, "scenes": facts})


def measured(source: Source, view: Camera, config: Config, quality: str | None) -> dict:
    """Return a picture's cycles by stage, frames per second, counts and errors, and the packing of
    a scene."""
    from splatcore.golden.pipeline import render
    from splatcore.sim.cycles.frame import frame_cycles
    from splatcore.sim.frame.choose import packed_model, packing
    from splatcore.sim.frame.engines import truths

    with progress_bar(f"packing {source.name}"):
        model = packed_model(source, config, view, quality)
    with progress_bar(f"rendering {source.name}"):
        frame = render(config, model, view)
    exact, found = truths(source, model, view), frame_cycles(config, frame)
    facts = found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)}
    facts |= against(differences(frame.pixels, exact)) | {"counts": frame.counts}
    facts |= source.stated
    return facts | ({"packing": packing(source, exact)} if source.packed else {})
