"""Float hardware against its golden model: all pairs of small formats, a million hard pairs.
Conversions with a scale against exact values: fixed point times any power of two, and back."""

from collections.abc import Callable
from functools import cache, partial
from itertools import product

import numpy as np
import pytest
from amaranth.back import verilog

from splatcore.golden import arithmetic
from splatcore.hdl.arithmetic.add import Add, MultiplyAdd
from splatcore.hdl.arithmetic.compare import Compare
from splatcore.hdl.arithmetic.convert import Convert, FromFixed, ToFixed
from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.spec.number import FP16, FP24, Fixed, Float
from tb.helpers.datapaths import Datapath, check, with_pauses
from tb.helpers.float_pairs import every_pair, pairs

pytestmark = pytest.mark.slow  # every test compiles hardware

GRADUAL = Float(7, 16)
EIGHT_BITS = [
    Float(3, 2),
    Float(4, 3),
    Float(4, 3, subnormal=False),
    Float(3, 4, overflow="infinity"),
    Float(2, 2, subnormal=False, overflow="infinity"),
    Float(2, 4, signed=False),
    Float(4, 4, signed=False, subnormal=False),
]

OPERATIONS = (
    (Multiply, arithmetic.multiply, "ab", ("o",)),
    (Add, arithmetic.add, "ab", ("o",)),
    (MultiplyAdd, arithmetic.multiply_add, "abc", ("o",)),
    (Compare, arithmetic.compare, "ab", ("less", "equal")),
)


def operations(format: Float, latency: int, kinds=OPERATIONS) -> list[Datapath]:
    """Return all operations of a format at a latency."""
    return [
        Datapath(make(format, latency), latency, tuple(given), partial(golden, format), read)
        for make, golden, given, read in kinds
    ]


