"""`splatcore bench levels`: cycles and error of a scene with levels of detail.

One camera is moved back along its axis by multiples of the scene's median depth. Each view is
rendered by the golden model at several errors (`Camera.lod_pixels`) and compared with the float64
reference's picture of all Gaussians, and with that of as many Gaussians chosen at random.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from splatcore.golden import reference
from splatcore.golden.pipeline import Frame, render
from splatcore.model.levels.build import with_levels
from splatcore.sim.common.output import progress_bar, write
from splatcore.sim.common.plot import COLOURS, MARKERS, STYLE
from splatcore.sim.common.table import Table
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.metric import LEVELS, psnr
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.frame.shot import Shot
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from splatcore.study.results.fields import columns, facts
from splatcore.study.results.levels import Levels, LevelsRow, Popping

SHOWN = (
    "away lod_pixels gaussians share frame_cycles fps_at_800mhz cycles_share psnr_db_scene "
    "psnr_db_finest psnr_db_decimated"
)
"""Keys of columns."""

INCHES, DOTS_PER_INCH = (9.0, 3.6), 120
SHEET_INCHES = (3.2, 2.0)  # of a picture of the contact sheet


def bench_levels(
    shot: Shot, away: Sequence[float], pixels: Sequence[float], frames: int, folder: Path
) -> dict:
    """Measure all views; write levels.csv, levels.png and pictures.png, and return the content of
    levels.json.

    shot: a scene, not a packed model, and its nearest view
    away: distances by which the camera is moved back, in median depths
    pixels: errors; the first is 0
    frames: of the path from the first to the last distance; 0: no path
    """
    plain, scene, config = shot.model, shot.source.drawn, shot.config
    with progress_bar("merging levels of detail"):
        model, clipped = with_levels(plain, config)
    depth = median_depth(scene, shot.camera)
    cameras = {times: moved_back(shot.camera, times * depth) for times in away}
    pictures: dict[tuple[float, float], np.ndarray] = {}
    rows = list(measured(config, scene, model, cameras, pixels, pictures))
    found = facts(Levels(
        scene=shot.source.name, camera=shot.camera.name, size="x".join(map(str, shot.size)),
        preset=config.name, quality=shot.packed.quality, gaussians=len(scene),
        with_levels=model.count, bytes_ratio=len(model.image) / len(plain.image), clipped=clipped,
        rows=rows, frames=frames,
        popping=list(path(config, model, list(cameras.values()), pixels, frames)),
    ))  # fmt: skip
    write(folder / "levels.csv", table(found).comma_separated().encode())
    write_plot(folder / "levels.png", found["rows"])
    write_sheet(folder / "pictures.png", pictures)
    return found


def median_depth(scene: Scene, camera: Camera) -> float:
    """Return the median depth of the Gaussians in front of a camera, 1 if none is."""
    depths = scene.position @ camera.rotation[2] + camera.translation[2]
    before = depths[depths > camera.near]
    return float(np.median(before)) if len(before) else 1.0


def moved_back(camera: Camera, distance: float) -> Camera:
    """Move a camera back along its axis."""
    return replace(camera, translation=np.add(camera.translation, [0, 0, distance]))


def measured(
    config: Config, scene: Scene, model: PackedModel, cameras: dict[float, Camera],
    pixels: Sequence[float], pictures: dict[tuple[float, float], np.ndarray],
) -> Iterator[LevelsRow]:  # fmt: skip
    """Yield a row for each view and error; add their pictures, by distance and error."""
    with progress_bar("levels", len(cameras) * len(pixels)) as advance:
        for number, (times, camera) in enumerate(cameras.items()):
            finest: LevelsRow | None = None
            for turn, error in enumerate(pixels):
                about = f"moved back {times:g}, {error:g} pixels"
                advance(number * len(pixels) + turn, len(cameras) * len(pixels), about)
                if finest is None:
                    truth = reference.render(scene, camera).pixels
                frame = render(config, model, replace(camera, lod_pixels=error))
                row = row_of(config, frame, times, error, truth)
                if finest is None:
                    finest = row
                row.share = row.gaussians / max(finest.gaussians, 1)
                row.cycles_share = row.frame_cycles / finest.frame_cycles
                pictures[times, error] = frame.pixels
                row.psnr_db_finest = decibels(frame.pixels, pictures[times, pixels[0]])
                if row.share < 1:
                    fewer = reference.render(decimated(scene, row.share), camera).pixels
                    row.psnr_db_decimated = decibels(fewer, truth)
                yield row


def row_of(
    config: Config, frame: Frame, times: float, error: float, truth: np.ndarray
) -> LevelsRow:
    """A frame's row, before it is compared with others."""
    cycles = frame_cycles(config, frame).frame
    return LevelsRow(
        away=times, lod_pixels=error, gaussians=frame.counts["points_read"], share=1.0,
        frame_cycles=cycles, fps_at_800mhz=round(CLOCK_HZ / cycles, 1), cycles_share=1.0,
        psnr_db_scene=decibels(frame.pixels, truth), psnr_db_finest=None, psnr_db_decimated=None,
    )  # fmt: skip


