"""Half-beat attributes against exact rationals, and the hardware that expands them."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.sim import Simulator

from splatcore.hdl.points.small import expanded as in_hardware
from splatcore.spec.config import DEFAULT
from splatcore.spec.memory import BELOW, ON_DIAGONAL, OPACITY, SMALL_OPACITY, model_format
from splatcore.spec.small import (
    EXPONENT_LAST,
    FACTOR_MAX,
    LARGEST,
    UNIT,
    expanded,
    factor_codes,
    rounded_factor,
)

FORMAT = model_format(DEFAULT, 1, small=True)
NAMES = (*ON_DIAGONAL, *BELOW)


def halves(seed: int) -> dict[str, np.ndarray]:
    """Return codes with all exponents, magnitudes and signs, in each element of L; the rest is
    random."""
    exponent, magnitude = np.array([*product(range(32), range(32))]).T
    rng = np.random.default_rng(seed)
    codes = {"exponent": exponent}
    for name in NAMES:
        width = FORMAT.stored_record[name].width
        codes[name] = rng.permutation(magnitude.reshape(32, 32), axis=1).reshape(-1) % (1 << width)
    for name, format in FORMAT.stored_record.fields[7:]:
        codes[name] = rng.integers(0, 1 << format.width, len(exponent))
    return {name: values.astype(np.uint64) for name, values in codes.items()}


def test_expanded_values():
    """Every element of L is ± m · 2^(e + UNIT), and every opacity keeps its value."""
    codes = halves(0)
    whole, record = expanded(codes), FORMAT.attribute_record
    used = codes["exponent"] <= EXPONENT_LAST
    assert 0 < used.sum() < len(used)
    for name in NAMES:
        sign, m = np.divmod(codes[name].astype(int), LARGEST + 1)
        exact = [
            (-1) ** int(s) * int(k) * Fraction(2) ** (int(e) + UNIT)
            for s, k, e in zip(sign, m, codes["exponent"], strict=True)
        ]
        found = record[name].decode(whole[name])
        assert all(Fraction(f) == e for f, e, u in zip(found, exact, used, strict=True) if u)
    decoded = OPACITY.decode(whole["opacity"]), SMALL_OPACITY.decode(codes["opacity"])
    assert (decoded[0] == decoded[1]).all()
    assert set(whole) == set(dict(record.fields))


def test_hardware_makes_the_same_beats():
    """Also for exponents that no model has."""
    codes = halves(1)
    stored = FORMAT.stored_record.pack(codes).view("<u8")[:, 0]
    beats = FORMAT.attribute_record.pack(expanded(codes)).view("<u8")
    half, whole = Signal(64), Signal(128)
    m = Module()
    m.d.comb += whole.eq(in_hardware(half))
    simulator, found = Simulator(m), []

    async def run(context):
        for word in stored:
            context.set(half, int(word))
            await context.delay(1e-9)
            found.append(context.get(whole))

    simulator.add_testbench(run)
    simulator.run()
    assert found == [int(low) | int(high) << 64 for low, high in beats]


@pytest.mark.parametrize("seed", range(3))
def test_rounding(seed):
    """Errors are at most half a step, about a fifteenth of the largest element; rounded values are
    fixed points, and have codes."""
    rng = np.random.default_rng(seed)
    size = np.exp2(rng.uniform(UNIT + 4, EXPONENT_LAST + UNIT + 3, (5000, 1, 1)))
    lower = np.tril(rng.uniform(-1, 1, (5000, 3, 3)) * size)
    lower[:, range(3), range(3)] = np.abs(lower[:, range(3), range(3)])
    lower[0, 2, 2] = FACTOR_MAX * (1 - 2**-40)
    lower[1] = 0
    rounded = rounded_factor(lower)
    largest = np.abs(lower).max((1, 2))
    assert (np.abs(rounded - lower).max((1, 2)) <= largest / 15.5 + 2.0 ** (UNIT - 1)).all()
    assert np.abs(rounded - lower).max() > 0
    assert (rounded_factor(rounded) == rounded).all()
    codes = factor_codes(rounded) | {"opacity": np.zeros(len(lower), np.uint64)}
    whole, record = expanded(codes), FORMAT.attribute_record
    for name in NAMES:
        row, column = int(name[1]), int(name[2])
        assert (record[name].decode(whole[name]) == rounded[:, row, column]).all()
