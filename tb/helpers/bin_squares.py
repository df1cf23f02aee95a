"""The 3σ squares of splats in float64, and the tiles that binning has against theirs."""

import numpy as np

from splatcore.golden.bin import Binned
from splatcore.spec.config import Config
from splatcore.spec.convention import SIGMA_EXTENT, TILE
from tb.helpers.bin_frames import Ellipses, Frame, found_tiles


def radii(covariance: np.ndarray) -> np.ndarray:
    """Half sides [N] for covariances [N, 3] xx, xy, yy."""
    xx, xy, yy = covariance.T
    return SIGMA_EXTENT * np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))


def covariances(conic: np.ndarray) -> np.ndarray:
    """Covariances [N, 3] xx, xy, yy of conics [N, 3] A, B, C."""
    a, b, c = conic.T
    return np.stack([c, -b, a], axis=1) / (a * c - b * b)[:, None]


def square_tiles(centre: np.ndarray, radius: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Tiles [N, 4] x0, x1, y0, y1 with a pixel's centre in the square; x1 < x0 if there is none.

    centre [N, 2] and radius [N] in pixels, size of the image.
    """
    last = np.array(size) - 1
    low = np.ceil(np.maximum(centre - radius[:, None], 0))
    high = np.floor(np.minimum(centre + radius[:, None], last))
    boxes = np.stack([low // TILE, high // TILE], axis=2).reshape(-1, 4).astype(np.int64)
    boxes[(low > high).any(axis=1)] = [0, -1, 0, -1]
    return boxes


def found_boxes(config: Config, frame: Frame, found: Binned) -> np.ndarray:
    """The same [N, 4] of the tiles that binning has, all of which must fill their box."""
    boxes = np.tile(np.array([1 << 30, -1, 1 << 30, -1]), (len(frame), 1))
    splat, row, column = found_tiles(config, frame, found)
    for k, tile in enumerate((column, row)):
        np.minimum.at(boxes[:, 2 * k], splat, tile)
        np.maximum.at(boxes[:, 2 * k + 1], splat, tile)
    count = np.bincount(splat, minlength=len(frame))
    boxes[count == 0] = [0, -1, 0, -1]
    assert (areas(boxes) == count).all()
    return boxes


def areas(boxes: np.ndarray) -> np.ndarray:
    """Tiles in boxes [N, 4]."""
    return (boxes[:, 1] - boxes[:, 0] + 1) * (boxes[:, 3] - boxes[:, 2] + 1)


def compare_squares(
    config: Config, frame: Frame, found: Binned,
    centre: np.ndarray | None = None, radius: np.ndarray | None = None,
    splats: np.ndarray | None = None,
) -> tuple[int, int]:  # fmt: skip
    """Pairs of squares and tiles that touch, and squares of which binning lacks a tile.

    centre [M, 2] and radius [M] in pixels are those of splats [M], numbers in the frame; what the
    splats' own conics say, of all, if they are not given.
    """
    if centre is None:
        ellipses = Ellipses.of(config, frame.splats)
        centre, radius = ellipses.centre, radii(covariances(ellipses.conic))
    boxes = found_boxes(config, frame, found)
    boxes = boxes if splats is None else boxes[splats]
    exact = square_tiles(centre, radius, (frame.width, frame.height))
    lacking = (exact[:, [0, 2]] < boxes[:, [0, 2]]) | (exact[:, [1, 3]] > boxes[:, [1, 3]])
    return int(areas(exact).sum()), int((lacking.any(axis=1) & (areas(exact) > 0)).sum())
