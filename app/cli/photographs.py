"""The command `photographs`: pictures of a scene in the form of a COLMAP capture."""

import time
from pathlib import Path

from splatcore.app.cli import options
from splatcore.app.cli.options import option
from splatcore.model.formats.colmap_write import write_colmap
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.size import parse_size, path_cameras
from splatcore.sim.frame.source import Source, check_source, open_source
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.study.compression import capture

SHARE = 0.5


@options.command("photographs")
def photographs_command(
    reading: Reading,
    scene: str = options.ONE_SCENE,
    output: Path = options.NEW_FOLDER,
    views: int = option(100, "N", "Number of photographs.", min=1),
    size: str = option("1920x1080", "WxH", "Pixels of the photographs.", panel=options.SCENE),
    cameras: str | None = option(
        None,
        "FILE",
        "Cameras (cameras.json, transforms.json or COLMAP) on whose path a share of the views is. "
        "Default: all views are from all around.",
        panel=options.SCENE,
    ),
    path_share: float | None = option(
        None,
        "S",
        f"With --cameras: share of the views on the path, 0 … 1. Default: {SHARE}.",
        panel=options.SCENE,
    ),
    points: int = option(10_000, "N", "Maximum number of points.", min=1),
    seed: int = option(0, "N", "Random seed of views and points.", min=0),
    scheduler: str | None = options.SCHEDULER,
) -> dict:
    """Render a scene as photographs: pictures, poses and points.

    Writes a COLMAP folder for `train` and `compress --images`, which must be new or empty:
    images/ has 8-bit pictures of the float64 reference, sparse/0 cameras, poses and points in
    binary. Views are from all around; with --cameras also along the path of the given cameras, but
    not from the cameras themselves. Points are the exact centres of random Gaussians that at least
    two views show.
    """
    begin, pixels = time.perf_counter(), parse_size(size)
    given = _given(cameras, path_share, size)
    capture.check_empty(output)
    check_source(scene, reading)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, reading)
        original = source.unpacked
        planned = reading.seen(_views(source, views, pixels, seed, given, path_share))
    from splatcore.app.cli.path import along

    with capture.whole_capture(output) as part:
        taken = capture.stored_cameras(part, planned)
        shots = [Shot(source, camera) for camera in taken]
        rows = along(capture.photograph, shots, scheduler=scheduler)
        shows = capture.written(part, taken, rows)
        found, shown = capture.points_of(original, shows, points, seed)
        write_colmap(part / capture.SPARSE, capture.named(planned), found, shown)
    on_path = sum(view.name.startswith("path") for view in planned)
    facts = {
        "scene": scene, "folder": str(output), "size": list(pixels), "photographs": views,
        "on_path": on_path, "around": views - on_path, "points": len(found[0]),
        "observations": sum(map(len, shown)), "seed": seed, **source.stated,
        "seconds": round(time.perf_counter() - begin, 3),
    }  # fmt: skip
    where = f"{on_path} on the path, {views - on_path} from all around"
    text = f"{views} photographs of {pixels[0]}x{pixels[1]} ({where}), {len(found[0])} points"
    console.print(f"{output}: {text}")
    return facts


def _given(cameras: str | None, share: float | None, size: str) -> list[Camera]:
    """Return the resized cameras of --cameras; raise InputError for a wrong --path-share."""
    if share is not None and not cameras:
        raise InputError("--path-share: goes with --cameras")
    if share is not None and not 0 <= share <= 1:
        raise InputError(f"--path-share {share:g}: is not in 0 … 1")
    return path_cameras(cameras, size) if cameras else []


def _views(
    source: Source, count: int, size: tuple[int, int], seed: int, given: list[Camera],
    share: float | None,
) -> list[Camera]:  # fmt: skip
    """Return the views from which a scene is photographed."""
    from splatcore.model.cameras.capture import capture_views

    return capture_views(
        source.gaussians, count, size, seed, given, SHARE if share is None else share
    )
