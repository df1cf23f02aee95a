"""Features and sorted entries without the stages before: from the reference's splats, or random."""

from dataclasses import fields, replace

import numpy as np

from golden.reference import Splats, tile_boxes
from golden.reference_tiles import bin_splats
from spec.camera import Camera
from spec.config import Config
from spec.convention import ALPHA_MIN, SPLATCORE, TILE
from spec.frame import POWER_SCALE
from spec.group import colour_format, extent_codes, group_grid
from spec.memory import OPACITY
from spec.record import Codes
from spec.scene import Gaussians
from tb.raster_rows import Entries


def as_packed(gaussians: Gaussians) -> Gaussians:
    """What a model keeps, with opacities that it can hold."""
    codes = OPACITY.encode(-np.log2(np.clip(np.nan_to_num(gaussians.opacity), 1e-9, 1)))
    kept = np.nan_to_num(gaussians.opacity) >= ALPHA_MIN
    rounded = replace(gaussians, opacity=2.0 ** -OPACITY.decode(codes))
    return Gaussians(*(getattr(rounded, field.name)[kept] for field in fields(rounded)))


def features_of(config: Config, splats: Splats) -> Codes:
    """Features of splats, rounded once."""
    _, xy, yy = splats.covariance.T
    return encode(
        config, splats.centre, splats.conic[:, 0], xy / yy, 1 / yy, splats.opacity, splats.colour,
        splats.extent,
    )  # fmt: skip


def encode(config: Config, centre, across, shear, along, opacity, colour, extent) -> Codes:
    """Features from float64 values in pixels; across and along as in Q."""
    format, pixel = config.arithmetic, 2.0**-config.screen_exponent
    values = {
        "u": centre[:, 0] * pixel,
        "v": centre[:, 1] * pixel,
        "across": across * POWER_SCALE / pixel**2,
        "shear": shear,
        "along": along * POWER_SCALE / pixel**2,
    }
    codes = {name: format.encode(value) for name, value in values.items()}
    codes["opacity"] = OPACITY.encode(-np.log2(opacity))
    for channel, name in enumerate(("red", "green", "blue")):
        codes[name] = colour_format(config).encode(colour[:, channel] * 255 / 256)
    for axis, name in enumerate(("half_width", "half_height")):
        codes[name] = extent_codes(config, format.encode(extent[:, axis] * pixel))
    return codes


def entries_of(config: Config, splats: Splats, camera: Camera) -> Entries:
    """Exact lists of groups in depth order."""
    boxes = tile_boxes(splats, camera, SPLATCORE)
    lists = bin_splats(
        splats.centre, splats.conic, splats.reach, boxes, camera.width, camera.height, True
    )
    _, columns = group_grid(config, camera.width, camera.height)
    lengths = np.diff(lists.start)
    row, column = np.divmod(np.repeat(np.arange(len(lengths)), lengths), -(-camera.width // TILE))
    group = row // config.group * columns + column // config.group
    tile = row % config.group * config.group + column % config.group
    return grouped(config, group, lists.splat, tile, (camera.width, camera.height))


def grouped(config: Config, group, splat, tile, size: tuple[int, int]) -> Entries:
    """Entries of pairs [N] of a splat, numbered in depth order, and a tile of a group."""
    key = group.astype(np.int64) << 32 | splat
    order = np.argsort(key, kind="stable")
    unique, first = np.unique(key[order], return_index=True)
    bits = np.int64(1) << tile[order].astype(np.int64)
    mask = np.bitwise_or.reduceat(bits, first) if len(first) else bits
    groups = int(np.prod(group_grid(config, *size)))
    start = np.searchsorted(unique >> 32, np.arange(groups + 1))
    return Entries(start, unique & 0xFFFFFFFF, mask)


def random_features(config: Config, count: int, size: tuple[int, int], seed: int) -> Codes:
    """Splats of all shapes on and around an image: points, needles, walls, far centres."""
    rng = np.random.default_rng(seed)
    far = np.where(rng.random(count) < 0.1, rng.choice([10, 100, 1000, 1e5], count), 1.0)
    centre = rng.uniform(-0.2, 1.2, (count, 2)) * size * far[:, None]
    xx, yy = 0.3 + 4.0 ** rng.uniform(-3, 9, (2, count)) * np.maximum(far, 1)
    xy = np.sqrt((xx - 0.3) * (yy - 0.3)) * rng.choice([0, 1, -1, 0.5, 0.999], count)
    schur = xx - xy**2 / yy
    codes = rng.integers(0, 1 << rng.integers(1, OPACITY.width + 1, count))
    opacity = 2.0 ** -OPACITY.decode(codes.astype(np.uint8))
    reach = np.maximum(2 * np.log(255 * opacity), 0)
    extent = np.sqrt(reach[:, None] * np.stack([xx, yy], axis=1))
    colour = rng.choice([0, 0.3, 1, 2, 8], (count, 3)) * rng.random((count, 3))
    return encode(config, centre, 1 / schur, xy / yy, 1 / yy, opacity, colour, extent)
