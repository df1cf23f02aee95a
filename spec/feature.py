"""A splat's features: what stage 3 needs of it, as it lies in memory.

Lengths are in pixels. Numbers are as short as the machine's pictures allow, so that a splat is one
beat of memory (`spec.work.FEATURE`).
"""

import numpy as np

from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits, Fixed, Float
from splatcore.spec.record import Record

POSITION = Fixed(11, 8, signed=True)
"""A splat's centre, in units of 2^scale pixels; scale is 0 but for centres more than 2^11 pixels
away."""

SCALE_MAX = 15
"""A centre that is farther away than 2^26 pixels is taken for one at that distance."""

FACTOR = Float(6, 9, signed=False, subnormal=False)
"""A factor of a splat's conic, times 2^`FACTOR_SCALE`."""

FACTOR_SCALE = 31
"""Of a factor for lengths in pixels: none is above 2.41, as no splat is thinner than the blur, and
4 is too large; below 2^−61 they are 0."""

SHEAR = Float(5, 10, subnormal=False)
"""A splat's shear; what is below 2^−14 does not move its outline by a pixel."""


def centre_codes(u: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """Codes of a centre's u, v and scale for float64 pixels [N]: the smallest scale with which both
    are in range before they are rounded. A NaN is 0, and as far away as an infinity.
    """
    farther = np.fmax(np.abs(u), np.abs(v))
    unknown = ~np.isfinite(u) | ~np.isfinite(v)
    bits = np.where(unknown, POSITION.integer + SCALE_MAX, np.frexp(farther)[1])
    scale = np.clip(bits - POSITION.integer, 0, SCALE_MAX)
    found = {
        name: POSITION.encode(np.where(np.isnan(values), 0, np.ldexp(values, -scale)))
        for name, values in (("u", u), ("v", v))
    }
    return found | {"scale": scale.astype(np.uint8)}


BRIGHT_SHIFT = 4
"""Bits that a splat's features leave out of a colour from 2 on."""


def short_colour_format(config: Config) -> Bits:
    """A splat's red, green or blue in its features, in three pieces: below 1 all of its bits; below
    2 all but the last one; from there on `BRIGHT_SHIFT` bits fewer. Codes rise with colours.
    """
    return Bits(config.colour_fraction + 1)


def short_colours(config: Config, codes, choose):
    """Codes of `short_colour_format` for those of `colour_format`, rounded to nearest.

    Of integers (choose: `np.where`) or of hardware values (`Mux`).
    """
    one = 1 << config.colour_fraction
    middle = (codes + 1 >> 1) + one // 2
    bright = (codes + (1 << BRIGHT_SHIFT - 1) >> BRIGHT_SHIFT) + _bright_from(config)
    return choose(codes < one, codes, choose(codes < 2 * one, middle, bright))


def whole_colours(config: Config, codes, choose):
    """The inverse of `short_colours`, but for what was rounded off."""
    one = 1 << config.colour_fraction
    bright = codes - _bright_from(config) << BRIGHT_SHIFT
    middle = codes - one // 2 << 1
    return choose(codes < one, codes, choose(codes < one + one // 2, middle, bright))


def _bright_from(config: Config) -> int:
    """What a code of a colour from 2 on is above its bits."""
    one = 1 << config.colour_fraction
    return one + one // 2 - (2 * one >> BRIGHT_SHIFT)


def feature_record(config: Config) -> Record:
    """A splat as the rasterizer gets it.

    across and along are the conic's factors times `spec.frame.POWER_SCALE`, so that
    E = −opacity − (dx − shear·dy)²·across − dy²·along; opacity is −log2 of it. Colours are in units
    of 255/256, so that the highest 8 bits of a sum of weighted ones are the pixel's.
    """
    fields = {"u": POSITION, "v": POSITION, "scale": Bits(SCALE_MAX.bit_length())}
    fields |= {"across": FACTOR, "shear": SHEAR, "along": FACTOR, "opacity": OPACITY}
    return Record("feature", fields | dict.fromkeys(CHANNELS, short_colour_format(config)))