def hard(formats: list[Float], count: int) -> dict[str, np.ndarray]:
    """Return hard a and b of all the formats; c is near −a · b, or random."""
    rng = np.random.default_rng(1)
    parts = []
    for format in formats:
        a, b = pairs(format, rng, count // len(formats))
        product = arithmetic.multiply(format, a, b).astype(np.int64)
        close = (product ^ (format.signed << (format.width - 1))) + rng.integers(-2, 3, len(a))
        close = np.clip(close, 0, (1 << format.width) - 1).astype(a.dtype)
        parts.append((a, b, np.where(rng.integers(0, 2, len(a)), close, rng.permutation(b))))
    return dict(zip("abc", map(np.concatenate, zip(*parts, strict=True)), strict=True))


@cache
def small() -> list[Datapath]:
    """Return all operations at all latencies, from 0 to more registers than places for them."""
    found = []
    for format, latency in zip(EIGHT_BITS, (0, 3, 1, 2, 4, 5, 9), strict=True):
        found += operations(format, latency)
    for format, latency in zip(EIGHT_BITS[1:], (6, 7, 8, 10, 11, 12), strict=True):
        found += operations(format, latency, OPERATIONS[2:3])
    return found


@cache
def large() -> list[Datapath]:
    """Return operations on formats of 16 and 24 bits."""
    formats = ((FP16, 3), (Float(5, 10), 0), (FP24, 2), (FP24, 5), (GRADUAL, 4))
    return [part for format, latency in formats for part in operations(format, latency)]


def test_every_pair():
    """Formats of up to 8 bits: all pairs; c is random."""
    a, b = every_pair(8)
    c = np.random.default_rng(2).integers(0, 256, len(a)).astype(np.uint8)
    check(small(), {"a": a, "b": b, "c": c})


def test_every_triple():
    """Multiply-add of the smallest format: all triples."""
    a, b = every_pair(9)
    codes = np.stack([a & 63, b & 63, a >> 6 | b >> 6 << 3]).astype(np.uint8)
    check(small(), dict(zip("abc", codes, strict=True)))


def test_hard_pairs():
    check(large(), hard([FP16, Float(5, 10), FP24, GRADUAL], 1_000_000))


def test_enable_freezes():
    """With `enable` low in half of the cycles, at times for long, nothing is lost or enters."""
    rng = np.random.default_rng(3)
    inputs = hard(EIGHT_BITS, 20_000)
    count = len(inputs["a"])
    enable = rng.integers(0, 2, count)
    enable[count // 2 :] = np.repeat(rng.integers(0, 2, count), 16)[: count - count // 2]
    check(small(), inputs, enable)


FIXED = [
    Fixed(6, 5, True),
    Fixed(0, 12, True, "floor"),
    Fixed(10, -3, False, "ceiling"),
    Fixed(-6, 20, False, "floor"),
    Fixed(1, 0, True, "ceiling"),
    Fixed(20, 10, True),
]
FLOATS = [
    FP16,
    Float(5, 10),
    FP24,
    GRADUAL,
    Float(4, 8, signed=False),
    Float(6, 6, signed=False, subnormal=False, overflow="infinity"),
]


def conversions() -> list[Datapath]:
    """Return converters between all formats, at latencies 0 … 4 in turn."""
    kinds = [(Convert, arithmetic.convert, *formats) for formats in product(FLOATS, FLOATS)]
    mixed = list(product(FIXED, FLOATS[::2]))
    kinds += [(FromFixed, arithmetic.from_fixed, fixed, float) for fixed, float in mixed]
    kinds += [(ToFixed, arithmetic.to_fixed, float, fixed) for fixed, float in mixed]
    found = [
        Datapath(make(*formats, k % 5), k % 5, ("i",), partial(golden, *formats))
        for k, (make, golden, *formats) in enumerate(kinds)
    ]
    for formats, scale in product(product(FLOATS[::2], FLOATS), (-7, 18)):
        scaled = partial(arithmetic.convert, *formats, scale=scale)
        found.append(Datapath(Convert(*formats, 0, scale), 0, ("i",), scaled))
    return found


def test_conversions():
    """All codes of 16 bits; for wider formats also these bits at either end, and hard codes."""
    codes = np.arange(1 << 16, dtype=np.uint32)
    hard_codes, _ = pairs(FP24, np.random.default_rng(4), 100_000)
    check(conversions(), {"i": np.concatenate([codes, codes << 8, codes << 15, hard_codes])})


@pytest.mark.parametrize("make", [Multiply, Add, MultiplyAdd])
def test_no_empty_ranges(make):
    """Verilog has no zero-width vectors: signals that a format does not need are left out."""
    for format in (FP16, FP24, Float(2, 2, subnormal=False, overflow="infinity"), Float(3, 2)):
        assert "[-1:0]" not in verilog.convert(make(format, 5), name="top")


SMALLEST = Float(3, 3, subnormal=False)


def canonical(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return codes that encoding can give, with a single zero."""
    return format.encode(format.decode(codes.astype(np.uint64)))


def maximum(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return format.encode(np.maximum(format.decode(a), format.decode(b)))


def clamp(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Clamp a to ±b; a negative number clamped to 0 is the sign alone, which reads as 0."""
    bound, sign = format.decode(b), format.width - 1
    found = format.encode(np.clip(format.decode(a), -bound, bound))
    return found | (a >> sign & 1) << sign


def positive(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return whether b is a valid bound, i.e. not negative."""
    return b >> format.width - 1 == 0


@pytest.mark.parametrize("format", [SMALLEST, FP24], ids=str)
def test_clamp_and_maximum(format):
    """All pairs of a small format, hard pairs of FP24; in pauses the output holds."""
    size, rng = 1 << format.width, np.random.default_rng(0)
    if format is SMALLEST:
        a, b = (codes.ravel() for codes in np.mgrid[:size, :size])
    else:
        a = rng.integers(0, size, 100_000)
        near = np.clip(a + rng.integers(-1, 2, a.size), 0, size - 1)
        b = np.where(rng.random(a.size) < 0.5, near, rng.integers(0, size, a.size))
        b ^= rng.integers(0, 2, a.size) << format.width - 1
    given, where = ("a", "b"), partial(positive, format)
    units = [
        Datapath(Maximum(format), 1, given, partial(maximum, format)),
        Datapath(Clamp(format), 1, given, partial(clamp, format), where=where),
    ]
    inputs = {"a": canonical(format, a), "b": canonical(format, b)}
    check(units, *with_pauses(inputs, rng, 2))


CODE_BITS = 13
SCALED_FIXED = [
    Fixed(3, 4, True),
    Fixed(7, 0, False),
    Fixed(1, 0, True),
    Fixed(-3, 9, True),
    Fixed(1, 0, False),
    Fixed(12, 0, True),
    Fixed(10, 3, False),
]
"""At most `CODE_BITS` wide, so that every code is tried."""

SCALED_FLOATS = [
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


def exact_from(fixed: Fixed, format: Float, code: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the exact results. Float64 holds every product that is in a format's range."""
    with np.errstate(over="ignore", under="ignore"):
        return format.encode(np.ldexp(fixed.decode(code & (1 << fixed.width) - 1), scale))


def exact_to(format: Float, fixed: Fixed, code: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return fixed.encode(np.ldexp(format.decode(code & (1 << format.width) - 1), scale))


def scaled(make: type, exact: Callable, cases: list[tuple], latencies: int) -> list[Datapath]:
    """Return converters at `latencies` latencies in turn, each compared only at its own scales.

    cases: both formats, and the range of scales
    """
    found = []
    for number, (*formats, scales) in enumerate(cases):
        component = make(*formats, number % latencies, scales)
        assert component.scale.shape().signed
        sign = 1 << len(component.scale) - 1

        def golden(code, scale, formats=formats, sign=sign):
            return exact(*formats, code, (scale ^ sign) - sign)

        def where(code, scale, scales=scales, sign=sign):
            scale = (scale ^ sign) - sign
            return (scale >= scales[0]) & (scale <= scales[-1])

        inputs = ("i", "scale")
        found.append(Datapath(component, number % latencies, inputs, golden, where=where))
    return found


def from_fixed(cases: list[tuple]) -> list[Datapath]:
    return scaled(FromFixed, exact_from, cases, 7)


def every(width: int, scales) -> dict[str, np.ndarray]:
    """Return all codes of `width` bits at all scales, in random order."""
    code, scale = np.meshgrid(np.arange(1 << width), np.fromiter(scales, int), indexing="ij")
    order = np.random.default_rng(width).permutation(code.size)
    return {"i": code.reshape(-1)[order], "scale": scale.reshape(-1)[order]}


def test_every_code_at_every_scale():
    """More than half of all pairs of formats, each format in at least three pairs."""
    pairs = enumerate(product(SCALED_FIXED, SCALED_FLOATS))
    chosen = [(fixed, format, NEAR) for k, (fixed, format) in pairs if k % 7 < 4]
    check(from_fixed(chosen), every(CODE_BITS, NEAR))


def test_far_scales():
    """Scales at both ends, around zero, around powers of two, and random ones."""
    rng = np.random.default_rng(5)
    ends = [*NEAR, *range(FAR[0], FAR[0] + 9), *range(FAR[-1] - 9, FAR[-1] + 1)]
    ends += [sign * (1 << bit) + k for sign in (-1, 1) for bit in range(6, 15) for k in (-1, 0, 1)]
    code, scale = every(8, ends).values()
    code = np.concatenate([code, code << 5 | code >> 3, rng.integers(0, 1 << CODE_BITS, 200_000)])
    scale = np.concatenate([scale, scale, rng.integers(FAR[0], FAR[-1] + 1, 200_000)])
    cases = [(SCALED_FIXED[-2 + k % 2], format, FAR) for k, format in enumerate(SCALED_FLOATS)]
    check(from_fixed(cases), {"i": code, "scale": scale})


def test_ranges_on_one_side():
    """With `enable` low in some cycles, a scale stays with its number."""
    ranges = [range(-60, -50), range(20, 30), range(-9, -8), range(6), NEAR]
    cases = [
        (SCALED_FIXED[k % 2], format, scales)
        for k, (format, scales) in enumerate(product(SCALED_FLOATS[::3], ranges))
    ]
    # Only subnormal values; the largest rounds up to the smallest normal one.
    cases.append((SCALED_FIXED[-1], FP16, range(-30, -23)))
    inputs = every(8, range(-60, 41))
    inputs["i"] |= inputs["i"] << 8
    check(from_fixed(cases), *with_pauses(inputs, np.random.default_rng(6), 7))


def test_to_fixed_of_every_code_at_a_scale():
    """`ToFixed` with a scale: all codes of short formats, at both ends of the scale."""
    scales = range(-1, 3)
    formats = Float(7, 3, subnormal=False), Float(4, 3, subnormal=False), Float(5, 5), Float(3, 4)
    fixed = Fixed(1, 11, True), Fixed(3, 4, True), Fixed(7, 2, False), Fixed(-3, 9, True)
    cases = list(product(formats, fixed, [scales]))
    check(scaled(ToFixed, exact_to, cases, 3), every(11, scales))
