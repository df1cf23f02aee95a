"""Float hardware against its twin: every pair of small formats, a million hard ones of large.

Many components share one simulation, for compiling it takes most of the time: a bench gives each
of them the lowest bits of the same inputs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import pytest
from amaranth.back import verilog
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.golden import arithmetic
from splatcore.hdl.arithmetic.add import Add
from splatcore.hdl.arithmetic.compare import Compare
from splatcore.hdl.arithmetic.convert import Convert, FromFixed, ToFixed
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.arithmetic.multiply_add import MultiplyAdd
from splatcore.sim.rtl import vectors
from splatcore.spec.number import FP16, FP24, Fixed, Float
from tb.helpers.float_pairs import every_pair, pairs

pytestmark = pytest.mark.slow
"""Every test compiles hardware."""

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
SIXTEEN_BITS = [FP16, Float(5, 10)]
TWENTY_FOUR_BITS = [FP24, GRADUAL]


@dataclass(frozen=True)
class Case:
    """A component, and its twin: a function of the inputs that are named `given`."""

    component: wiring.Component
    latency: int
    given: tuple[str, ...]
    twin: Callable
    read: tuple[str, ...] = ("o",)

    def expected(self, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What must come out, by output port."""
        codes = []
        for name in self.given:
            width = len(getattr(self.component, name))
            codes.append(inputs[name] & inputs[name].dtype.type((1 << width) - 1))
        results = self.twin(*codes)
        return dict(zip(self.read, results if len(self.read) > 1 else (results,), strict=True))


class Bench(wiring.Component):
    """All components side by side; outputs are named after the case's number."""

    def __init__(self, cases: list[Case]):
        self.cases = cases
        ports = {"enable": In(1)}
        for number, case in enumerate(cases):
            for name in case.given:
                width = max(len(getattr(case.component, name)), ports.get(name, In(0)).shape)
                ports[name] = In(width)
            for name in case.read:
                ports[f"{name}_{number}"] = Out(len(getattr(case.component, name)))
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        for number, case in enumerate(self.cases):
            m.submodules[f"case_{number}"] = component = case.component
            for name in ("enable", *case.given):
                m.d.comb += getattr(component, name).eq(getattr(self, name))
            for name in case.read:
                m.d.comb += getattr(self, f"{name}_{number}").eq(getattr(component, name))
        return m


def operations(format: Float, latencies: tuple[int, ...]) -> list[Case]:
    """All operations of a format at some latencies."""
    cases = []
    for latency in latencies:
        for make, twin, given in (
            (Multiply, arithmetic.multiply, "ab"),
            (Add, arithmetic.add, "ab"),
            (MultiplyAdd, arithmetic.multiply_add, "abc"),
        ):
            component = make(format, latency)
            cases.append(Case(component, latency, tuple(given), partial(twin, format)))
        compare = partial(arithmetic.compare, format)
        component = Compare(format, latency)
        cases.append(Case(component, latency, ("a", "b"), compare, ("less", "equal")))
    return cases


def check(cases: list[Case], inputs: dict[str, np.ndarray], enable: np.ndarray | int = 1) -> None:
    """Inputs [N] go in one a cycle; those of cycles without `enable` must leave no trace."""
    samples = vectors.run(Bench(cases), inputs | {"enable": enable})
    count = len(next(iter(inputs.values())))
    moves = np.flatnonzero(np.broadcast_to(enable, count))
    for number, case in enumerate(cases):
        for port, expected in case.expected(inputs).items():
            got = samples[f"{port}_{number}"]
            # Sample n shows what has moved before cycle n, and without registers cycle n itself.
            moved = np.searchsorted(moves, np.arange(count))
            item = moved - case.latency
            known = item >= 0
            source = moves[np.minimum(item[known], len(moves) - 1)]
            if case.latency == 0:
                known, source = slice(None), slice(None)
            np.testing.assert_array_equal(
                got[known], expected[source], f"{type(case.component).__name__}: {case}, {port}"
            )


