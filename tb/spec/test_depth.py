"""Depths in finer numbers, and the keys made of them, against exact integers."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.depth import (
    depth_keys,
    finer,
    key_shift,
    low_bits,
    low_format,
    narrowed,
    whole_codes,
    whole_depth,
)

FINE = finer(DEFAULT).arithmetic
BITS = low_bits(DEFAULT)
NEAR = int(DEFAULT.arithmetic.encode(0.2))


def keys(config, codes: np.ndarray) -> np.ndarray:
    """Keys [N] of codes of `finer`."""
    near = int(config.arithmetic.encode(0.2))
    return depth_keys(config, near, *narrowed(config, codes)).astype(np.int64)


def codes_from_near(count: int) -> np.ndarray:
    """All codes around the near plane and each power of two, and some between."""
    first, last = NEAR << BITS, (1 << FINE.width - 1) - 1
    exponents = np.arange(first >> FINE.fraction, 1 << FINE.exponent) << FINE.fraction
    close = (exponents[:, None] + np.arange(-40, 41)).ravel()
    between = np.random.default_rng(0).integers(first, last, count)
    codes = np.concatenate([first + np.arange(40), close, between])
    return np.unique(codes[(first <= codes) & (codes < last - (1 << BITS))])


def test_narrowed_is_nearest():
    """The nearest code of the arithmetic, negative ones too; the rest gives the code back."""
    values = np.concatenate([s * np.geomspace(0.01, 1e5, 5000) for s in (1, -1)])
    codes = FINE.encode(values).astype(np.int64)
    narrow, low = narrowed(DEFAULT, codes)
    found, value = DEFAULT.arithmetic.decode(narrow.astype(np.uint64)), FINE.decode(codes)
    nearest = DEFAULT.arithmetic.round(value)
    assert (np.abs(found - value) == np.abs(nearest - value)).all() and (found != nearest).any()
    assert (whole_codes(DEFAULT, narrow, low) - (1 << BITS >> 1) == codes).all()
    assert (whole_depth(DEFAULT, found[:5000], low[:5000]) == value[:5000]).all()


def test_narrowed_ends():
    largest = (1 << FINE.width - 1) - 1
    narrow, _ = narrowed(DEFAULT, np.array([0, largest, 2 * largest + 1]))
    most = (1 << DEFAULT.arithmetic.width - 1) - 1
    assert list(narrow) == [0, most, 2 * most + 1]


def test_keys_rise_and_use_all_their_bits():
    """Half of the keys tell all codes apart, a quarter every second, a quarter the rest."""
    codes = codes_from_near(50_000)
    found, steps = keys(DEFAULT, codes), codes - (NEAR << BITS)
    most = 1 << DEFAULT.sort_key_bits
    assert (np.diff(found) >= 0).all() and found[0] == 0 and found[-1] < most
    lower = steps < most // 2
    assert (found[lower] == steps[lower]).all() and lower.any()
    middle = ~lower & (steps < most)
    assert (found[middle] == most // 2 + (steps[middle] - most // 2) // 2).all() and middle.any()
    coarse = found[steps >= most]
    assert (coarse == most * 3 // 4 + steps[steps >= most] // (1 << key_shift(DEFAULT))).all()


def test_keys_of_nearer_depths_are_zero():
    codes = np.array([(NEAR << BITS) - 1, NEAR << BITS, (NEAR << BITS) + 1])
    assert list(keys(DEFAULT, codes)) == [0, 0, 1]


@pytest.mark.parametrize("config", [PAPER, replace(TINY, depth=replace(TINY.depth, fraction=16))])
def test_machines_whose_depths_are_no_finer(config):
    """Keys are codes from the near plane's on."""
    assert low_bits(config) == 0 == key_shift(config) and low_format(config) == {}
    assert finer(config) == config
    codes = config.arithmetic.encode(np.geomspace(0.1, 1000, 5000)).astype(np.int64)
    steps = codes - int(config.arithmetic.encode(0.2))
    assert (keys(config, codes) == np.maximum(steps, 0)).all()
