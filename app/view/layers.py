"""The layers that the page shows of a view: pictures, error maps, maps of tiles and groups."""

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.group import group_grid, group_pixels

MACHINE, MODEL, SCENE = "machine (golden)", "reference of the model", "reference of the scene"
ERROR_MODEL, ERROR_SCENE = "error against the model", "error against the scene"
TILES, GROUPS = "splats in each tile", "cycles of each group"

LAYERS = (MACHINE, MODEL, SCENE, ERROR_MODEL, ERROR_SCENE, TILES, GROUPS)
"""Names of the layers of a view; a button asks for `RTL`."""

RTL = "machine (RTL)"


def tile_lengths(config: Config, frame: Frame) -> np.ndarray:
    """Return the number of splats per tile of a frame, [⌈H/16⌉, ⌈W/16⌉]."""
    height, width = frame.pixels.shape[:2]
    rows, columns = group_grid(config, width, height)
    group, mask = frame.binned.group, frame.binned.entries["mask"].astype(np.int64)
    counts = [
        np.bincount(group, mask >> tile & 1, rows * columns) for tile in range(config.group**2)
    ]
    grid = np.array(counts, np.int64).T.reshape(rows, columns, config.group, config.group)
    whole = grid.swapaxes(1, 2).reshape(rows * config.group, columns * config.group)
    return whole[: -(-height // TILE), : -(-width // TILE)]


def map_picture(values: np.ndarray, side: int, width: int, height: int) -> np.ndarray:
    """Draw values of squares of `side` pixels as a picture [H, W, 3], on a logarithmic scale from 1
    to the maximum; 0 is black."""
    from matplotlib import colormaps

    most = max(float(values.max(initial=0)), 2)
    share = np.log(np.maximum(values, 1)) / np.log(most)
    colours = colormaps["viridis"](share, bytes=True)[..., :3]
    colours[values == 0] = 0
    return colours.repeat(side, axis=0).repeat(side, axis=1)[:height, :width]


def tile_picture(config: Config, frame: Frame) -> tuple[np.ndarray, str]:
    """Return the picture of layer `TILES` and its scale as text."""
    values = tile_lengths(config, frame)
    height, width = frame.pixels.shape[:2]
    return map_picture(values, TILE, width, height), scale(values, "tile", "splats")


def group_picture(config: Config, frame: Frame) -> tuple[np.ndarray, str]:
    """Return the picture of layer `GROUPS` and its scale as text."""
    from splatcore.sim.cycles.frame import group_cycles

    values = group_cycles(config, frame)
    height, width = frame.pixels.shape[:2]
    picture = map_picture(values, group_pixels(config), width, height)
    return picture, scale(values, "group", "cycles")


def scale(values: np.ndarray, square: str, unit: str) -> str:
    """Return the scale of a map as text, with the position of the maximum.

    square: "tile" or "group"
    """
    row, column = np.unravel_index(values.argmax(), values.shape)
    return (
        f"violet 1 … yellow {values.max():,.0f} {unit}, logarithmic; "
        f"maximum: {square} {column},{row}; mean {values.mean():,.0f}"
    )
