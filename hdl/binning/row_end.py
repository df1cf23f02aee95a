"""Binning: the right end of an outline within a row of tiles."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.spec.binning import FACTOR_FRACTION, GUARD, HALF_BITS, lean_margin, outward
from splatcore.spec.config import Config

ROOT_BITS = 3  # bits of the square root found per cycle

ROOT_CYCLES = -(-HALF_BITS // ROOT_BITS)

SLOPE_AT = 3 + ROOT_CYCLES  # cycles after a band at which its slope is needed
WIDTH_AT = SLOPE_AT + 2  # cycles after a band at which its half width is needed
LATENCY = WIDTH_AT + 1  # cycles after a band at which its end is valid
END_BITS = HALF_BITS + 5  # bits of an end with its sign


class RowEnd(wiring.Component):
    """The right end of an outline within a band, from its centre (T, r and end of `spec.binning`).

    The left end is the right end of the mirrored outline: lean and shear negated.

    **Timing**: one band per cycle; it never stalls. Three multipliers of about `HALF_BITS` bits
    squared and a square root of `ROOT_BITS` bits per cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        t = signed(HALF_BITS + 1)
        ports = {
            "passing": In(LATENCY),  # bit k: there was a band k cycles ago
            "low": In(t),  # the band, within ± half
            "high": In(t),  # the band, within ± half
            "box": In(1),  # with the band: the half width is the end
            "lean": In(t),  # of the outline, with the band
            "half": In(HALF_BITS),  # of the outline, with the band
            "normalise": In(range(HALF_BITS)),  # of the outline, with the band
            "shear": In(signed(FACTOR_FRACTION + 2)),  # of the outline, two cycles after the band
            "slope": In(FACTOR_FRACTION + 2),  # of the outline, `SLOPE_AT` cycles after the band
            "half_width": In(HALF_BITS),  # of the outline, `WIDTH_AT` cycles after the band
            "o": Out(signed(END_BITS)),  # the end, `LATENCY` cycles after the band
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        margin, cut = lean_margin(self.config), FACTOR_FRACTION - GUARD
        inside = (self.low - margin <= self.lean) & (self.lean <= self.high + margin)
        t = Mux(self.lean > self.high, self.high, self.low)
        whole, t = self._register(m, "chosen", 0, inside | self.box, t)
        [half, normalise] = self._register(m, "unit", 0, self.half, self.normalise)

        size = Mux(t < 0, -t, t)[:HALF_BITS] << normalise
        size, highest = size[:HALF_BITS], (half << normalise)[:HALF_BITS]
        negative, size, less, more = self._register(
            m, "factors", 1, t < 0, size, (highest - size)[:HALF_BITS], highest + size
        )
        signed_size = Mux(negative, -size, size)[: HALF_BITS + 1].as_signed()
        radicand, product = self._register(
            m, "products", 2, (less * more)[: 2 * HALF_BITS], (self.shear * signed_size) >> cut
        )
        root = self._root(m, radicand)
        product = self._later(m, 3, ROOT_CYCLES, product)
        whole = self._later(m, 1, ROOT_CYCLES + 3, whole)
        by_slope, slope, product = self._register(
            m, "by_slope", SLOPE_AT, root * self.slope, self.slope, product
        )
        total = ((by_slope + slope) >> cut) + product
        total, whole = self._register(m, "total", SLOPE_AT + 1, total >> GUARD, whole)
        end = Mux(whole, self.half_width, total + 1 + outward(self.config))
        with m.If(self.passing[WIDTH_AT]):
            m.d.sync += self.o.eq(end)
        return m

    def _register(self, m: Module, name: str, since: int, *values: Value) -> list[Signal]:
        """Values that are valid `since` cycles after a band, a cycle later."""
        found = [
            Signal(value.shape(), name=f"{name}_{k}", reset_less=True)
            for k, value in enumerate(map(Value.cast, values))
        ]
        with m.If(self.passing[since]):
            m.d.sync += [signal.eq(value) for signal, value in zip(found, values, strict=True)]
        return found

    def _later(self, m: Module, since: int, cycles: int, value: Value) -> Value:
        for k in range(cycles):
            [value] = self._register(m, "later", since + k, value)
        return value

    def _root(self, m: Module, radicand: Value) -> Value:
        """⌊√radicand⌋, restoring: each bit is set if the square still fits."""
        rest, root = Const(0, 1), Const(0, 0)
        for k in reversed(range(HALF_BITS)):
            # (root·2 + 1)² − (root·2)² = root·4 + 1, two more bits of the radicand come in.
            # Before them the rest is at most root·2, so the difference has no more bits than it.
            rest = Cat(radicand[2 * k : 2 * k + 2], rest)
            trial = Cat(Const(1, 2), root)
            difference = Signal(signed(len(rest)), name=f"difference_{k}")
            m.d.comb += difference.eq(rest - trial)
            grows = ~difference[-1]
            rest = Mux(grows, difference, rest)[: HALF_BITS - k + 1]
            root = Cat(grows, root)
            if k % ROOT_BITS == 0:
                since = SLOPE_AT - 1 - k // ROOT_BITS
                rest, root = self._register(m, f"root_{k}", since, rest, root)
                if k:
                    [radicand] = self._register(m, f"radicand_{k}", since, radicand[: 2 * k])
        return root
