"""Exact inputs of stage 3: features and sorted entries from the float64 reference's splats."""

from dataclasses import replace

import numpy as np

from splatcore.golden.raster import Entries
from splatcore.golden.reference import Splats, tile_lists
from splatcore.spec.camera import Camera
from splatcore.spec.colour import CHANNELS, colour_format
from splatcore.spec.config import Config
from splatcore.spec.convention import ALPHA_MIN, SPLATCORE, TILE
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, SHEAR, centre_codes, short_colours
from splatcore.spec.frame import POWER_SCALE
from splatcore.spec.group import group_grid
from splatcore.spec.memory import OPACITY
from splatcore.spec.record import Codes
from splatcore.spec.scene import Gaussians


def as_packed(gaussians: Gaussians) -> Gaussians:
    """Return the Gaussians that a packed model keeps, with opacities rounded as in it."""
    codes = OPACITY.encode(-np.log2(np.clip(np.nan_to_num(gaussians.opacity), 1e-9, 1)))
    kept = np.nan_to_num(gaussians.opacity) >= ALPHA_MIN
    rounded = replace(gaussians, opacity=2.0 ** -OPACITY.decode(codes))
    return rounded[kept]


def features_of(config: Config, splats: Splats) -> Codes:
    """Return the features of splats [M], rounded once."""
    _, xy, yy = splats.covariance.T
    return encode(
        config, splats.centre, splats.conic[:, 0], xy / yy, 1 / yy, splats.opacity, splats.colour
    )


def encode(config: Config, centre, across, shear, along, opacity, colour) -> Codes:
    """Return codes [M] of features.

    centre: [M, 2] u, v, pixels
    across, along: [M] factors of the conic Q, per square pixel
    shear: [M]
    opacity: [M] 0 … 1
    colour: [M, 3] RGB
    """
    codes = centre_codes(*centre.T) | {"shear": SHEAR.encode(shear)}
    for name, factor in (("across", across), ("along", along)):
        codes[name] = FACTOR.encode(np.ldexp(factor * POWER_SCALE, FACTOR_SCALE))
    codes["opacity"] = OPACITY.encode(-np.log2(opacity))
    for channel, name in enumerate(CHANNELS):
        whole = colour_format(config).encode(colour[:, channel] * 255 / 256).astype(np.int64)
        codes[name] = short_colours(config, whole, np.where).astype(np.uint64)
    return codes


def entries_of(config: Config, splats: Splats, camera: Camera) -> Entries:
    """Return exact lists of groups, in depth order."""
    lists = tile_lists(splats, camera, SPLATCORE)
    rows, columns = group_grid(config, camera.width, camera.height)
    lengths = np.diff(lists.start)
    row, column = np.divmod(np.repeat(np.arange(len(lengths)), lengths), -(-camera.width // TILE))
    group = row // config.group * columns + column // config.group
    tile = row % config.group * config.group + column % config.group
    key = group.astype(np.int64) << 32 | lists.splat
    order = np.argsort(key, kind="stable")
    unique, first = np.unique(key[order], return_index=True)
    bits = np.int64(1) << tile[order].astype(np.int64)
    mask = np.bitwise_or.reduceat(bits, first) if len(first) else bits
    start = np.searchsorted(unique >> 32, np.arange(rows * columns + 1))
    return Entries(start, unique & 0xFFFFFFFF, mask)
