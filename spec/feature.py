"""A splat's features: the record in memory from which stage 3 blends the splat.

Lengths are in pixels. Numbers have as few bits as picture quality allows, so that a splat is one
beat of memory (`spec.work.FEATURE`).
"""

import numpy as np

from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits, Fixed, Float
from splatcore.spec.record import Record

POSITION = Fixed(11, 8, signed=True)
"""A coordinate of a splat's centre, in units of 2^scale pixels; scale is 0 within 2^11 pixels."""

SCALE_MAX = 15
"""Largest scale; a centre beyond 2^26 pixels is stored at that distance."""

FACTOR = Float(6, 9, signed=False, subnormal=False)
"""A factor of a splat's conic, times 2^`FACTOR_SCALE`."""

FACTOR_SCALE = 31
"""Scale of factors for lengths in pixels.

No factor is above 2.41, as no splat is thinner than the blur; 4 would be too large. Factors below
2^−61 are stored as 0.
"""

SHEAR = Float(5, 10, subnormal=False)
"""A splat's shear; values below 2^−14 do not move its outline by a pixel."""


def centre_codes(u: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """Return the codes of a centre's u, v and scale.

    u, v: [N] float64, pixels
    The scale is the smallest with which both are in range before rounding. NaN is stored as 0, with
    the largest scale, like infinity.
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
"""Bits that features omit from a colour of 2 or more."""


def short_colour_format(config: Config) -> Bits:
    """A splat's red, green or blue in its features, in three pieces.

    Below 1 all bits are stored; from 1 to 2 all except the last; from 2 on `BRIGHT_SHIFT` fewer.
    Codes rise with colours.
    """
    return Bits(config.colour_fraction + 1)


def short_colours(config: Config, codes, choose):
    """Shorten codes of `colour_format` to `short_colour_format`, rounded to nearest.

    codes: integers or hardware values
    choose: `np.where` for integers, `Mux` for hardware values
    """
    one = 1 << config.colour_fraction
    middle = (codes + 1 >> 1) + one // 2
    bright = (codes + (1 << BRIGHT_SHIFT - 1) >> BRIGHT_SHIFT) + _bright_from(config)
    return choose(codes < one, codes, choose(codes < 2 * one, middle, bright))


def whole_colours(config: Config, codes, choose):
    """Invert `short_colours`, except for its rounding."""
    one = 1 << config.colour_fraction
    bright = codes - _bright_from(config) << BRIGHT_SHIFT
    middle = codes - one // 2 << 1
    return choose(codes < one, codes, choose(codes < one + one // 2, middle, bright))


def _bright_from(config: Config) -> int:
    """Return the difference between the short code of a colour ≥ 2 and its shifted code."""
    one = 1 << config.colour_fraction
    return one + one // 2 - (2 * one >> BRIGHT_SHIFT)


def feature_record(config: Config) -> Record:
    """A splat's features.

    u, v, scale: its centre
    across, along: the conic's factors times `spec.frame.POWER_SCALE`, so that
        E = −opacity − (dx − shear·dy)²·across − dy²·along
    opacity: −log2(opacity)
    red, green, blue: in units of 255/256, so that the top 8 bits of a weighted sum are the pixel's
    """
    fields = {"u": POSITION, "v": POSITION, "scale": Bits(SCALE_MAX.bit_length())}
    fields |= {"across": FACTOR, "shear": SHEAR, "along": FACTOR, "opacity": OPACITY}
    return Record("feature", fields | dict.fromkeys(CHANNELS, short_colour_format(config)))
