"""The sum of a Gaussian's terms of colour (`spec.colour`): integers, one term per cycle."""

from amaranth.hdl import Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.spec.colour import CHANNELS, GAIN, POLYNOMIAL, TOTAL_FRACTION, unscaled_colour_format
from splatcore.spec.config import Config
from splatcore.spec.schedule import colour_turns

LANES, FOLLOWING = 3, 2
"""Maximum number of polynomials in a term, and in a term that follows another one."""

MULTIPLICAND = signed(7)
"""Shape of the factors of polynomials: codes of 6 bits, parts of G."""

SHIFT_BITS = 5

PRODUCTS = signed(MULTIPLICAND.width + POLYNOMIAL.width + 1)
"""A sum of `LANES` products: each is at most a quarter of their range."""


def lanes_of(config: Config) -> list[range]:
    """Return the lanes of each term that is summed in the same cycle."""
    two = any(len(turn) > 1 for turn in colour_turns(config))
    return [range(LANES), *([range(LANES, LANES + FOLLOWING)] if two else [])]


def sums_of_products(a: list[Value], b: list[Value]) -> tuple[Value, Value]:
    """Two numbers whose sum is the sum of the products a · b of signed numbers, modulo a power of
    two.

    Rows of partial products are added without sign extension: bits that count negative are
    inverted, and a constant corrects their sum. The first result is the sum of the lower rows: it
    has few bits; the second one ends in zeros.
    """
    low, high, constant = [], [], 0
    for x, y in zip(a, b, strict=True):
        for k in range(len(x)):
            last = k == len(x) - 1
            row = y & x[k].replicate(len(y))
            flip = (1 << len(y) - 1) - 1 if last else 1 << len(y) - 1
            half = low if k < len(x) // 2 else high
            half.append((row ^ flip)[: len(y)].shift_left(k))
        constant += (1 << len(x) - 1) + (1 << len(y) - 1) - (1 << len(x) + len(y) - 1)
    bits = sum(1 << len(row) for row in low).bit_length()
    return _sum(low, bits), _sum([*high, Const(constant, PRODUCTS)], PRODUCTS.width)


def _sum(rows: list[Value], bits: int) -> Value:
    """Sum of rows in `bits` bits.

    No partial sum has more bits, so synthesis makes one tree of carry-save adders of all rows, with
    one carry chain behind it.
    """
    total = Const(0, bits)
    for row in rows:
        total = (total + row)[:bits]
    return total


