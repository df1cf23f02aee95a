"""Golden model of stage 3's first steps: E = log2(alpha) around a tile, in integers."""

from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.golden.arithmetic import take_apart
from splatcore.golden.batches import in_batches
from splatcore.spec import raster
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, POSITION, SHEAR, whole_colours
from splatcore.spec.memory import OPACITY
from splatcore.spec.raster import SLOPE

POSITION_FRACTION, POSITION_SIGN = POSITION.fraction, 1 << POSITION.width - 1
OPACITY_FRACTION, SLOPE_FRACTION = OPACITY.fraction, SLOPE.fraction
TILE_STEPS, HALF_TILE = TILE << POSITION_FRACTION, (TILE - 1) << POSITION_FRACTION >> 1
"""A tile's side, and the distance from its first pixel to its centre, in steps of `POSITION`."""


def prepare(config: Config, features: dict[str, np.ndarray]) -> np.ndarray:
    """Prepare splats: codes [N] of `feature_record` to the fields [N] of `prepared_record`, int64.

    Shifts are true shifts here; the record holds them minus `SHIFT_MIN`.
    """

    def of(batch: slice) -> np.ndarray:
        return _prepared(config, {name: codes[batch] for name, codes in features.items()})

    return np.concatenate(in_batches(of, len(features["u"])))


def _prepared(config: Config, features: dict[str, np.ndarray]) -> np.ndarray:
    """Prepare one batch of splats."""
    codes = {name: features[name].astype(np.int64) for name in features}
    values = {"scale": codes["scale"]}
    for name in ("u", "v"):
        values[name] = (codes[name] ^ POSITION_SIGN) - POSITION_SIGN
    for name, shift_name in (("across", "k"), ("along", "m")):
        _, power, magnitude = take_apart(FACTOR, codes[name])
        power -= FACTOR_SCALE
        values[shift_name] = -((power + 1) >> 1)
        values[name] = magnitude << ((power & 1) ^ 1)
        values[f"{name}_shift"] = values[shift_name] - values["scale"]
    negative, exponent, magnitude = take_apart(SHEAR, codes["shear"])
    values["shear"] = np.where(negative, -magnitude, magnitude)
    values["lean_shift"] = raster.lean_unit(config) - exponent
    right = SHEAR.fraction - exponent - SLOPE.fraction + values["k"]
    values["slope"] = clipped(SLOPE, shifted(values["shear"], right))
    values |= curvature(config, values)
    values["opacity"] = codes["opacity"]
    for name in CHANNELS:
        values[name] = whole_colours(config, codes[name], np.where)
    fields = [(name, np.int64) for name, _ in raster.prepared_record(config).fields]
    found = np.zeros(len(codes["u"]), fields)
    for name, _ in fields:
        found[name] = values[name]
    return found


def curvature(config: Config, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return E's second differences [N]."""
    k, m, slope = values["k"], values["m"], values["slope"]
    coarser = raster.FACTOR_FRACTION - config.exponent_fraction
    mixed = values["across"] * slope >> raster.mixed_shift(config)
    return {
        "cxx": shifted(values["across"], coarser + 2 * k),
        "cxy": shifted(mixed, raster.MIXED_GUARD + k - 1),
        "cyy": shifted(mixed * slope, SLOPE.fraction + raster.MIXED_GUARD)
        + shifted(values["along"], coarser + 2 * m),
    }


def clipped(format, values: np.ndarray) -> np.ndarray:
    """Clip signed integers to the range of a format."""
    limit = 1 << (format.integer + format.fraction)
    return np.clip(values, -limit, limit - 1)


def shifted(values: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return values · 2^−right, rounded down."""
    return values << np.clip(-right, 0, 40) >> np.clip(right, 0, 62)


@njit(inline="always")
def shift(value, right):
    """Return value · 2^−right, rounded down."""
    return value >> right if right >= 0 else value << -right


@njit(inline="always")
def outside(value, integer, fraction):
    """Return whether a signed number leaves its range."""
    limit = 1 << (integer + fraction)
    return not -limit <= value < limit


class Quadratic(NamedTuple):
    """E's coefficients around a point, integers: `spec.raster.quadratic_record`."""

    e: int
    gx: int
    gy: int
    cxx: int
    cxy: int
    cyy: int


@njit(cache=True)
def quadratic(splat, column, row, fraction):
    """Return E around the tile at (column, row) of the image, and whether the splat is near it.

    splat: one of `prepare`
    fraction: `Config.exponent_fraction`
    """
    dx = (column * TILE_STEPS + HALF_TILE >> splat.scale) - splat.u
    dy = (row * TILE_STEPS + HALF_TILE >> splat.scale) - splat.v
    lean = shift(splat.shear * dy, splat.lean_shift)
    guard = fraction - POSITION_FRACTION
    t = shift((dx << guard) - lean, splat.across_shift)
    d = shift(dy << guard, splat.along_shift)
    slope_t = splat.across * t >> raster.FACTOR_FRACTION
    slope_d = splat.along * d >> raster.FACTOR_FRACTION
    e = -(splat.opacity << (fraction - OPACITY_FRACTION))
    e -= (slope_t * t >> fraction) + (slope_d * d >> fraction)
    gx = -shift(slope_t, splat.k - 1)
    gy = 2 * (splat.slope * slope_t >> SLOPE_FRACTION) - shift(slope_d, splat.m - 1)
    far = (
        outside(lean, raster.LEAN_INTEGER, fraction)
        or outside(t, raster.LENGTH_INTEGER, fraction)
        or outside(d, raster.LENGTH_INTEGER, fraction)
        or outside(e, raster.EXPONENT_INTEGER, fraction)
        or outside(gx, raster.GRADIENT_INTEGER, fraction)
        or outside(gy, raster.GRADIENT_INTEGER, fraction)
    )
    return Quadratic(e, gx, gy, splat.cxx, splat.cxy, splat.cyy), not far
