"""`splatcore render --cameras`: a picture of each camera, a video of all."""

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from splatcore.sim.cli import path
from splatcore.sim.cli.options import option, read_by
from splatcore.sim.common.output import check_distinct, check_writable, make_folder
from splatcore.sim.common.picture import write_png
from splatcore.sim.common.source import check_known
from splatcore.sim.common.video import check_encoder, video
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError

BESIDE = ("error", "reference")

VideoOption = option(Path | None, "FILE.mp4", "--cameras: a video of all frames in order.")
RateOption = option(int, "N", "--video: frames a second.", "--fps", min=1, max=240)
BesideOption = option(
    str | None,
    None,
    f"--video, golden: draw {' or '.join(BESIDE)} (of the same packed model) on the right.",
)

COLUMNS = {
    "seconds": path.cell("seconds", form=".2f"),
    "visible": path.cell("counts", "visible"),
    "splats": path.cell("counts", "splats"),
    "pairs": path.cell("counts", "pairs"),
    "contributions": path.cell("counts", "contributions"),
} | path.ERRORS
"""Columns of a table of cameras."""


@dataclass(frozen=True)
class Film:
    """Options that only frames of many cameras have, as the command line gave them."""

    video: Path | None = None
    fps: int = 30
    beside: str | None = None

    def check(self, cameras: str | None, engine: str, compare: bool):
        """InputError for what does not go together, or without the encoder."""
        for name, value in asdict(self).items():
            if value != getattr(Film(), name) and not (self.video and cameras):
                raise InputError(f"--{name}: goes with --cameras{' and --video' * bool(cameras)}")
        if cameras and engine == "rtl":
            raise InputError("--engine rtl: no --cameras; splatcore bench scenes simulates many")
        if self.beside:
            check_known("--beside", BESIDE, self.beside)
            if engine != "golden" or not compare:
                raise InputError("--beside: goes with --engine golden, without --no-compare")
        if self.video:
            check_encoder()


def check_files(film: Film, folder: Path | None, views: list[Camera], scene: str, cameras: str):
    """InputError for pictures that cannot be written or would overwrite an input, and for a video
    of frames of several sizes."""
    if folder and folder.suffix.lower() == ".png":
        raise InputError(f"-o {folder}: names a picture; with --cameras it is a folder")
    inputs = list(read_by({"scene": scene, "cameras": cameras}))
    for view in views if folder else ():
        check_distinct([("-o", picture_path(folder, view))], inputs)
        if folder.is_dir():
            check_writable(picture_path(folder, view))
    first = views[0].width, views[0].height
    for view in views if film.video else ():
        if (view.width, view.height) != first:
            sizes = "{}x{} and {}x{}".format(*first, view.width, view.height)
            raise InputError(f"--video: cameras are of several sizes, {sizes}; --size makes it one")


def picture_path(folder: Path, view: Camera) -> Path:
    """Where the picture of a camera lies."""
    return folder / f"{path.file_name(view)}.png"


def written(pictures, views: list[Camera], film: Film, folder: Path | None) -> list[dict]:
    """Rows of `render.picture`, whose pictures are written as they come."""
    rows = []
    if folder:
        make_folder(folder)
    with ExitStack() as stack:
        add = stack.enter_context(video(film.video, film.fps)) if film.video else None
        for view, row in zip(views, pictures, strict=True):
            pixels, beside = row.pop("pixels"), row.pop("beside")
            if folder:
                write_png(picture_path(folder, view), pixels)
            if add:
                add(pixels if beside is None else np.hstack([pixels, beside]))
            rows.append(row)
    return rows
