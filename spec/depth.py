"""Depths, which are finer than all other numbers, and the sort keys made from them.

The order of splats shows in the picture where a rounding of positions does not. So stage 0 computes
depths with the fraction bits of `Config.depth`, from rays as fine: `finer`. Coordinates are then
narrowed to `Config.arithmetic`. The low bits of a depth, z_low, go along with it; together they are
its exact code again: `whole_codes`.

A key is a depth's code if keys have as many bits. Else keys are finest from `KEY_BASE` on, whatever
the near plane. With K keys: the first K/16 are the 16 doublings below `KEY_BASE`. Above it, each of
the next K/2 keys is one code; each of the next K/4 is two codes; each of the rest is as many codes
as it takes to reach the largest depth. `DEFAULT`: 15 fraction bits below a depth of 0.2, 20 up to
3.2, 19 up to 51, 14 beyond.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.number import Bits

KEY_BASE = NEAR_PLANE
"""Depth from which on keys are finest (scene units)."""

BELOW, DOUBLINGS = 4, 4
"""One key in 2^BELOW is for the 2^DOUBLINGS doublings of depth below `KEY_BASE`."""


def low_bits(config: Config) -> int:
    """Return the additional fraction bits of a depth, compared with `Config.arithmetic`."""
    return max(0, config.depth.fraction - config.arithmetic.fraction)


@cache
def finer(config: Config) -> Config:
    """Return the machine with the arithmetic of depths and of the rays they come from."""
    fraction = config.arithmetic.fraction + low_bits(config)
    return replace(config, arithmetic=replace(config.arithmetic, fraction=fraction))


def low_format(config: Config) -> dict[str, Bits]:
    """Return the field z_low of records with a depth; empty if depths have no additional bits."""
    bits = low_bits(config)
    return {"z_low": Bits(bits)} if bits else {}


def narrowed(config: Config, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split codes of `finer` into codes of `Config.arithmetic` and low bits.

    codes: [N]
    Returns both [N]. Rounded to nearest, ties away from zero, so that the highest low bit says
    whether the code was rounded up.
    """
    bits, codes = low_bits(config), codes.astype(np.int64)
    if not bits:
        return codes, np.zeros_like(codes)
    magnitude = 1 << config.arithmetic.width - 1
    sign, size = codes >> finer(config).arithmetic.width - 1, codes & ((magnitude << bits) - 1)
    rounded = np.minimum((size >> bits) + (size >> bits - 1 & 1), magnitude - 1)
    return sign * magnitude | rounded, codes & (1 << bits) - 1


def whole_codes(config: Config, codes, low):
    """Return codes [N] of `finer` plus half the weight of the low bits, from `narrowed` codes.

    Inverting the highest of the low bits turns them into the bits above this half.
    """
    bits = low_bits(config)
    return (codes << bits) + (low ^ (1 << bits >> 1))


def whole_depth(config: Config, depth: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Return depths [N] from values [N] of `Config.arithmetic` and their low bits [N]."""
    if not low_bits(config):
        return depth
    codes = config.arithmetic.encode(depth).astype(np.int64)
    whole = whole_codes(config, codes, low.astype(np.int64)) - (1 << low_bits(config) >> 1)
    return finer(config).arithmetic.decode(whole.astype(np.uint64))


def key_shift(config: Config) -> int:
    """Return log2 of the codes per key in the last quarter of keys; 0 if each code has a key."""
    bits = config.arithmetic.exponent + finer(config).arithmetic.fraction
    return bits - config.sort_key_bits + 2 if bits > config.sort_key_bits else 0


def below_bits(config: Config) -> int:
    """Return log2 of the keys below `KEY_BASE`."""
    return config.sort_key_bits - BELOW


def below_shift(config: Config) -> int:
    """Return log2 of the codes of `finer` per key below `KEY_BASE`."""
    return max(finer(config).arithmetic.fraction + DOUBLINGS - below_bits(config), 0)


def base_code(config: Config) -> int:
    """Return the code of `KEY_BASE` in `finer`, rounded down to `Config.arithmetic`."""
    return rounded_down(config, KEY_BASE) << low_bits(config)


def rounded_down(config: Config, depth: float) -> int:
    """Return the largest code of `Config.arithmetic` with a value up to the depth."""
    code = int(config.arithmetic.encode(config.arithmetic.round(depth)))
    return code - int(config.arithmetic.decode(code) > depth)


def depth_keys(config: Config, codes: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Return the keys [N] of depths ≥ 0, from `narrowed` codes [N] and their low bits [N].

    Codes of non-negative numbers rise with the numbers, and so do the keys.
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
