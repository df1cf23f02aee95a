"""`splatcore render --cameras`: one picture per camera, and a video of them."""

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from splatcore.app.cli import path
from splatcore.app.cli.options import inputs_of, option
from splatcore.app.cli.video import check_encoder, video
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import check_distinct, check_writable, make_folder
from splatcore.sim.common.table import Column
from splatcore.sim.frame.picture import write_png
from splatcore.sim.frame.shot import Shot
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError

BESIDE = ("error", "reference")
"""Values of --beside: the second picture in each frame of a video."""

VIDEO = "Video"

VideoOption = option(
    Path | None, "FILE.mp4", "With --cameras: video of all pictures, in order.", panel=VIDEO
)
RateOption = option(int, "N", "Frames per second.", "--fps", min=1, max=240, panel=VIDEO)
BesideOption = option(
    str | None,
    "NAME",
    f"With --engine golden: also draw {' or '.join(BESIDE)} (same packed model) on the right.",
    panel=VIDEO,
)

COLUMNS = [Column("seconds", digits=2)]
COLUMNS += [
    Column(name, digits=0, get=f"counts.{name}")
    for name in ("visible", "splats", "pairs", "contributions")
]
COLUMNS += path.ERRORS
"""Columns of a table of cameras."""


@dataclass(frozen=True)
class Film:
    """The options of videos, as on the command line."""

    video: Path | None = None
    fps: int = 30
    beside: str | None = None

    def check(self, cameras: str | None, engine: str, compare: bool):
        """Raise InputError for options that do not go together, or a missing encoder."""
        for name, value in asdict(self).items():
            if value != getattr(Film(), name) and not (self.video and cameras):
                raise InputError(f"--{name}: goes with --cameras{' and --video' * bool(cameras)}")
        if cameras and engine == "rtl":
            raise InputError("--engine rtl: no --cameras; use splatcore bench scenes")
        if self.beside:
            check_known("--beside", BESIDE, self.beside)
            if engine != "golden" or not compare:
                raise InputError("--beside: goes with --engine golden, without --no-compare")
        if self.video:
            check_encoder()


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