def hard(formats: list[Float], count: int) -> dict[str, np.ndarray]:
    """Hard a and b of all the formats; c near −a · b, or any."""
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
def cases_of(width: int) -> list[Case]:
    """The benches, each compiled once."""
    match width:
        case 8:
            latencies = [(0,), (3,), (1,), (2,), (4,), (5,), (9,)]
            formats = zip(EIGHT_BITS, latencies, strict=True)
        case 16:
            formats = [(FP16, (3,)), (Float(5, 10), (0,))]
        case 24:
            formats = [(FP24, (0, 2, 5)), (GRADUAL, (4,))]
    return [case for format, latencies in formats for case in operations(format, latencies)]


def test_every_pair():
    """Formats of up to 8 bits: all pairs; c takes every code in some order."""
    a, b = every_pair(8)
    c = np.random.default_rng(2).integers(0, 256, len(a)).astype(np.uint8)
    check(cases_of(8), {"a": a, "b": b, "c": c})


def test_every_triple():
    """Multiply-add of the smallest format: all triples."""
    a, b = every_pair(9)
    codes = np.stack([a & 63, b & 63, a >> 6 | b >> 6 << 3]).astype(np.uint8)
    check(cases_of(8), dict(zip("abc", codes, strict=True)))


@pytest.mark.slow
@pytest.mark.parametrize("formats", [SIXTEEN_BITS, TWENTY_FOUR_BITS], ids=["16", "24"])
def test_hard_pairs(formats):
    check(cases_of(formats[0].width), hard(formats, 1_000_000))


@pytest.mark.parametrize("format", EIGHT_BITS[2:4], ids=str)
def test_every_latency(format):
    """From no registers to more than there are places for, moving half of the time."""
    rng = np.random.default_rng(5)
    twin = partial(arithmetic.multiply_add, format)
    latencies = range(13)
    cases = [Case(MultiplyAdd(format, n), n, ("a", "b", "c"), twin) for n in latencies]
    inputs = dict(zip("abc", rng.integers(0, 256, (3, 50_000), np.uint8), strict=True))
    check(cases, inputs, rng.integers(0, 2, 50_000))


def test_enable_freezes():
    """Low in half of the cycles, for long in some: nothing is lost, nothing comes in."""
    rng = np.random.default_rng(3)
    inputs = hard(EIGHT_BITS, 20_000)
    count = len(inputs["a"])
    enable = rng.integers(0, 2, count)
    enable[count // 2 :] = np.repeat(rng.integers(0, 2, count), 16)[: count - count // 2]
    check(cases_of(8), inputs, enable)


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


def conversions() -> list[Case]:
    """Between all formats, at latencies in turn."""
    kinds = [
        *((Convert, arithmetic.convert, source, target) for source in FLOATS for target in FLOATS),
        *(
            (FromFixed, arithmetic.from_fixed, fixed, float)
            for fixed in FIXED
            for float in FLOATS[::2]
        ),
        *((ToFixed, arithmetic.to_fixed, float, fixed) for fixed in FIXED for float in FLOATS[::2]),
    ]
    cases = []
    for number, (make, twin, *formats) in enumerate(kinds):
        latency = number % 5
        component = make(*formats, latency)
        cases.append(Case(component, latency, ("i",), partial(twin, *formats)))
    return cases


@pytest.mark.slow
def test_conversions():
    """Every code of 16 bits; of wider formats the codes with these bits on either end as well."""
    codes = np.arange(1 << 16, dtype=np.uint32)
    hard_codes, _ = pairs(FP24, np.random.default_rng(4), 100_000)
    check(conversions(), {"i": np.concatenate([codes, codes << 8, codes << 15, hard_codes])})


@pytest.mark.parametrize("make", [Multiply, Add, MultiplyAdd])
def test_no_empty_ranges(make):
    """Verilog has no vectors without bits: what a format does not need is left out."""
    for format in (FP16, FP24, Float(2, 2, subnormal=False, overflow="infinity"), Float(3, 2)):
        assert "[-1:0]" not in verilog.convert(make(format, 5), name="top")