def decibels(pixels: np.ndarray, truth: np.ndarray) -> float | None:
    """PSNR of 8-bit pictures; None if they are equal."""
    return psnr(pixels / LEVELS, truth / LEVELS)


def decimated(scene: Scene, share: float) -> Scene:
    """Choose a share of a scene's Gaussians at random, larger by √(1 / share)."""
    rng = np.random.default_rng(0)
    kept = np.sort(rng.choice(len(scene), max(round(share * len(scene)), 1), replace=False))
    fewer = scene[kept]
    return replace(fewer, scale=fewer.scale / np.sqrt(share))


def path(
    config: Config, model: PackedModel, cameras: Sequence[Camera], pixels: Sequence[float],
    frames: int,
) -> Iterator[Popping]:  # fmt: skip
    """Yield the largest change between neighbouring frames at each error, along a straight path
    from the first camera to the last; nothing for no frames."""
    if not frames:
        return
    ends = cameras[0].translation, cameras[-1].translation
    least = 0.0
    with progress_bar("path", len(pixels) * frames) as advance:
        for turn, error in enumerate(pixels):
            before, change = None, 0.0
            for number, part in enumerate(np.linspace(0, 1, frames)):
                advance(turn * frames + number, len(pixels) * frames, f"path, {error:g} pixels")
                place = (1 - part) * ends[0] + part * ends[1]
                camera = replace(cameras[0], translation=place, lod_pixels=error)
                now = render(config, model, camera).pixels.astype(np.int16)
                if before is not None:
                    change = max(change, float(np.abs(now - before).max()) / LEVELS)
                before = now
            least = least or change
            yield Popping(lod_pixels=error, change_max=change, ratio=change / (least or 1))


def table(found: dict) -> Table:
    """The table of all views."""
    about = f"{found['scene']}, {found['size']}, {found['preset']}"
    return Table.of("levels", about, columns(LevelsRow, SHOWN), found["rows"])


def popping_table(found: dict) -> Table:
    """The table of the path."""
    about = f"{found['frames']} frames from the first view to the last"
    return Table.of(
        "popping", about, columns(Popping, "lod_pixels change_max ratio"), found["popping"]
    )


def write_plot(path: Path, rows: list[dict]):
    """Plot PSNR and cycles of each view over its error; dashed: decimated."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
        quality, speed = figure.subplots(1, 2)
        for number, times in enumerate(dict.fromkeys(row["away"] for row in rows)):
            mine = [row for row in rows if row["away"] == times]
            style = {"color": COLOURS[number], "marker": MARKERS[number]}
            for axes, key, per, dash in (
                (quality, "psnr_db_scene", 1, "-"), (quality, "psnr_db_decimated", 1, "--"),
                (speed, "frame_cycles", 1e6, "-"),
            ):  # fmt: skip
                points = [(row["lod_pixels"], row[key] / per) for row in mine if row[key]]
                label = f"moved back {times:g} median depths" if axes is speed else None
                if points:
                    axes.plot(*zip(*points, strict=True), dash, label=label, **style)
        for axes, text in (
            (quality, "PSNR against all Gaussians, dB (dashed: decimated)"),
            (speed, "M cycles per frame"),
        ):
            axes.set_xlabel("error, pixels")
            axes.set_ylabel(text)
        speed.set_ylim(bottom=0)
        speed.legend()
        write_figure(path, figure)


def write_sheet(path: Path, pictures: dict[tuple[float, float], np.ndarray]):
    """Write the pictures: a row per view, a column per error."""
    lines, across = (list(dict.fromkeys(key)) for key in zip(*pictures, strict=True))
    size = SHEET_INCHES[0] * len(across), SHEET_INCHES[1] * len(lines)
    with matplotlib.rc_context(STYLE):
        figure = Figure(size, DOTS_PER_INCH, layout="constrained")
        grid = figure.subplots(len(lines), len(across), squeeze=False)
        for (times, error), pixels in pictures.items():
            axes = grid[lines.index(times)][across.index(error)]
            axes.imshow(pixels)
            axes.set_axis_off()
            axes.set_title(f"moved back {times:g}, {error:g} pixels")
        write_figure(path, figure)
