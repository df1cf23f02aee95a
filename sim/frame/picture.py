"""Pictures: PNG files in and out, error maps, tile heat maps."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, UnidentifiedImageError

from splatcore.sim.common.output import write
from splatcore.sim.frame.metric import LEVELS, channel_error
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError

if TYPE_CHECKING:  # matplotlib takes half a second to import
    from matplotlib.figure import Figure

MAP_INCHES = 9.6
DOTS_PER_INCH = 100
ERROR_MAX = 16  # levels at the end of the scale of `error_picture`
PNG_LEVEL = 3  # of zlib: half the time of the default 6, files 5 % larger


def read_png(path: str | Path) -> np.ndarray:
    """Read an image as uint8 [H, W, 3]; raise InputError, naming the file, if that fails."""
    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"))
    except UnidentifiedImageError:
        raise InputError(f"{path}: is not an image") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def straight(pixels: np.ndarray) -> np.ndarray:
    """Convert uint8 [H, W, 4] from premultiplied colour to straight alpha, as in PNG.

    colour · 255 / alpha, rounded to nearest, at most 255; 0 where alpha is 0
    """
    colour, alpha = pixels[..., :3].astype(np.int32), pixels[..., 3:].astype(np.int32)
    full = np.minimum((2 * LEVELS * colour + alpha) // np.maximum(2 * alpha, 1), LEVELS)
    return np.concatenate([full * (alpha > 0), alpha], axis=2).astype(np.uint8)


def write_png(path: str | Path, pixels: np.ndarray):
    """Write uint8 [H, W, 3] as PNG, or [H, W, 4] with premultiplied colour."""
    if pixels.shape[2] == 4:
        pixels = straight(pixels)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=PNG_LEVEL)
    write(path, buffer.getvalue())


def write_figure(path: str | Path, figure: "Figure", **options):
    """Write a matplotlib figure as PNG, with options of `savefig`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", **options)
    write(path, buffer.getvalue())


def write_error_map(path: str | Path, image: np.ndarray, reference: np.ndarray, title: str):
    """Draw the difference of two uint8 images [H, W, 3]: the largest channel error in levels.

    Colours follow the square root of the error, so that single levels stay visible.
    """
    from matplotlib.colors import PowerNorm

    error = channel_error(image, reference)
    norm = PowerNorm(0.5, vmin=0, vmax=max(int(error.max()), 1))
    _write_map(path, error, title, f"error in levels of {LEVELS}", norm, "inferno")


def error_picture(image: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the difference as a picture, uint8 [H, W, 3], on a fixed scale up to `ERROR_MAX`."""
    from matplotlib import colormaps

    error = np.minimum(channel_error(image, reference) / ERROR_MAX, 1)
    return colormaps["inferno"](np.sqrt(error), bytes=True)[..., :3]


def write_heat_map(path: str | Path, tile_list: np.ndarray, title: str):
    """Draw the number of splats per tile [rows, columns] on a logarithmic scale."""
    from matplotlib.colors import LogNorm

    norm = LogNorm(vmin=1, vmax=max(int(tile_list.max()), 2))
    drawn = np.ma.masked_equal(tile_list, 0)  # empty tiles stay black
    _write_map(path, drawn, title, f"splats in a tile of {TILE}×{TILE} pixels", norm, "viridis")


def _write_map(path, values, title, label, norm, colours):
    """Draw [H, W] values as a picture with a title and a colour bar."""
    from matplotlib.figure import Figure

    height, width = values.shape
    figure = Figure((MAP_INCHES, MAP_INCHES * min(height / width, 2) + 1.2), DOTS_PER_INCH)
    axes = figure.subplots()
    axes.set_facecolor("black")
    drawn = axes.imshow(values, cmap=colours, norm=norm, interpolation="nearest")
    axes.set_title(title, fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])
    figure.colorbar(drawn, ax=axes, label=label, orientation="horizontal", shrink=0.7, pad=0.03)
    write_figure(path, figure, bbox_inches="tight")
