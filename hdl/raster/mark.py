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

CUTS = ("lines", "planes", "marked")  # registers stand behind what these names say

CARRIED = ("quadratic", "tile", "end", *COLOURS)


def times(value: Value, factor: int) -> Value:
    """A signed value · 1, 3, 9 or the negative of these, by shifts and sums."""
    for _ in range({1: 0, 3: 1, 9: 2}[abs(factor)]):
        value = value + (value << 1)
    return value if factor > 0 else -value


def magnitude(value: Value) -> Value:
    return Mux(value[-1], -value, value)


class Mark(wiring.Component):
    """Marks the blocks in which E can be as high as each of their levels asks for.

    A block is left out if the plane that touches E at the block's centre is too low in all of the
    block: E is concave, so it is nowhere above that plane.

    Members
        i: `around_record`.
        enable: the pipeline moves.
        o: `marked_record` of the tile's blocks by level, `LATENCY` enabled cycles later.

    **Timing**: a pair a cycle; no multiplier.
    """

    LATENCY = len(CUTS)

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(layout(around_record(config))),
            "enable": In(1),
            "o": Out(layout(marked_record(config, Array(Bits(BLOCKS**2), len(mark_min(config)))))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        i = self.i
        pipeline = Pipeline(m, self.enable, dict.fromkeys(CUTS, 1))
        e, gx, gy, cxy = (i.quadratic[name].as_signed() for name in ("e", "gx", "gy", "cxy"))
        cxx, cyy = i.quadratic.cxx, i.quadratic.cyy
        carried = [i[name] for name in CARRIED]
        lines = [e + ((times(gy, q) << 1) - (times(cyy, q * q) << 2)) for q in STEPS]
        slopes_x = [gx + (times(cxy, q) << 1) for q in STEPS]
        slopes_y = [gy - (times(cyy, q) << 2) for q in STEPS]
        near, *rest = pipeline.cut("lines", ~i.far, *lines, *slopes_x, *slopes_y, *carried)
        lines, slopes_x, slopes_y, carried = rest[:4], rest[4:8], rest[8:12], rest[12:]

        quadratic = carried[0]
        cxx, cxy = quadratic.cxx, quadratic.cxy.as_signed()
        lowest, *higher = mark_min(self.config)
        above, steep = [], []
        for line, slope_x, slope_y in zip(lines, slopes_x, slopes_y, strict=True):
            for p in STEPS:
                centre = line + ((times(slope_x, p) << 1) - (times(cxx, p * p) << 2))
                x, y = slope_x - (times(cxx, p) << 2), slope_y + (times(cxy, p) << 1)
                above.append((centre - lowest) << 1)
                steep.append(magnitude(x) + magnitude(y))
        near, *rest = pipeline.cut("planes", near, *above, *steep, *carried)
        above, steep, carried = rest[:16], rest[16:32], rest[32:]

        bounds = [a + times(b, 3) for a, b in zip(above, steep, strict=True)]
        whole = [bound >> 1 + self.config.exponent_fraction for bound in bounds]
        reached = [Cat(~bound[-1] for bound in bounds)]
        for least in higher:
            steps = least - lowest >> self.config.exponent_fraction
            reached.append(Cat(bound >= steps for bound in whole))
        blocks = [Mux(near, level, 0) for level in reached]
        cut = pipeline.cut("marked", *blocks, *carried)
        m.d.comb += self.o.blocks.as_value().eq(Cat(cut[: len(blocks)]))
        for name, value in zip(CARRIED, cut[len(blocks) :], strict=True):
            m.d.comb += self.o[name].eq(value)
        return m
