"""Stage 3, fourth step: marks the blocks of a tile that a splat may reach."""

from amaranth.hdl import Cat, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout
from splatcore.spec.config import Config
from splatcore.spec.number import Bits
from splatcore.spec.raster import (
    BLOCKS,
    COLOURS,
    STEPS,
    around_record,
    mark_min,
    marked_record,
)
from splatcore.spec.record import Array

CUTS = ("multiples", "lines", "planes", "marked")  # registers are behind these values

CARRIED = ("quadratic", "tile", "end", *COLOURS)


def times(value: Value, factor: int) -> Value:
    """A signed value · 1, 3, 9 or the negative of these, by shifts and sums."""
    for _ in range({1: 0, 3: 1, 9: 2}[abs(factor)]):
        value = value + (value << 1)
    return value if factor > 0 else -value


def magnitudes(x: Value, y: Value) -> Value:
    """|x| + |y| of signed values: −x is ~x + 1, and both ones are added to the sum."""
    ones = [value.as_unsigned() ^ value[-1].replicate(len(value)) for value in (x, y)]
    return (ones[0] + ones[1] + x[-1] + y[-1])[: len(ones[0] + ones[1])]


def plus(value: Value, multiples: dict, name: str, factor: int, bits: int) -> Value:
    """value + factor · 2^bits · the number called `name`, of which there are multiples."""
    part = multiples[name, abs(factor)] << bits
    return value + part if factor > 0 else value - part


class Mark(wiring.Component):
    """Marks the blocks in which E can reach the threshold of each of their levels.

    A block is left out if the plane that touches E at the block's centre is too low everywhere in
    the
    block: E is concave, so it is nowhere above that plane.

    **Timing**: one pair per cycle; no multiplier.
    """

    LATENCY = len(CUTS)

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(layout(around_record(config))),
            "enable": In(self.LATENCY),  # bit k: an item enters the registers of the k-th cut
            # with the tile's blocks by level, `LATENCY` enabled cycles later
            "o": Out(layout(marked_record(config, Array(Bits(BLOCKS**2), len(mark_min(config)))))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        self.pipeline = Pipeline(m, self.enable, dict.fromkeys(CUTS, 1))
        self.lowest, *higher = mark_min(self.config)
        near, rows, multiples, carried = self._rows()
        above, steep = [], []
        for line, slope_x, slope_x_3, slope_y in rows:
            for p in STEPS:
                slope = (slope_x if abs(p) == 1 else slope_x_3) << 1
                centre = line + slope if p > 0 else line - slope
                above.append(plus(centre, multiples, "cxx", -p * p, 2) << 1)
                x, y = plus(slope_x, multiples, "cxx", -p, 2), plus(slope_y, multiples, "cxy", p, 1)
                steep.append(magnitudes(x, y))
        near, *rest = self.pipeline.cut("planes", near, *above, *steep, *carried)
        above, steep, carried = rest[:16], rest[16:32], rest[32:]

        bounds = [a + times(b, 3) for a, b in zip(above, steep, strict=True)]
        whole = [bound >> 1 + self.config.exponent_fraction for bound in bounds]
        reached = [Cat(~bound[-1] for bound in bounds)]
        for least in higher:
            steps = least - self.lowest >> self.config.exponent_fraction
            reached.append(Cat(bound >= steps for bound in whole))
        blocks = [Mux(near, level, 0) for level in reached]
        cut = self.pipeline.cut("marked", *blocks, *carried)
        m.d.comb += self.o.blocks.as_value().eq(Cat(cut[: len(blocks)]))
        for name, value in zip(CARRIED, cut[len(blocks) :], strict=True):
            m.d.comb += self.o[name].eq(value)
        return m

    def _multiples(self) -> tuple[Value, Value, dict[tuple[str, int], Value], tuple]:
        """Multiples of the quadratic's coefficients except E.

        Returns a bit (the tile is near enough), E, the multiples by name and factor, and the
        carried fields.
        """
        quadratic, multiples = self.i.quadratic, {}
        for factors, names in (((1, 3), ("gx", "gy")), ((1, 3, 9), ("cxx", "cxy", "cyy"))):
            for name in names:
                value = quadratic[name]
                value = value.as_signed() if name in ("gx", "gy", "cxy") else value
                multiples |= {(name, factor): times(value, factor) for factor in factors}
        carried = [self.i[name] for name in CARRIED]
        near, e, *rest = self.pipeline.cut(
            "multiples", ~self.i.far, quadratic.e.as_signed(), *multiples.values(), *carried
        )
        return near, e, dict(zip(multiples, rest, strict=False)), rest[len(multiples) :]

    def _rows(self) -> tuple[Value, list[tuple], dict[tuple[str, int], Value], list]:
        """For each row of blocks, in its middle: E above the lowest level, its slope along x, three
        times that, its slope along y. Also the results of `_multiples` that are still needed.
        """
        near, e, multiples, carried = self._multiples()
        gx, gx_3, gy = (multiples[key] for key in (("gx", 1), ("gx", 3), ("gy", 1)))
        rows = []
        for q in STEPS:
            line = plus(e - self.lowest, multiples, "gy", q, 1)
            rows += [
                plus(line, multiples, "cyy", -q * q, 2),
                plus(gx, multiples, "cxy", q, 1),
                plus(gx_3, multiples, "cxy", 3 * q, 1),
                plus(gy, multiples, "cyy", -q, 2),
            ]
        goes_on = {key: multiples[key] for key in multiples if key[0] in ("cxx", "cxy")}
        near, *rest = self.pipeline.cut("lines", near, *rows, *goes_on.values(), *carried)
        rows, rest = rest[: len(rows)], rest[len(rows) :]
        rows = list(zip(*(rows[k::4] for k in range(4)), strict=True))
        return near, rows, dict(zip(goes_on, rest, strict=False)), rest[len(goes_on) :]
