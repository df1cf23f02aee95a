"""Golden model of stage 3's first steps: E = log2(alpha) around a tile, in integers.

In C++, like the blending that follows it (`raster.cpp`).
"""

from pathlib import Path

import numpy as np

from splatcore.spec import raster
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.convention import BLOCK, TILE, Faint
from splatcore.spec.feature import (
    FACTOR,
    FACTOR_SCALE,
    POSITION,
    SHEAR,
    feature_record,
    whole_colours,
)
from splatcore.spec.memory import OPACITY
from splatcore.spec.native import Library
from splatcore.spec.raster import SLOPE, prepared_record, quadratic_record
from splatcore.spec.record import Codes, Record


def _integers(names: str) -> np.dtype:
    return np.dtype([(name, np.int64) for name in names.split()])


def _fields(record: Record) -> str:
    return " ".join(name for name, _ in record.fields)


FEATURE = np.dtype([(name, np.int32) for name, _ in feature_record(DEFAULT).fields])
"""A splat's features: signed positions, whole colours, the other codes."""

PREPARED = _integers(_fields(prepared_record(DEFAULT)))
QUADRATIC = _integers(_fields(quadratic_record(DEFAULT)))

LEVEL = _integers("above marked")
"""A level of blocks (`spec.raster.mark_min`).

above: T from which on a block's level is lower
marked: twice the E from which on a block is marked
"""

MACHINE = _integers(
    "group rasterizers columns width height fraction mixed_shift lean_unit coarser lowest finer "
    "steps mantissa full rest_min dark taken takes_all narrower product dropped visible wide rgba "
    "red green blue"
)
"""A machine's and a frame's constants. T and sums are integers.

group: tiles per side of a group
rasterizers: number of rasterizers
columns: groups per row of the image
width, height: image size, pixels
fraction: fraction bits of E around a tile
mixed_shift, lean_unit: shifts of `spec.raster`
coarser: right shift from E in half-pixel steps to a pixel's E
lowest: lowest E of a pixel with alpha ≥ 1/255
finer: right shift from a pixel's E to an index of the table
steps: log2 of the table's length
mantissa: fraction bits of the table
full: T of a new pixel
rest_min: T below which a pixel ends
dark, taken: thresholds of the faintness rule; dark is 0 without it
takes_all: a pixel's last splat takes all of T
narrower: right shift from T to a weight
product: right shift from a weight times a colour to a sum
dropped: right shift from a sum to the result
visible: right shift from a sum to 8 bits
wide: pixels are int64, not uint8
rgba: a pixel has alpha, and no background
red, green, blue: codes of the background
"""

WORK = _integers("marked visited contributing contributions ended")
"""Counts by group and rasterizer.

marked: blocks that marking could not leave out
visited: marked blocks with a pixel of alpha ≥ 1/255
contributing: visited blocks with such a pixel that is live and not too faint
contributions: blended pixels
ended: pixels that ended
"""

PAIRS = _integers("entries pairs far empty")
"""Counts by group.

entries: entries until the group's last pixel ended
pairs: pairs of one of them and a tile with live pixels
far: pairs that setup found too far away
empty: pairs without a marked block
"""

LIBRARY = Library(
    Path(__file__).with_name("raster.cpp"),
    {
        "BLOCK": BLOCK, "BLOCKS": raster.BLOCKS, "STEPS": raster.STEPS, "TILE": TILE,
        "TILE_STEPS": TILE << POSITION.fraction,
        "HALF_TILE": (TILE - 1) << POSITION.fraction >> 1,
        "POSITION_FRACTION": POSITION.fraction, "OPACITY_FRACTION": OPACITY.fraction,
        "FACTOR_EXPONENT": FACTOR.exponent, "FACTOR_FRACTION": FACTOR.fraction,
        "FACTOR_SCALE": FACTOR_SCALE, "UNIT_FRACTION": raster.FACTOR_FRACTION,
        "SHEAR_EXPONENT": SHEAR.exponent, "SHEAR_FRACTION": SHEAR.fraction,
        "SLOPE_FRACTION": SLOPE.fraction, "SLOPE_LIMIT": 1 << SLOPE.integer + SLOPE.fraction,
        "MIXED_GUARD": raster.MIXED_GUARD, "LEAN_INTEGER": raster.LEAN_INTEGER,
        "LENGTH_INTEGER": raster.LENGTH_INTEGER, "EXPONENT_INTEGER": raster.EXPONENT_INTEGER,
        "GRADIENT_INTEGER": raster.GRADIENT_INTEGER,
    },
    {
        "Feature": FEATURE, "Prepared": PREPARED, "Quadratic": QUADRATIC, "Level": LEVEL,
        "Machine": MACHINE, "Work": WORK, "Pairs": PAIRS,
    },
)  # fmt: skip

