"""Conversions with a scale against exact values: fixed point times any power of two, and back."""

from itertools import product

import numpy as np
import pytest

from splatcore.hdl.arithmetic.convert import FromFixed, ToFixed
from splatcore.spec.number import FP16, FP24, Fixed, Float
from tb.helpers.datapaths import Datapath, check, with_pauses

CODE_BITS = 13
FIXED = [
    Fixed(3, 4, True),
    Fixed(7, 0, False),
    Fixed(1, 0, True),
    Fixed(-3, 9, True),
    Fixed(1, 0, False),
    Fixed(12, 0, True),
    Fixed(10, 3, False),
]
"""At most `CODE_BITS` wide, so that every code is tried."""

FLOATS = [
    FP16,
    Float(5, 10),
    FP24,
    Float(7, 16),
    Float(3, 2),
    Float(3, 4, overflow="infinity"),
    Float(4, 3, subnormal=False),
    Float(2, 2, subnormal=False, overflow="infinity"),
    Float(2, 4, signed=False),
    Float(4, 4, signed=False, subnormal=False),
]

NEAR = range(-40, 41)
FAR = range(-(1 << 15), 1 << 15)  # the range of a header's 16-bit exponent


def exact(fixed: Fixed, format: Float, code: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the exact results. Float64 holds every product that is in a format's range."""
    code = code & ((1 << fixed.width) - 1)
    with np.errstate(over="ignore", under="ignore"):
        return format.encode(np.ldexp(fixed.decode(code), scale))


def scaled(cases: list[tuple[Fixed, Float, range]]) -> list[Datapath]:
    """Return converters at latencies 0 … 6 in turn, each compared only at its own scales."""
    return [converter(*case, number % 7) for number, case in enumerate(cases)]


def converter(fixed: Fixed, format: Float, scales: range, latency: int) -> Datapath:
    component = FromFixed(fixed, format, latency, scales)
    assert component.scale.shape().signed
    sign = 1 << len(component.scale) - 1

    def golden(code, scale):
        return exact(fixed, format, code, (scale ^ sign) - sign)

    def where(code, scale):
        scale = (scale ^ sign) - sign
        return (scale >= scales[0]) & (scale <= scales[-1])

    return Datapath(component, latency, ("i", "scale"), golden, where=where)


def every(width: int, scales) -> dict[str, np.ndarray]:
    """Return all codes of `width` bits at all scales, in random order."""
    code, scale = np.meshgrid(np.arange(1 << width), np.fromiter(scales, int), indexing="ij")
    order = np.random.default_rng(width).permutation(code.size)
    return {"i": code.reshape(-1)[order], "scale": scale.reshape(-1)[order]}


@pytest.mark.slow
def test_every_code_at_every_scale():
    """More than half of all pairs of formats, each format in at least three pairs."""
    pairs = enumerate(product(FIXED, FLOATS))
    chosen = [(fixed, format, NEAR) for k, (fixed, format) in pairs if k % 7 < 4]
    check(scaled(chosen), every(CODE_BITS, NEAR))


@pytest.mark.slow
def test_far_scales():
    """Scales at both ends, around zero, around powers of two, and random ones."""
    rng = np.random.default_rng(5)
    ends = [*NEAR, *range(FAR[0], FAR[0] + 9), *range(FAR[-1] - 9, FAR[-1] + 1)]
    ends += [sign * (1 << bit) + k for sign in (-1, 1) for bit in range(6, 15) for k in (-1, 0, 1)]
    code, scale = every(8, ends).values()
    code = np.concatenate([code, code << 5 | code >> 3, rng.integers(0, 1 << CODE_BITS, 200_000)])
    scale = np.concatenate([scale, scale, rng.integers(FAR[0], FAR[-1] + 1, 200_000)])
    cases = [(FIXED[-2 + k % 2], format, FAR) for k, format in enumerate(FLOATS)]
    check(scaled(cases), {"i": code, "scale": scale})


@pytest.mark.slow
def test_ranges_on_one_side():
    """With `enable` low in some cycles, a scale stays with its number."""
    ranges = [range(-60, -50), range(20, 30), range(-9, -8), range(6), NEAR]
    cases = [
        (FIXED[k % 2], format, scales)
        for k, (format, scales) in enumerate(product(FLOATS[::3], ranges))
    ]
    # Only subnormal values; the largest rounds up to the smallest normal one.
    cases.append((FIXED[-1], FP16, range(-30, -23)))
    inputs = every(8, range(-60, 41))
    inputs["i"] |= inputs["i"] << 8
    check(scaled(cases), *with_pauses(inputs, np.random.default_rng(6), 7))


def test_to_fixed_of_every_code_at_a_scale():
    """`ToFixed` with a scale: all codes of short formats, at both ends of the scale."""
    scales = range(-1, 3)

    def datapath(format: Float, fixed: Fixed, latency: int) -> Datapath:
        component = ToFixed(format, fixed, latency, scales)
        sign = 1 << len(component.scale) - 1

        def golden(code, scale):
            values = format.decode(code & (1 << format.width) - 1)
            return fixed.encode(np.ldexp(values, (scale ^ sign) - sign))

        def where(code, scale):
            scale = (scale ^ sign) - sign
            return (scale >= scales[0]) & (scale <= scales[-1])

        return Datapath(component, latency, ("i", "scale"), golden, where=where)

    formats = Float(7, 3, subnormal=False), Float(4, 3, subnormal=False), Float(5, 5), Float(3, 4)
    fixed = Fixed(1, 11, True), Fixed(3, 4, True), Fixed(7, 2, False), Fixed(-3, 9, True)
    pairs = product(formats, fixed)
    check([datapath(*pair, k % 3) for k, pair in enumerate(pairs)], every(11, scales))