class Terms(wiring.Component):
    """total += (sum · factor · 2^GAIN) >> shift for the base and for each term.

    Parameters:
        base: bits of the base

    **Timing**: one term per cycle, or two of the same degree (`spec.schedule.colour_turns`),
    latency 5. Three multipliers of 7 × 13 bits per lane: nine, or 15 if two terms are summed per
    cycle; built of adders here or by synthesis (`Config.logic`).
    """

    latency = 5

    def __init__(self, config: Config, base: int):
        """base: bits of the base."""
        self.config, self.sums = config, lanes_of(config)
        self.lanes = self.sums[-1].stop
        lanes = data.ArrayLayout(MULTIPLICAND, self.lanes)
        ports = {
            "first": In(1),  # a Gaussian's first term comes in this cycle; its other terms follow
            # half of the base's multiplicands by channel, in the cycle after `first`
            "base": In(data.ArrayLayout(signed(base), len(CHANNELS))),
            "base_shift": In(SHIFT_BITS),  # the base's shift, in the cycle after `first`
            "base_three": In(1),  # the base's factor is 3 instead of 4, in the cycle after `first`
            "half": In(1),  # ½ is added to the base; stable for a frame
            # colours, codes of `unscaled_colour_format`, with all terms up to `latency` cycles ago
            "o": Out(data.ArrayLayout(unscaled_colour_format(config).width, len(CHANNELS))),
        }
        if config.sh_degree:
            ports["shift"] = In(SHIFT_BITS)  # the terms'
            ports["three"] = In(1)  # the terms' factor is 3 instead of 4
            # the terms', by channel and lane, 0 if there is no polynomial
            ports["multiplicands"] = In(data.ArrayLayout(lanes, len(CHANNELS)))
            # of the previous cycle's terms
            ports["polynomials"] = In(data.ArrayLayout(signed(POLYNOMIAL.width), self.lanes))
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        (first,) = self._delayed(m, self.latency - 1, self.first)
        if self.config.sh_degree:
            at_shift = self._delayed(m, self.latency - 2, self.shift, self.three)
        (base_shift,) = self._delayed(m, 1, self.base_shift)
        format = unscaled_colour_format(self.config)
        rest = max(TOTAL_FRACTION - format.fraction, 0)
        missing = max(format.fraction - TOTAL_FRACTION, 0)
        for k in range(len(CHANNELS)):
            start = self._base(m, k, base_shift, (1 << rest >> 1))
            addends = []
            if self.config.sh_degree:
                sums = [self._sum(m, k, lanes) for lanes in self.sums]
                addends = [self._addend(m, total, *at_shift) for total in sums]
            width = max(map(len, [start, *addends])) + 1
            total = Signal(signed(width), name=f"total_{k}", reset_less=True)
            if self.config.sh_degree:
                m.d.sync += total.eq(sum(addends, Mux(first, start, total)))
            else:
                m.d.sync += total.eq(start)
            total = total << missing
            code, above = total[rest:][: format.width], total[rest + format.width : -1].any()
            colour = Mux(total[-1], 0, code | above.replicate(format.width))
            m.d.comb += self.o[k].eq(colour)
        return m

    def _delayed(self, m: Module, cycles: int, *values: Value) -> tuple[Value, ...]:
        """Values `cycles` cycles later."""
        for k in range(cycles):
            later = [Signal.like(value, name=f"{value.name}_{k}") for value in values]
            m.d.sync += [b.eq(a) for a, b in zip(values, later, strict=True)]
            values = tuple(later)
        return values

    def _base(self, m: Module, channel: int, shift: Value, offset: int) -> Signal:
        """A channel's scaled and shifted base, plus the offset with which a total begins."""
        base = self.base[channel]
        scaled = Signal(signed(len(base) + 2), name=f"base_{channel}", reset_less=True)
        m.d.sync += scaled.eq((base << 2) - Mux(self.base_three, base, 0))
        places = 1 + POLYNOMIAL.fraction + GAIN
        start = Signal(signed(len(scaled) + places + 1), name=f"start_{channel}", reset_less=True)
        half = self.half << TOTAL_FRACTION - 1
        m.d.sync += start.eq((scaled << places >> shift) + (half | offset))
        (start,) = self._delayed(m, 1, start)
        return start

    def _sum(self, m: Module, channel: int, lanes: range) -> Signal:
        """A channel's sum of products on some lanes."""
        own = f"{channel}" + "_following" * (lanes.start > 0)
        factors = []
        for lane in lanes:
            factor = Signal(MULTIPLICAND, name=f"factor_{channel}{lane}", reset_less=True)
            m.d.sync += factor.eq(self.multiplicands[channel][lane])
            factors.append(factor)
        polynomials = [self.polynomials[lane] for lane in lanes]
        if self.config.logic == "fpga":
            first, *others = (a * b for a, b in zip(factors, polynomials, strict=True))
            sums = first, sum(others)
        else:
            sums = sums_of_products(factors, polynomials)
        parts = []
        for k, part in enumerate(sums):
            kept = Signal(part.shape(), name=f"part_{own}{k}", reset_less=True)
            m.d.sync += kept.eq(part)
            parts.append(kept)
        total = Signal(PRODUCTS, name=f"sum_{own}", reset_less=True)
        m.d.sync += total.eq(sum(parts))
        return total

    def _addend(self, m: Module, total: Signal, shift: Signal, three: Signal) -> Signal:
        """The sum times factor and gain, shifted."""
        scaled = ((total << 2) - Mux(three, total, 0)) << GAIN
        width = len(total) + 2 + GAIN
        addend = Signal(signed(width), name=f"{total.name}_shifted", reset_less=True)
        m.d.sync += addend.eq(scaled >> shift)
        return addend
