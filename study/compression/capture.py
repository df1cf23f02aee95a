"""Capture of a scene: rendered pictures from many views with poses and points in COLMAP's format,
to train on like photographs."""

import tempfile
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from splatcore.model.formats.colmap import Points, read_colmap
from splatcore.model.formats.colmap_write import landing, write_colmap
from splatcore.sim.common.output import make_folder
from splatcore.sim.frame.picture import write_png
from splatcore.sim.frame.shot import Shot
from splatcore.spec.camera import Camera
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene

SHOWN = 0.5
"""Minimum Σ alpha·T over the pixels for a picture to show a Gaussian's point; 0 behind the camera.
"""

IMAGES_OF_POINT = 2  # minimum pictures that show a point: COLMAP cannot get depth from one

IMAGES, SPARSE = "images", Path("sparse", "0")
"""Folders of a capture: pictures; cameras and points."""


def check_empty(folder: Path):
    """Raise InputError if a folder exists and is not empty."""
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty")


@contextmanager
def whole_capture(folder: Path):
    """Yield a temporary folder; on success move its content into `folder`, pictures first.

    So no reader sees an incomplete capture, and a failure leaves nothing.
    """
    make_folder(folder)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".splatcore") as scratch:
            part = Path(scratch)
            (part / IMAGES).mkdir()
            (part / SPARSE).mkdir(parents=True)
            yield part
            for name in (IMAGES, SPARSE.parts[0]):
                (part / name).rename(folder / name)
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}") from None


def stored_cameras(folder: Path, views: Sequence[Camera]) -> list[Camera]:
    """Write the poses of views; return the cameras as read back from the files.

    A pose is stored as a quaternion, which can change its matrix in the last bit. Pictures from
    the returned cameras match the stored poses bit for bit.
    """
    write_colmap(folder / SPARSE, named(views))
    found = [camera for camera, _ in read_colmap(folder)]
    return [replace(camera, name=view.name) for camera, view in zip(found, views, strict=True)]


def named(views: Sequence[Camera]) -> list[tuple[Camera, str]]:
    """Pairs of a view and the file name of its picture."""
    return [(view, f"{view.name}.png") for view in views]


def photograph(shot: Shot) -> dict:
    """Worker: render a frame by the reference.

    Returns `pixels`, `counts`, and `shows`: packed bits [N], Gaussians whose centre is visible.
    """
    from splatcore.golden.reference import render
    from splatcore.model.gradients.drawn import blending_weights

    gaussians, view = shot.source.gaussians, shot.camera
    frame = render(gaussians, view)
    place = landing(view, gaussians.position)
    (light,) = blending_weights(gaussians, [view])
    shows = (light >= SHOWN) & ((place >= 0) & (place < (view.width, view.height))).all(axis=1)
    return {"pixels": frame.pixels, "shows": np.packbits(shows), "counts": frame.counts}


def written(folder: Path, views: Sequence[Camera], rows: Iterable[dict]) -> list[np.ndarray]:
    """Write the pictures of `photograph` as they arrive; return their `shows`."""
    shows = []
    for (_, name), row in zip(named(views), rows, strict=True):
        write_png(folder / IMAGES / name, row["pixels"])
        shows.append(row["shows"])
    return shows


def points_of(
    scene: Scene, shows: Sequence[np.ndarray], count: int, seed: int
) -> tuple[Points, list[np.ndarray]]:
    """Choose Gaussians as COLMAP points.

    shows: of each picture, from `photograph`
    count: maximum number of points
    Returns the points, with colours of harmonics of degree 0, and for each picture the indices of
    the points that it shows. Points are drawn at random among the Gaussians that two pictures
    show, with probability in proportion to opacity × number of these pictures.
    Raises InputError if no Gaussian is in two pictures.
    """
    least = min(IMAGES_OF_POINT, len(shows))
    table = [np.unpackbits(each, count=len(scene)).astype(bool) for each in shows]
    pictures = np.sum(table, axis=0)
    found = np.flatnonzero(pictures >= least)
    if not len(found):
        raise InputError(f"{scene.name}: no Gaussian is in {least} of the photographs")
    weight = scene.opacity[found] * pictures[found]
    rng = np.random.default_rng(seed)
    count = min(count, len(found))
    chosen = np.sort(rng.choice(found, count, replace=False, p=weight / weight.sum()))
    colour = np.rint(np.clip(scene.sh[chosen, 0] * SH_C0 + COLOUR_OFFSET, 0, 1) * 255)
    points = scene.position[chosen], colour.astype(np.uint8)
    return points, [np.flatnonzero(each[chosen]) for each in table]