_prepare = LIBRARY.function("prepare", int, FEATURE, MACHINE, PREPARED)
_quadratics = LIBRARY.function(
    "quadratics", int, PREPARED, np.int64, np.int64, int, QUADRATIC, np.bool_
)
_highest = LIBRARY.function("highest", int, QUADRATIC, np.int32)


def constants(config: Config) -> np.ndarray:
    """Return the constants [1] of a machine; those of a frame are 0."""
    pixel, bits = config.pixel_fraction, config.transmittance
    rule = config.faint or Faint(bits + 1, bits, bits)
    values = {
        "group": config.group,
        "rasterizers": config.rasterizers,
        "fraction": config.exponent_fraction,
        "mixed_shift": raster.mixed_shift(config),
        "lean_unit": raster.lean_unit(config),
        "coarser": config.exponent_fraction + 2 - pixel,
        "lowest": raster.exponent_min(pixel),
        "finer": pixel - config.power_fraction,
        "steps": config.power_fraction,
        "mantissa": config.power_mantissa,
        "full": (1 << bits) - 1,
        "rest_min": raster.transmittance_min(config),
        "dark": 1 << bits >> rule.dark,
        "taken": 1 << bits - rule.taken,
        "takes_all": bool(config.faint),
        "narrower": bits - config.weight,
        "product": config.weight + config.colour_fraction - config.sum_fraction,
        "visible": config.sum_fraction - 8,
    }
    found = np.zeros(1, MACHINE)
    for name, value in values.items():
        found[name] = value
    return found


def levels(config: Config, mark_all: bool) -> np.ndarray:
    """Return the levels of blocks; `mark_all`: one level, at which any E marks."""
    least = 2 * np.array([-(1 << 30)] if mark_all else raster.mark_min(config))
    found = np.zeros(len(least), LEVEL)
    found["marked"] = least
    if len(least) > 1:
        highest = config.transmittance - config.faint.dark
        found["above"][:-1] = [1 << highest - k for k in range(len(least) - 1)]
    return found


def whole_features(config: Config, features: Codes) -> np.ndarray:
    """Return `FEATURE` [N], from codes [N] of `feature_record`."""
    found = np.empty(len(features["u"]), FEATURE)
    sign = 1 << POSITION.width - 1
    for name, codes in features.items():
        found[name] = codes
        if name in CHANNELS:
            found[name] = whole_colours(config, found[name], np.where)
        if name in ("u", "v"):
            found[name] = (found[name] ^ sign) - sign
    return found


def prepare(config: Config, features: Codes) -> np.ndarray:
    """Prepare splats: codes [N] of `feature_record` to the fields [N] of `prepared_record`, int64.

    Shifts are true shifts here; the record holds them minus `SHIFT_MIN`.
    """
    whole = whole_features(config, features)
    found = np.empty(len(whole), PREPARED)
    _prepare(len(whole), whole, constants(config), found)
    return found


def quadratic(config: Config, splats: np.ndarray, column: np.ndarray, row: np.ndarray):
    """Return E around tiles [N] of `QUADRATIC`, and whether [N] splats are near them.

    splats: [N] as from `prepare`
    column, row: [N] tiles of the image
    """
    found, near = np.empty(len(splats), QUADRATIC), np.empty(len(splats), bool)
    places = (np.ascontiguousarray(some, np.int64) for some in (column, row))
    _quadratics(
        len(splats), np.ascontiguousarray(splats), *places, config.exponent_fraction, found, near
    )
    return found, near


def twice_highest(around: np.ndarray) -> np.ndarray:
    """Return bounds [N, 16] on twice the E of each block's pixels, from `QUADRATIC` [N]."""
    found = np.empty((len(around), raster.BLOCKS**2), np.int32)
    _highest(len(around), np.ascontiguousarray(around), found)
    return found
