"""Opacity compensation: golden units against rationals and formulas. `test_colour` compares the
hardware."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from splatcore.golden import compensation as golden
from splatcore.golden.program import run
from splatcore.spec.compensation import COMPENSATION, FADE, PRODUCT_BITS
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.microprogram import Program, parse
from splatcore.spec.number import FP16, Float


def floats(config: Config, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return float codes: some zeros, some of any exponent, most with exponents near 0."""
    format = config.arithmetic
    fraction = rng.integers(0, 1 << format.fraction, count)
    biased = np.where(
        rng.random(count) < 0.3,
        rng.integers(0, 1 << format.exponent, count),
        format.bias + rng.integers(-8, 9, count),
    )
    fraction = np.where(biased > 0, fraction, 0)
    fraction = np.where(rng.random(count) < 0.1, 0, fraction)
    sign = np.where(biased > 0, rng.integers(0, 2, count), 0)
    return (sign << format.exponent | biased) << format.fraction | fraction


def test_products_are_truncated():
    rng, format = np.random.default_rng(1), DEFAULT.arithmetic
    a, b = (format.decode(floats(DEFAULT, rng, 3000)) for _ in range(2))
    for x, y, found in zip(a, b, golden.product(DEFAULT, a, b), strict=True):
        exact, kept = abs(Fraction(x) * Fraction(y)), abs(Fraction(found))
        if not exact:
            assert not kept
            continue
        step = Fraction(2) ** (np.frexp(found)[1].item() - PRODUCT_BITS)
        assert kept <= exact < kept + step and (kept / step).denominator == 1
        assert kept / step >= 1 << PRODUCT_BITS - 1 and (found < 0) == (x * y < 0)


LOG_ERROR, SUM_ERROR = 0.0045, 0.009
"""Error bounds: for a logarithm, half of an interval's slope and two roundings; for a sum, half of
an interval's slope of ½."""


def test_logarithms_and_sums_keep_their_bounds():
    rng, format = np.random.default_rng(2), DEFAULT.arithmetic
    a = format.decode(floats(DEFAULT, rng, 100_000))
    a = a[a != 0]
    assert np.abs(golden.log(DEFAULT, a) - np.log2(np.abs(a))).max() < LOG_ERROR
    x, y = rng.integers(-99 << 9, 99 << 9, (2, 100_000)) / 512
    y = np.where(rng.random(len(x)) < 0.8, x + rng.integers(-4000, 4000, len(x)) / 512, y)
    assert np.abs(golden.log_sum(DEFAULT, x, y) - np.logaddexp2(x, y)).max() < SUM_ERROR


def shapes(rng: np.random.Generator, kind: str, count: int) -> np.ndarray:
    """Return M [N, 2, 3] in pixels, of Gaussians of any shape, of needles whose axis is in one
    column (as in L), or of splats below a pixel."""
    if kind == "any":
        size = np.exp2(rng.uniform(np.log2(0.001), np.log2(1000), (count, 3)))
        return rng.normal(size=(count, 2, 3)) * size[:, None]
    if kind == "tiny":
        size = np.exp2(rng.uniform(np.log2(0.01), 0, (count, 1)))
        return rng.normal(size=(count, 2, 3)) * size[:, None]
    m = rng.normal(size=(count, 2, 3)) * 0.001
    angle = rng.uniform(0, 2 * np.pi, count)
    m[:, :, 0] = 500 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return m


@pytest.mark.parametrize("kind", ["any", "tiny", "needle"])
def test_the_factor_is_within_a_two_hundredth(kind):
    """The program's lines for opacity, on M in the machine's floats, against the exact formula."""
    rng, format, count = np.random.default_rng(3), DEFAULT.arithmetic, 100_000
    z = format.round(np.exp2(rng.uniform(-2, 8, count)))
    m = format.round(shapes(rng, kind, count) * z[:, None, None])
    inputs = {f"m{axis}{k}": m[:, row, k] for row, axis in enumerate("xy") for k in range(3)}
    squares = {f"sum_{axis * 2}": (m[:, row] ** 2).sum(1) for row, axis in enumerate("xy")}
    inputs |= {name: format.round(value) for name, value in squares.items()}
    inputs |= {"z": z, "blur": format.round(0.3), "antialiased": 1.0, "stored_attenuation": 0.0}
    lines = Program("opacity", parse(COMPENSATION), ("attenuation",))
    found = np.exp2(-run(DEFAULT, lines, inputs)["attenuation"] * OPACITY.step)
    m /= z[:, None, None]
    area = (np.cross(m[:, 0], m[:, 1]) ** 2).sum(1)
    exact = np.sqrt(area / (area + 0.3 * (m**2).sum((1, 2)) + 0.09))
    assert np.abs(found - exact).max() < 0.004  # the requirement is 0.005
    unmarked = run(DEFAULT, lines, inputs | {"antialiased": 0.0, "stored_attenuation": 77.0})
    np.testing.assert_array_equal(unmarked["attenuation"], 77)


def test_flat_splats_vanish():
    """With a determinant of 0 the opacity is too small to be visible; no warning, no NaN."""
    rng, format = np.random.default_rng(4), DEFAULT.arithmetic
    row = format.round(rng.normal(size=(1000, 3)))
    zero = np.zeros_like(row)
    for x, y in ((row, row), (row, zero), (zero, zero)):
        inputs = {f"mx{k}": x[:, k] for k in range(3)} | {f"my{k}": y[:, k] for k in range(3)}
        inputs |= {"sum_xx": format.round((x**2).sum(1)), "sum_yy": format.round((y**2).sum(1))}
        inputs |= {"z": np.full(1000, 2.0), "blur": format.round(0.3), "antialiased": 1.0}
        lines = Program("opacity", parse(COMPENSATION), ("attenuation",))
        found = run(DEFAULT, lines, inputs | {"stored_attenuation": 0.0})["attenuation"]
        np.testing.assert_array_equal(found, FADE.max)


@pytest.mark.parametrize("format", [FP16, Float(7, 16)], ids=["infinity", "subnormal"])
def test_other_arithmetic_does_not_compensate(format):
    assert DEFAULT.compensates and TINY.compensates
    assert not replace(DEFAULT, arithmetic=format).compensates
