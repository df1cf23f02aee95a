"""Golden model of stage 3's first steps: E = log2(alpha) around a tile, in integers."""

import numpy as np
from numba import njit

from splatcore.golden.arithmetic import take_apart
from splatcore.golden.batches import in_batches
from splatcore.spec import raster
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.group import extent_format
from splatcore.spec.memory import OPACITY
from splatcore.spec.raster import EXTENT, POSITION, SHEAR

POSITION_INTEGER, POSITION_FRACTION = POSITION.integer, POSITION.fraction
OPACITY_FRACTION, SHEAR_FRACTION = OPACITY.fraction, SHEAR.fraction
TILE_STEPS, HALF_TILE = TILE << POSITION_FRACTION, (TILE - 1) << POSITION_FRACTION >> 1
"""A tile's side, and the way from its first pixel to its centre, in steps of `POSITION`."""


def prepare(config: Config, features: dict[str, np.ndarray]) -> np.ndarray:
    """Codes [N] of `spec.group.feature_record` as numbers of `prepared_record`, int64 [N, fields].

    Shifts are true ones here; a record has them from `SHIFT_MIN` on.
    """

    def of(batch: slice) -> np.ndarray:
        return _prepared(config, {name: codes[batch] for name, codes in features.items()})

    return np.concatenate(in_batches(of, len(features["u"])))


def _prepared(config: Config, features: dict[str, np.ndarray]) -> np.ndarray:
    """The same of some of them."""
    format, unit = config.arithmetic, config.screen_exponent
    exponent, significand = {}, {}
    for name in ("u", "v", "across", "along", "shear"):
        negative, exponent[name], size = take_apart(format, features[name])
        significand[name] = np.where(negative, -size, size)
    far = np.maximum(exponent["u"], exponent["v"]) + unit + 1 - POSITION.integer
    values = {"scale": np.clip(far, 0, raster.SCALE_MAX)}
    for name in ("u", "v"):
        left = exponent[name] - format.fraction + unit + POSITION.fraction - values["scale"]
        values[name] = clipped(POSITION, shifted(significand[name], -left))
    for name, shift_name in (("across", "k"), ("along", "m")):
        power = exponent[name] - 2 * unit
        values[shift_name] = -((power + 1) >> 1)
        values[name] = significand[name] << ((power & 1) ^ 1)
        values[f"{name}_shift"] = values[shift_name] - values["scale"]
    lean = raster.lean_unit(config) - exponent["shear"]
    values["lean_shift"] = np.clip(lean, raster.SHIFT_MIN, raster.LEAN_RIGHT_MAX)
    values["shear"] = significand["shear"]
    left = exponent["shear"] - format.fraction + SHEAR.fraction - values["k"]
    values["slope"] = clipped(SHEAR, shifted(significand["shear"], -left))
    values |= curvature(config, values)
    for name in ("half_width", "half_height"):
        wide = extent_format(config).decode(features[name]) * 2.0**unit
        values[name] = np.fmin(np.ceil(np.ldexp(wide, EXTENT.fraction)), 2**EXTENT.width - 1)
    for name in ("opacity", "red", "green", "blue"):
        values[name] = features[name]
    names = [name for name, _ in raster.prepared_record(config).fields]
    return np.stack([values[name].astype(np.int64) for name in names], axis=1)


def curvature(config: Config, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """E's second differences [N]."""
    k, m, slope = values["k"], values["m"], values["slope"]
    coarser = raster.factor_fraction(config) - config.exponent_fraction
    mixed = values["across"] * slope >> SHEAR.fraction
    return {
        "cxx": shifted(values["across"], coarser + 2 * k),
        "cxy": shifted(mixed, coarser + k - 1),
        "cyy": shifted(mixed * slope, SHEAR.fraction + coarser)
        + shifted(values["along"], coarser + 2 * m),
    }


def clipped(format, values: np.ndarray) -> np.ndarray:
    """Signed integers cut to the range of a format."""
    limit = 1 << (format.integer + format.fraction)
    return np.clip(values, -limit, limit - 1)


def shifted(values: np.ndarray, right: np.ndarray) -> np.ndarray:
    """values · 2^−right, floor."""
    return values << np.clip(-right, 0, 40) >> np.clip(right, 0, 62)


def setup_constants(config: Config) -> tuple[int, int]:
    """Bits below the point of E's coefficients and of a normalised factor."""
    return config.exponent_fraction, raster.factor_fraction(config)


@njit(inline="always")
def shift(value, right):
    """value · 2^−right, floor."""
    return value >> right if right >= 0 else value << -right


@njit(inline="always")
def outside(value, integer, fraction):
    """True if a signed number leaves its range."""
    limit = 1 << (integer + fraction)
    return not -limit <= value < limit


@njit(cache=True)
def quadratic(splat, column, row, constants, coefficients):
    """E's coefficients around the tile at (column, row) of the image; False if it is too far away.

    splat: a row of `prepare`. coefficients [8]: e, gx, gy, cxx, cxy, cyy, and the way from the
    splat's centre to the tile's in steps of `POSITION`.
    """
    fraction, factor = constants
    u, v, scale, across, along, k, m, across_shift, along_shift, lean_shift, shear, slope = splat[
        :12
    ]
    dx = (column * TILE_STEPS + HALF_TILE >> scale) - u
    dy = (row * TILE_STEPS + HALF_TILE >> scale) - v
    lean = shift(shear * dy, lean_shift)
    guard = fraction - POSITION_FRACTION
    if outside(lean, POSITION_INTEGER + 1, fraction):
        return False
    t = shift((dx << guard) - lean, across_shift)
    d = shift(dy << guard, along_shift)
    if outside(t, raster.LENGTH_INTEGER, fraction) or outside(d, raster.LENGTH_INTEGER, fraction):
        return False
    slope_t, slope_d = across * t >> factor, along * d >> factor
    e = -(splat[17] << (fraction - OPACITY_FRACTION))
    e -= (slope_t * t >> fraction) + (slope_d * d >> fraction)
    gx = -shift(slope_t, k - 1)
    gy = 2 * (slope * slope_t >> SHEAR_FRACTION) - shift(slope_d, m - 1)
    coefficients[0], coefficients[1], coefficients[2] = e, gx, gy
    coefficients[3:6] = splat[12:15]
    coefficients[6], coefficients[7] = dx, dy
    return not (
        outside(e, raster.EXPONENT_INTEGER, fraction)
        or outside(gx, raster.GRADIENT_INTEGER, fraction)
        or outside(gy, raster.GRADIENT_INTEGER, fraction)
    )
