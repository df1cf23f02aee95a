"""Depths in the finer format, and the sort keys made of them, against exact integers."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.spec import depth
from splatcore.spec.camera import NEAR_LIMITS
from splatcore.spec.config import DEFAULT, PAPER, PRESETS, TINY

FINE = depth.finer(DEFAULT).arithmetic
BITS = depth.low_bits(DEFAULT)
BASE = int(FINE.encode(np.nextafter(0.2, 0))) >> BITS << BITS


def keys(config, codes: np.ndarray) -> np.ndarray:
    """Return the keys [N] of depth codes [N] in the `finer` format."""
    return depth.depth_keys(config, *depth.narrowed(config, codes)).astype(np.int64)


def codes_around(first: int, count: int) -> np.ndarray:
    """Return codes ≥ `first`: all near it, near the base and near each power of two, and `count`
    random ones."""
    last = (1 << FINE.width - 1) - 1
    exponents = np.arange(first >> FINE.fraction, 1 << FINE.exponent) << FINE.fraction
    close = (exponents[:, None] + np.arange(-40, 41)).ravel()
    between = np.random.default_rng(0).integers(first, last, count)
    codes = np.concatenate([first + np.arange(40), BASE + np.arange(-40, 40), close, between])
    return np.unique(codes[(first <= codes) & (codes < last - (1 << BITS))])


def test_narrowed_is_nearest():
    """The narrow code is the nearest one, for negative values too; with the low bits it restores
    the fine code."""
    values = np.concatenate([s * np.geomspace(0.01, 1e5, 5000) for s in (1, -1)])
    codes = FINE.encode(values).astype(np.int64)
    narrow, low = depth.narrowed(DEFAULT, codes)
    found, value = DEFAULT.arithmetic.decode(narrow.astype(np.uint64)), FINE.decode(codes)
    nearest = DEFAULT.arithmetic.round(value)
    assert (np.abs(found - value) == np.abs(nearest - value)).all() and (found != nearest).any()
    assert (depth.whole_codes(DEFAULT, narrow, low) - (1 << BITS >> 1) == codes).all()
    assert (depth.whole_depth(DEFAULT, found[:5000], low[:5000]) == value[:5000]).all()


def test_narrowed_ends():
    largest = (1 << FINE.width - 1) - 1
    narrow, _ = depth.narrowed(DEFAULT, np.array([0, largest, 2 * largest + 1]))
    most = (1 << DEFAULT.arithmetic.width - 1) - 1
    assert list(narrow) == [0, most, 2 * most + 1]


def test_keys_rise_and_use_all_their_bits():
    """From the base on, half of the keys resolve every code, a quarter every second code, the rest
    coarser steps."""
    codes = codes_around(BASE, 50_000)
    most = 1 << DEFAULT.sort_key_bits
    found, steps = keys(DEFAULT, codes) - most // 16, codes - BASE
    assert (np.diff(found) >= 0).all() and found[0] == 0 and found[-1] < most * 15 // 16
    lower = steps < most // 2
    assert (found[lower] == steps[lower]).all() and lower.any()
    middle = ~lower & (steps < most)
    assert (found[middle] == most // 2 + (steps[middle] - most // 2) // 2).all() and middle.any()
    coarse = found[steps >= most]
    assert (coarse == most * 3 // 4 + steps[steps >= most] // (1 << depth.key_shift(DEFAULT))).all()


def test_keys_below_the_base():
    """Keys below the base rise, down to the smallest near plane, in steps of 32 codes."""
    codes = codes_around(int(FINE.encode(NEAR_LIMITS[0])), 50_000)
    below = codes[codes < BASE]
    found = keys(DEFAULT, below)
    assert (np.diff(keys(DEFAULT, codes)) >= 0).all() and found[0] > 0
    assert (found == (1 << depth.below_bits(DEFAULT)) + ((below - BASE) // 32)).all()
    assert keys(DEFAULT, np.arange(100)).max() == 0


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_every_machine_orders_all_depths(preset):
    """From the smallest near plane to the largest depth, keys rise and fit their bits."""
    format = depth.finer(preset).arithmetic
    codes = np.array([format.encode(NEAR_LIMITS[0]), (1 << format.width - 1) - 1], np.int64)
    first, last = depth.depth_keys(preset, *depth.narrowed(preset, codes)).astype(np.int64)
    assert 0 < first < last < 1 << preset.sort_key_bits


@pytest.mark.parametrize("config", [PAPER, replace(TINY, depth=replace(TINY.depth, fraction=16))])
def test_machines_whose_depths_are_no_finer(config):
    """Without a finer format, keys are depth codes."""
    assert depth.low_bits(config) == 0 == depth.key_shift(config) and depth.low_format(config) == {}
    assert depth.finer(config) == config
    codes = config.arithmetic.encode(np.geomspace(0.1, 1000, 5000)).astype(np.int64)
    assert (keys(config, codes) == codes).all()
