"""The command `render`: one picture by an engine, or one per camera of a file."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from splatcore.app.cli import describe, options, path
from splatcore.app.cli import render_path as along
from splatcore.app.cli import render_rtl as rtl
from splatcore.app.cli.bench import SchedulerOption
from splatcore.app.cli.options import option
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.frame.metric import Difference, Result, against, differences, metrics_line
from splatcore.sim.frame.picture import error_picture, write_heat_map, write_png
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import ENGINES, Source, open_cameras, open_source
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import ORIGINAL, SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

if TYPE_CHECKING:
    from splatcore.golden import pipeline as golden
    from splatcore.golden import reference

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
BackgroundOption = option(str, "R,G,B", "Background colour, each 0 … 1.", panel=options.PICTURE)
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


class Settings(NamedTuple):
    """The options that decide on a picture, in addition to scene and camera."""

    engine: str
    config: Config
    convention: Convention
    compare: bool


@options.app.command("render")
def render_command(
    scene: options.SourceArgument,
    output: OutputOption = None,
    camera: options.CameraOption = None,
    cameras: options.CamerasOption = None,
    size: options.SizeOption = None,
    antialiased: options.AntialiasedOption = None,
    axes: options.AxesOption = None,
    near: options.NearOption = None,
    engine: options.EngineOption = "reference",
    preset: options.PresetOption = "DEFAULT",
    original: OriginalOption = False,
    background: BackgroundOption = "0,0,0",
    heat_map: HeatMapOption = None,
    compare: CompareOption = True,
    frames: rtl.FramesOption = 1,
    timing: rtl.TimingOption = "lpddr4",
    error_map: rtl.ErrorMapOption = None,
    waves: rtl.WavesOption = None,
    window: rtl.WindowOption = None,
    tile: rtl.TileOption = None,
    scope: rtl.ScopeOption = None,
    waves_max: rtl.WavesMaxOption = rtl.WAVES_MAX,
    video: along.VideoOption = None,
    fps: along.RateOption = 30,
    beside: along.BesideOption = None,
    scheduler: SchedulerOption = None,
    json: options.JsonOption = None,
):
    """Render a picture, or one per camera, and count the work in it.

    A picture of the machine (golden, rtl) is compared with the reference's of the same packed model
    ("machine") and of the original scene ("scene"). --engine rtl simulates the hardware, prints its
    cycles, and exits with status 1 if a pixel differs from the golden model's. --cameras renders
    one picture per camera, packs the scene once, and prints a table with minimum, mean and maximum;
    --video makes a video of them.
    """
    path.check(camera, cameras, scheduler)
    check_engine(engine, bool(original or heat_map), compare)
    request = rtl.Request(frames, timing, error_map, waves, window, tile, scope, waves_max)
    film = along.Film(video, fps, beside)
    film.check(cameras, engine, compare)
    if not (output or video):
        raise InputError("-o: is missing; it names the picture to write")
    request.check(engine, output)
    config = find_preset(preset)
    convention = replace(ORIGINAL if original else SPLATCORE, background=parse_colour(background))
    settings = Settings(engine, config, convention, compare)
    reading = Reading(antialiased, axes, near)
    if not cameras:
        return render_one(scene, reading, camera, size, settings, request, heat_map, output, json)
    if heat_map:
        raise InputError("--heat-map: goes with one camera")
    return render_all(scene, reading, cameras, size, settings, film, output, scheduler, json)


def render_one(
    scene: str, reading: Reading, camera: str | None, size: str | None, settings: Settings,
    request: rtl.Request, heat_map: Path | None, output: Path, json: Path | None,
):  # fmt: skip
    """Render one picture, print its counts and write the results."""
    begin = time.perf_counter()
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, reading)
        (view,) = open_cameras(camera, None, size, source)
    from splatcore.sim.frame.choose import packing_line

    if settings.engine == "rtl":
        config, colour = settings.config, settings.convention.background
        return rtl.render_rtl(source, view, camera, config, colour, request, output, json)
    made = pictured(source, view, settings, begin=begin)
    result, frame = made.result, made.frame
    note_empty(source, view, frame.counts)
    write_png(output, frame.pixels)
    if result.packing:
        console.print(packing_line(source), soft_wrap=True)
    if made.found:
        console.print(f"against the reference: {metrics_line(made.found)}", soft_wrap=True)
    if heat_map:
        write_heat_map(heat_map, frame.tile_list, f"{source.name}, camera {view.name}")
    about = {"image": str(output), "seconds": result.seconds} | source.stated
    console.print(describe.table(about | frame.counts))
    result.camera = camera or view.name
    write_json(json, result)


def render_all(
    scene: str, reading: Reading, cameras: str, size: str | None, settings: Settings,
    film: along.Film, output: Path | None, scheduler: str | None, json: Path | None,
):  # fmt: skip
    """Render one picture per camera, print a table and write the results."""
    engine, config = settings.engine, settings.config
    golden = engine == "golden"
    source, views = path.open_all(cameras, size, scene, reading, config if golden else None)
    along.check_files(film, output, views, scene, cameras)
    quality = path.quality_of(source, config, views) if golden else None
    pictures = path.along(picture, source, views, (settings, quality, film.beside), scheduler)
    rows = along.written(pictures, views, film, output)
    write_json(json, path.print_table(source, rows, along.COLUMNS, engine))


def picture(
    source: Source, view: Camera, settings: Settings, quality: str | None, beside: str | None
) -> dict:
    """Worker: render one view; return its row with `pixels` and the `beside` picture, if any.

    The row's seconds exclude packing and comparison.
    beside: of `render_path.BESIDE`, or None
    """
    from splatcore.sim.frame.choose import packed_model

    if settings.engine == "golden":
        packed_model(source, settings.config, view, quality)
    made, right = pictured(source, view, settings, quality), None
    if made.result.packing and not made.exact:
        del made.result.packing["psnr_db_packing"]  # measured for another view
    if beside:
        right = made.exact["machine"]
        right = error_picture(made.frame.pixels, right) if beside == "error" else right
    return vars(made.result) | {"pixels": made.frame.pixels, "beside": right}


@dataclass(frozen=True)
class Pictured:
    """A frame of the golden model or the reference.

    exact: pictures of the reference that the golden model's is compared with, by name
    found: the differences, by the same names
    """

    result: Result
    frame: "golden.Frame | reference.Frame"
    exact: dict[str, np.ndarray]
    found: dict[str, Difference]


def pictured(
    source: Source, view: Camera, settings: Settings, quality: str | None = None,
    begin: float | None = None,
) -> Pictured:  # fmt: skip
    """Render a view and compare it with the reference.

    begin: start of the measured seconds (`time.perf_counter`); None: now
    """
    from splatcore.sim.frame.choose import packed_model, packing
    from splatcore.sim.frame.engines import golden_of, reference, truths

    engine, config, convention, compare = settings
    begin, exact = begin or time.perf_counter(), {}
    if engine == "golden":
        frame = golden_of(source, view, config, convention.background, quality)
    else:
        frame = reference(source.gaussians, view, convention)
    seconds = round(time.perf_counter() - begin, 3)
    if engine == "golden" and compare:
        model = packed_model(source, config, view, quality)
        exact = truths(source, model, view, convention)
    found = differences(frame.pixels, exact)
    result = Result(
        engine, config.name, source.name, view.name, (view.width, view.height), seconds,
        frame.counts, packing=packing(source, exact), **source.stated, **against(found),
    )  # fmt: skip
    return Pictured(result, frame, exact, found)


def check_engine(engine: str, reference_only: bool, compare: bool):
    """Raise InputError for an unknown engine, or an option that it does not have.

    reference_only: an option of the reference renderer was given
    """
    check_known("--engine", ENGINES, engine)
    if engine != "reference" and reference_only:
        raise InputError(f"--engine {engine}: no --original, no --heat-map")
    if engine != "golden" and not compare:
        raise InputError(f"--engine {engine}: no --no-compare")


def parse_colour(text: str) -> tuple[float, float, float]:
    """Parse three numbers 0 … 1 separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--background '{text}': must be three numbers R,G,B") from None
    if not all(0 <= value <= 1 for value in (red, green, blue)):
        raise InputError(f"--background '{text}': is not in 0 … 1")
    return red, green, blue
