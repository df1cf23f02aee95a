"""The command `render`: one picture by an engine, or one per camera of a file."""

import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from splatcore.app.cli import describe, options, path
from splatcore.app.cli import render_path as along
from splatcore.app.cli.bench import SchedulerOption
from splatcore.app.cli.options import option
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, write_json
from splatcore.sim.frame.metric import Difference, Result, against, metrics_line
from splatcore.sim.frame.picture import error_picture, write_heat_map, write_png
from splatcore.sim.frame.shot import ENGINES, Shot, judge
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

OutputOption = option(
    Path | None,
    "OUT.png|DIR",
    "Picture to write; with --cameras a folder, with one ID.png per camera.",
    "-o",
    panel=options.OUTPUT,
)
OriginalOption = option(
    bool,
    None,
    "With --engine reference: 3σ tile bounds, as in the original renderer.",
    "--original",
    panel=options.PICTURE,
)
CompareOption = option(
    bool,
    None,
    "With --engine golden: compare with the reference, which takes longer than the picture.",
    "--compare/--no-compare",
    panel=options.PICTURE,
)
HeatMapOption = option(
    Path | None,
    "FILE.png",
    "With --engine reference: draw the number of splats per tile.",
    panel=options.OUTPUT,
)


@options.app.command("render")
def render_command(
    scene: options.SourceArgument,
    view: options.Cameras,
    output: OutputOption = None,
    engine: options.EngineOption = "reference",
    preset: options.PresetOption = "DEFAULT",
    original: OriginalOption = False,
    background: options.BackgroundOption = "0,0,0",
    heat_map: HeatMapOption = None,
    compare: CompareOption = True,
    video: along.VideoOption = None,
    fps: along.RateOption = 30,
    beside: along.BesideOption = None,
    scheduler: SchedulerOption = None,
    json: options.JsonOption = None,
):
    """Render a picture, or one per camera, and count the work in it.

    A picture of the golden model is compared with the reference's of the same packed model
    ("machine") and of the original scene ("scene"). --engine rtl is `splatcore simulate`, which has
    more options. --cameras renders one picture per camera, packs the scene once, and prints a table
    with minimum, mean and maximum; --video makes a video of them.
    """
    path.check(view, scheduler)
    check_engine(engine, bool(original or heat_map), compare)
    film = along.Film(video, fps, beside)
    film.check(view.cameras, engine, compare)
    if not (output or video):
        raise InputError("-o: is missing; it names the picture to write")
    convention = replace(
        ORIGINAL if original else SPLATCORE, background=options.parse_colour(background)
    )
    machine = {"config": find_preset(preset), "convention": convention}
    if engine == "rtl":
        from splatcore.app.cli import simulate

        return simulate.run(scene, view, simulate.Request(output), json, **machine)
    if not view.cameras:
        return render_one(scene, view, engine, compare, heat_map, output, json, **machine)
    if heat_map:
        raise InputError("--heat-map: goes with one camera")
    shots = path.open_all(scene, view, engine == "golden", **machine)
    along.check_files(film, output, shots, scene, view.cameras)
    pictures = path.along(picture, shots, (engine, compare, beside), scheduler)
    rows = along.written(pictures, shots, film, output)
    write_json(json, path.print_table(shots[0], rows, along.COLUMNS, engine))


def render_one(
    scene: str, view: options.Viewing, engine: str, compare: bool, heat_map: Path | None,
    output: Path, json: Path | None, **machine,
):  # fmt: skip
    """Render one picture, print its counts and write the results."""
    begin = time.perf_counter()
    shot = view.open(scene, **machine)
    result, frame, found = pictured(shot, engine, compare, begin)
    note_empty(shot, frame.counts)
    write_png(output, frame.pixels)
    if engine == "golden" and shot.packed:
        result.packing = shot.packing
        console.print(shot.packing_line, soft_wrap=True)
    if found:
        console.print(f"against the reference: {metrics_line(found)}", soft_wrap=True)
    if heat_map:
        title = f"{shot.source.name}, camera {shot.camera.name}"
        write_heat_map(heat_map, frame.tile_list, title)
    about = {"image": str(output), "seconds": result.seconds} | shot.source.stated
    describe.table(about | frame.counts).print()
    result.camera = view.camera or shot.camera.name
    write_json(json, result)


def picture(shot: Shot, engine: str, compare: bool, beside: str | None) -> dict:
    """Worker: render a frame; return its row with `pixels` and the `beside` picture, if any.

    The row's seconds exclude packing and comparison.
    beside: of `render_path.BESIDE`, or None
    """
    if engine == "golden":
        _ = shot.model
    made, right = pictured(shot, engine, compare), None
    if engine == "golden":
        made.result.packing = shot.packing if compare else shot.packing_size
    if beside:
        right = shot.reference
        right = error_picture(made.frame.pixels, right) if beside == "error" else right
    return vars(made.result) | {"pixels": made.frame.pixels, "beside": right}


class Pictured(NamedTuple):
    """A frame of the golden model or the reference, and its differences from the reference's."""

    result: Result
    frame: object
    found: dict[str, Difference]


def pictured(shot: Shot, engine: str, compare: bool, begin: float | None = None) -> Pictured:
    """Render a frame; compare the golden model's with the reference.

    begin: start of the measured seconds (`time.perf_counter`); None: now
    """
    from splatcore.sim.frame import engines

    begin, golden = begin or time.perf_counter(), engine == "golden"
    frame = engines.ENGINES[engine](shot)
    seconds = round(time.perf_counter() - begin, 3)
    found = judge(frame, shot) if golden and compare else {}
    result = Result(
        engine, shot.config.name, shot.source.name, shot.camera.name, shot.size, seconds,
        frame.counts, **shot.source.stated, **against(found),
    )  # fmt: skip
    return Pictured(result, frame, found)


def check_engine(engine: str, reference_only: bool, compare: bool):
    """Raise InputError for an unknown engine, or an option that it does not have.

    reference_only: an option of the reference renderer was given
    """
    check_known("--engine", ENGINES, engine)
    if engine != "reference" and reference_only:
        raise InputError(f"--engine {engine}: no --original, no --heat-map")
    if engine != "golden" and not compare:
        raise InputError(f"--engine {engine}: no --no-compare")
