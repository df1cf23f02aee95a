"""Depths: finer numbers than all others, and the keys that are made of them.

The order of splats shows in the picture where a rounding of positions does not. So stage 0 finds
depths with the fraction bits of `Config.depth`, from rays as fine: `finer`. A coordinate is then
narrowed to `Config.arithmetic`; a depth's bits below, z_low, go along with it, and together they
are its exact code again: `whole_codes`.

A key is a depth's code, if keys have as many bits. Else keys are finest from `KEY_BASE`, whatever
the near plane is. With K keys: the first K/16 are the 16 doublings below `KEY_BASE`; from there on
a key is one code for K/2 keys, two codes for K/4, and as many as reach the largest depth for the
rest. `DEFAULT`: 15 fraction bits below a depth of 0.2, 20 up to 3.2, 19 up to 51, 14 beyond.
"""

from dataclasses import replace

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.number import Bits

KEY_BASE = NEAR_PLANE
"""Depth from which keys are finest (scene units)."""

BELOW, DOUBLINGS = 4, 4
"""A key in 2^BELOW is of the 2^DOUBLINGS doublings of depth below `KEY_BASE`."""


def low_bits(config: Config) -> int:
    """Fraction bits that a depth has more than `Config.arithmetic`."""
    return max(0, config.depth.fraction - config.arithmetic.fraction)


def finer(config: Config) -> Config:
    """The machine whose arithmetic is that of depths and of the rays that they come from."""
    fraction = config.arithmetic.fraction + low_bits(config)
    return replace(config, arithmetic=replace(config.arithmetic, fraction=fraction))


def low_format(config: Config) -> dict[str, Bits]:
    """The field z_low of records with a depth, if depths have more bits than other numbers."""
    bits = low_bits(config)
    return {"z_low": Bits(bits)} if bits else {}


def narrowed(config: Config, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Codes [N] of `finer` as codes of `Config.arithmetic`, and the bits that these lack.

    Rounded to nearest, a tie away from zero, so that the highest bit that is cut off says whether
    the code went up.
    """
    bits, codes = low_bits(config), codes.astype(np.int64)
    if not bits:
        return codes, np.zeros_like(codes)
    magnitude = 1 << config.arithmetic.width - 1
    sign, size = codes >> finer(config).arithmetic.width - 1, codes & ((magnitude << bits) - 1)
    rounded = np.minimum((size >> bits) + (size >> bits - 1 & 1), magnitude - 1)
    return sign * magnitude | rounded, codes & (1 << bits) - 1


def whole_codes(config: Config, codes, low):
    """Codes of `finer` plus half of what `narrowed` cuts off [N], of the two.

    The cut-off bits with their highest one inverted are those above the half.
    """
    bits = low_bits(config)
    return (codes << bits) + (low ^ (1 << bits >> 1))


def whole_depth(config: Config, depth: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Depths [N] of values of `Config.arithmetic` and their low bits."""
    if not low_bits(config):
        return depth
    codes = config.arithmetic.encode(depth).astype(np.int64)
    whole = whole_codes(config, codes, low.astype(np.int64)) - (1 << low_bits(config) >> 1)
    return finer(config).arithmetic.decode(whole.astype(np.uint64))


def key_shift(config: Config) -> int:
    """Codes in one of the last quarter of keys, as a power of two; 0: a key for each code."""
    bits = config.arithmetic.exponent + finer(config).arithmetic.fraction
    return bits - config.sort_key_bits + 2 if bits > config.sort_key_bits else 0


def below_bits(config: Config) -> int:
    """Keys below `KEY_BASE`, as a power of two."""
    return config.sort_key_bits - BELOW


def below_shift(config: Config) -> int:
    """Codes of `finer` in a key below `KEY_BASE`, as a power of two."""
    return max(finer(config).arithmetic.fraction + DOUBLINGS - below_bits(config), 0)


def base_code(config: Config) -> int:
    """The code of `KEY_BASE` in `finer`, as far as `Config.arithmetic` holds it."""
    return rounded_down(config, KEY_BASE) << low_bits(config)


def rounded_down(config: Config, depth: float) -> int:
    """The largest code of `Config.arithmetic` whose value is at most a depth."""
    code = int(config.arithmetic.encode(config.arithmetic.round(depth)))
    return code - int(config.arithmetic.decode(code) > depth)


def depth_keys(config: Config, codes: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Keys [N] of depths ≥ 0, `narrowed` codes and their low bits.

    Codes of numbers that are not negative rise with them, and so do the keys.
    """
    whole = whole_codes(config, codes.astype(np.int64), low.astype(np.int64))
    whole = np.maximum(whole - (1 << low_bits(config) >> 1), 0)
    shift = key_shift(config)
    if not shift:
        return whole.astype(np.uint64)
    lower, first = 1 << config.sort_key_bits - 1, below_bits(config)
    steps = whole - base_code(config)
    below = np.maximum(steps >> below_shift(config), -(1 << first))
    middle, coarse = lower + (steps - lower >> 1), 3 * (lower >> 1) + (steps >> shift)
    above = np.where(steps < lower, steps, np.where(steps < 2 * lower, middle, coarse))
    return ((1 << first) + np.where(steps < 0, below, above)).astype(np.uint64)
