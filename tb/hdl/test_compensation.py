"""Opacity compensation: golden units against rationals and formulas, RTL against golden model."""

from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest

from splatcore.golden import compensation as golden
from splatcore.golden.program import run
from splatcore.hdl.points.compensation import Fade, Log, LogSum, Minor, Product, product_layout
from splatcore.spec.compensation import (
    COMPENSATION,
    FADE,
    LOG_FRACTION,
    PRODUCT_BITS,
    log_format,
)
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.microprogram import Program, parse
from splatcore.spec.number import FP16, Float
from splatcore.spec.schedule import LATENCY_OF_COMPENSATION
from tb.helpers.datapaths import Datapath, check, with_pauses

NARROW = replace(DEFAULT, name="narrow", arithmetic=Float(6, 9, subnormal=False))
WIDE = replace(DEFAULT, name="wide", arithmetic=Float(8, 17, subnormal=False))
CONFIGS = {config.name: config for config in (DEFAULT, NARROW, WIDE)}


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


def logarithms(config: Config, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return codes that `minor` and `log` can output."""
    format = log_format(config)
    most = 5 << config.arithmetic.exponent - 1
    values = rng.integers(-most << LOG_FRACTION, most << LOG_FRACTION, count)
    values = np.where(rng.random(count) < 0.7, rng.integers(-9000, 9000, count), values)
    values = np.where(rng.random(count) < 0.05, int(format.min) << LOG_FRACTION, values)
    return values & (1 << format.width) - 1


def product_codes(config: Config, values: np.ndarray) -> np.ndarray:
    """Return the codes of products, in `product_layout`."""
    mantissa, exponent = np.frexp(values)
    significand = np.ldexp(np.abs(mantissa), PRODUCT_BITS).astype(np.int64)
    least = 2 * (1 - config.arithmetic.bias)
    exponent = np.where(values == 0, 0, exponent - 1 - least).astype(np.int64)
    width = product_layout(config)["exponent"].width
    return significand << 1 + width | exponent << 1 | (values < 0)


def products(config: Config, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    """Return codes of pairs of products: unrelated, equal, near each other, or one of them zero."""
    format = config.arithmetic
    a, b, c, d = (format.decode(floats(config, rng, count)) for _ in range(4))
    kind = rng.integers(0, 4, count)
    c = np.where(kind > 0, a, c)
    d = np.where(kind > 0, b, d)
    near = format.round(b * (1 + np.exp2(-rng.integers(1, format.fraction + 1, count))))
    d = np.where(kind > 1, near, d)
    return [product_codes(config, golden.product(config, *pair)) for pair in ((a, b), (c, d))]


def values_of_products(config: Config, codes: np.ndarray) -> np.ndarray:
    """Return the values of product codes (the inverse of `product_codes`)."""
    width = product_layout(config)["exponent"].width
    exponent = (codes >> 1 & (1 << width) - 1) + 2 * (1 - config.arithmetic.bias)
    size = np.ldexp((codes >> 1 + width).astype(float), exponent - (PRODUCT_BITS - 1))
    return np.where(codes & 1, -size, size)


def datapaths(config: Config) -> tuple[list[Datapath], dict[str, np.ndarray]]:
    """Return the units with their golden models and inputs."""
    rng, count = np.random.default_rng(config.arithmetic.width), 6000
    number, log = config.arithmetic, log_format(config)
    p, q = products(config, rng, count)
    inputs = {"a": floats(config, rng, count), "b": floats(config, rng, count)}
    of_logs = {name: logarithms(config, rng, count) for name in "ab"}
    of_logs["b"] = np.where(rng.random(count) < 0.2, of_logs["a"], of_logs["b"])

    def product(a, b):
        return product_codes(config, golden.product(config, number.decode(a), number.decode(b)))

    def minor(a, b, c):
        p, q = (values_of_products(config, codes) for codes in (a, b))
        return log.encode(golden.minor(config, p, q, log.decode(c)))

    def fade(a, b):
        return number.encode(golden.fade(config, log.decode(a), log.decode(b)))

    def log_sum(a, b):
        return log.encode(golden.log_sum(config, log.decode(a), log.decode(b)))

    latency = LATENCY_OF_COMPENSATION
    minors = {"a": p, "b": q, "c": logarithms(config, rng, count)}
    small = log_format(config).integer - 2  # log2 B of a float
    minors["c"] = rng.integers(-1 << small + 8, 1 << small + 8, count) & (1 << log.width) - 1
    ordered = {"a": np.maximum(log.decode(of_logs["a"]), log.decode(of_logs["b"]))}
    ordered = {"a": log.encode(ordered["a"]), "b": of_logs["b"]}
    return [
        (Datapath(Product(config, 2), 2, ("a", "b"), product), inputs),
        (Datapath(Product(config, 0), 0, ("a", "b"), product), inputs),
        (Datapath(Minor(config), latency["minor"], ("a", "b", "c"), minor), minors),
        (Datapath(Log(config), latency["log"], ("a",), partial(_log, config)), inputs),
        (Datapath(LogSum(config), latency["log_sum"], ("a", "b"), log_sum), of_logs),
        (Datapath(Fade(config), latency["fade"], ("a", "b"), fade), ordered),
    ]


def _log(config, a):
    return log_format(config).encode(golden.log(config, config.arithmetic.decode(a)))


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
@pytest.mark.parametrize("unit", range(6), ids="product product_0 minor log log_sum fade".split())
def test_units_equal_the_golden_model(config, unit):
    datapath, inputs = datapaths(config)[unit]
    inputs = {name: inputs[name] for name in datapath.given}
    paused, enable = with_pauses(inputs, np.random.default_rng(unit), 8)
    if unit == 5:  # a ≥ b must hold in the pauses, too
        log = log_format(config)
        larger = np.maximum(log.decode(paused["a"]), log.decode(paused["b"]))
        paused["a"] = log.encode(larger)
    check([datapath], paused, enable)


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
