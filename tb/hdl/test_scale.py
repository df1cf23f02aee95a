"""`FromFixed` with a scale against exact values: fixed point times any power of two, as a float."""

from itertools import product

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.convert import FromFixed
from splatcore.sim.rtl import vectors
from splatcore.spec.number import FP16, FP24, Fixed, Float

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
"""At most `CODE_BITS` wide: every code is tried."""

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
FAR = range(-(1 << 15), 1 << 15)
"""As far as a header's exponent of 16 bits goes."""


Case = tuple[Fixed, Float, range]


class Bench(wiring.Component):
    """Converters side by side on the same inputs; outputs are named after their numbers."""

    def __init__(self, converters: list[FromFixed]):
        self.converters = converters
        self.widths = {
            name: max(len(getattr(converter, name)) for converter in converters)
            for name in ("i", "scale", "enable")
        }
        outputs = {f"o{k}": Out(len(converter.o)) for k, converter in enumerate(converters)}
        super().__init__({name: In(width) for name, width in self.widths.items()} | outputs)

    def elaborate(self, platform) -> Module:
        m = Module()
        for number, converter in enumerate(self.converters):
            m.submodules[f"converter{number}"] = converter
            for name in self.widths:
                m.d.comb += getattr(converter, name).eq(getattr(self, name))
            m.d.comb += getattr(self, f"o{number}").eq(converter.o)
        return m


def exact(fixed: Fixed, format: Float, code: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """What must come out. Float64 holds the product, or it is past both ends of any format."""
    code = code & ((1 << fixed.width) - 1)
    with np.errstate(over="ignore", under="ignore"):
        return format.encode(np.ldexp(fixed.decode(code), scale))


def check(cases: list[Case], code: np.ndarray, scale: np.ndarray, enable=1) -> None:
    """Codes [N] and scales [N], one a cycle; those of cycles without `enable` leave no trace.

    A case is checked where the scale is one of its own.
    """
    latencies = [number % 7 for number in range(len(cases))]
    bench = Bench(
        [
            FromFixed(fixed, format, latency, scales)
            for (fixed, format, scales), latency in zip(cases, latencies, strict=True)
        ]
    )
    assert all(converter.scale.shape().signed for converter in bench.converters)
    driven = {"i": code, "scale": scale, "enable": enable}
    driven = {name: driven[name] & (1 << bits) - 1 for name, bits in bench.widths.items()}
    samples = vectors.run(bench, driven)
    taken = np.flatnonzero(np.broadcast_to(enable, len(code)))
    for number, ((fixed, format, scales), latency) in enumerate(zip(cases, latencies, strict=True)):
        source = taken[: len(taken) - latency]
        own = (scale[source] >= scales[0]) & (scale[source] <= scales[-1])
        found = samples[f"o{number}"][taken[latency:]][own]
        expected = exact(fixed, format, code[source[own]], scale[source[own]])
        message = f"{fixed}, {format}, {scales}, latency {latency}"
        np.testing.assert_array_equal(found, expected, message)


def every(width: int, scales) -> tuple[np.ndarray, np.ndarray]:
    """All codes of `width` bits at all scales, in no order."""
    code, scale = np.meshgrid(np.arange(1 << width), np.fromiter(scales, int), indexing="ij")
    order = np.random.default_rng(width).permutation(code.size)
    return code.reshape(-1)[order], scale.reshape(-1)[order]


@pytest.mark.slow
def test_every_code_at_every_scale():
    check(list(product(FIXED, FLOATS, [NEAR])), *every(CODE_BITS, NEAR))


@pytest.mark.slow
def test_far_scales():
    """Both ends, what is around them, around zero and around powers of two, and any."""
    rng = np.random.default_rng(5)
    ends = [*NEAR, *range(FAR[0], FAR[0] + 9), *range(FAR[-1] - 9, FAR[-1] + 1)]
    ends += [sign * (1 << bit) + k for sign in (-1, 1) for bit in range(6, 15) for k in (-1, 0, 1)]
    code, scale = every(8, ends)
    code = np.concatenate([code, code << 5 | code >> 3, rng.integers(0, 1 << CODE_BITS, 200_000)])
    scale = np.concatenate([scale, scale, rng.integers(FAR[0], FAR[-1] + 1, 200_000)])
    check(list(product(FIXED[-2:], FLOATS, [FAR])), code, scale)


@pytest.mark.slow
@pytest.mark.parametrize("stalls", [False, True])
def test_ranges_on_one_side(stalls):
    """With `enable` low in half of the cycles as well: a scale waits with its number."""
    ranges = [range(-60, -50), range(20, 30), range(-9, -8), range(6), NEAR]
    cases = list(product(FIXED[:2], FLOATS[::3], ranges))
    # Nothing but subnormal values, the largest of which rounds up to the smallest normal one.
    cases.append((FIXED[-1], FP16, range(-30, -23)))
    code, scale = every(8, range(-60, 41))
    code |= code << 8
    enable = np.random.default_rng(6).integers(0, 2, len(code)) if stalls else 1
    check(cases, code, scale, enable)


def test_scales_cover_all_that_differ():
    """Beyond either end of `FromFixed.scales` nothing changes, and its ends are not far out."""
    for fixed in FIXED:
        code = np.arange(1 << fixed.width)
        for format in FLOATS:
            scales = FromFixed.scales(fixed, format)
            for end, step in ((scales[0], -1), (scales[-1], 1)):
                there = exact(fixed, format, code, np.full(len(code), end))
                for beyond in (1, 2, 3, 100):
                    further = exact(fixed, format, code, np.full(len(code), end + step * beyond))
                    np.testing.assert_array_equal(there, further, f"{fixed}, {format}, {beyond}")
                within = exact(fixed, format, code, np.full(len(code), end - 4 * step))
                assert (there != within).any()
