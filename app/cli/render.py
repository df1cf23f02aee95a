"""The command `render`: one picture by an engine, or one per camera of a file."""

import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.app.cli import describe, options, path
from splatcore.app.cli.background import Background
from splatcore.app.cli.options import inputs_of, option
from splatcore.app.cli.video import check_encoder, video
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import (
    check_distinct,
    check_writable,
    console,
    make_folder,
)
from splatcore.sim.common.table import Column
from splatcore.sim.frame.metric import Difference, Result, against, metrics_line
from splatcore.sim.frame.picture import error_picture, write_heat_map, write_png
from splatcore.sim.frame.shot import ENGINES, Shot, judge
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.error import InputError

BESIDE = ("error", "reference")
"""Values of --beside: the second picture in each frame of a video."""

VIDEO = "Video"

COLUMNS = [Column("seconds", digits=2)]
COLUMNS += [
    Column(name, digits=0, get=f"counts.{name}")
    for name in ("visible", "splats", "pairs", "contributions")
]
COLUMNS += path.ERRORS
"""Columns of a table of cameras."""


@dataclass(frozen=True)
class Film:
    """The options of videos."""

    video: Path | None = option(
        None, "FILE.mp4", "With --cameras: video of all pictures, in order.", panel=VIDEO
    )
    fps: int = option(30, "N", "Frames per second.", min=1, max=240, panel=VIDEO)
    beside: str | None = option(
        None,
        "NAME",
        f"With --engine golden: also draw {' or '.join(BESIDE)} (same packed model) on the right.",
        panel=VIDEO,
    )

    def check(self, cameras: str | None, engine: str, compare: bool, rgba: bool):
        """Raise InputError for options that do not go together, or a missing encoder."""
        for name, value in asdict(self).items():
            if value != getattr(Film, name) and not (self.video and cameras):
                raise InputError(f"--{name}: goes with --cameras{' and --video' * bool(cameras)}")
        if cameras and engine == "rtl":
            raise InputError("--engine rtl: no --cameras; use splatcore bench scenes")
        if self.beside:
            check_known("--beside", BESIDE, self.beside)
            if engine != "golden" or not compare:
                raise InputError("--beside: goes with --engine golden, without --no-compare")
        if self.video:
            if rgba:
                raise InputError("--rgba: no --video")
            check_encoder()


@options.command("render")
def render_command(
    view: options.Cameras,
    film: Film,
    background: Background,
    scene: str = options.SOURCE,
    output: Path | None = option(
        None,
        "OUT.png|DIR",
        "Picture to write; with --cameras a folder, with one ID.png per camera.",
    ),
    engine: str = options.ENGINE,
    config: Config = options.PRESET,
    original: bool = option(
        False,
        None,
        "With --engine reference: 3σ tile bounds, as in the original renderer.",
        panel=options.PICTURE,
    ),
    heat_map: Path | None = option(
        None, "FILE.png", "With --engine reference: draw the number of splats per tile."
    ),
    compare: bool = option(
        True,
        None,
        "With --engine golden: compare with the reference, which takes longer than the picture.",
        "--compare/--no-compare",
        panel=options.PICTURE,
    ),
    scheduler: str | None = options.SCHEDULER,
) -> dict:
    """Render a picture, or one per camera, and count the work in it.

    A picture of the golden model is compared with the reference's of the same packed model
    ("machine") and of the original scene ("scene"). --engine rtl is `splatcore simulate`, which has
    more options. --cameras renders one picture per camera, packs the scene once, and prints a table
    with minimum, mean and maximum; --video makes a video of them.
    """
    path.check(view, scheduler)
    check_engine(engine, bool(original or heat_map), compare)
    film.check(view.cameras, engine, compare, background.rgba)
    if not (output or film.video):
        raise InputError("-o: is missing; it names the picture to write")
    machine = background.shot(config, engine, ORIGINAL if original else SPLATCORE)
    if engine == "rtl":
        from splatcore.app.cli import simulate

        return simulate.run(scene, view, simulate.Request(output), **machine)
    if not view.cameras:
        return render_one(scene, view, engine, compare, heat_map, output, **machine)
    if heat_map:
        raise InputError("--heat-map: goes with one camera")
    shots = path.open_all(scene, view, engine == "golden", **machine)
    check_files(film, output, shots, scene, view.cameras)
    pictures = path.along(picture, shots, (engine, compare, film.beside), scheduler)
    rows = written(pictures, shots, film, output)
    return path.print_table(shots[0], rows, COLUMNS, engine)


def render_one(
    scene: str, view: options.Viewing, engine: str, compare: bool, heat_map: Path | None,
    output: Path, **machine,
) -> Result:  # fmt: skip
    """Render one picture, print its counts and return the results."""
    begin = time.perf_counter()
    shot = view.open(scene, **machine)
    result, frame, found = pictured(shot, engine, compare, begin)
    note_empty(shot, frame.counts)
    write_png(output, frame.pixels)
    if engine == "golden" and shot.packed:
        result.packing = shot.packing
        console.print(shot.packing_line)
    if found:
        console.print(f"against the reference: {metrics_line(found)}")
    if heat_map:
        title = f"{shot.source.name}, camera {shot.camera.name}"
        write_heat_map(heat_map, frame.tile_list, title)
    about = {"image": str(output), "seconds": result.seconds} | shot.source.stated
    describe.table(about | frame.counts).print()
    result.camera = view.camera or shot.camera.name
    return result


def picture(shot: Shot, engine: str, compare: bool, beside: str | None) -> dict:
    """Worker: render a frame; return its row with `pixels` and the `beside` picture, if any.

    The row's seconds exclude packing and comparison.
    beside: of `BESIDE`, or None
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


def check_files(film: Film, folder: Path | None, shots: list[Shot], scene: str, cameras: str):
    """Raise InputError for pictures that cannot be written or would overwrite an input, and for a
    video with frames of several sizes."""
    if folder and folder.suffix.lower() == ".png":
        raise InputError(f"-o {folder}: names a picture; with --cameras it is a folder")
    inputs = list(inputs_of({"scene": scene, "cameras": cameras}))
    for shot in shots if folder else ():
        check_distinct([("-o", picture_path(folder, shot.camera))], inputs)
        if folder.is_dir():
            check_writable(picture_path(folder, shot.camera))
    for shot in shots if film.video else ():
        if shot.size != shots[0].size:
            sizes = "{}x{} and {}x{}".format(*shots[0].size, *shot.size)
            raise InputError(f"--video: cameras have several sizes, {sizes}; use --size")


def picture_path(folder: Path, view: Camera) -> Path:
    """Return the path of a camera's picture."""
    return folder / f"{path.file_name(view)}.png"


def written(pictures, shots: list[Shot], film: Film, folder: Path | None) -> list[dict]:
    """Write the pictures of `render.picture` as they come; return the rows without them."""
    rows = []
    if folder:
        make_folder(folder)
    with ExitStack() as stack:
        add = stack.enter_context(video(film.video, film.fps)) if film.video else None
        for shot, row in zip(shots, pictures, strict=True):
            pixels, beside = row.pop("pixels"), row.pop("beside")
            if folder:
                write_png(picture_path(folder, shot.camera), pixels)
            if add:
                add(pixels if beside is None else np.hstack([pixels, beside]))
            rows.append(row)
    return rows
