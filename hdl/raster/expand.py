"""Stage 3, second step: a splat to pairs of the splat and each of its live tiles."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.shift import encoded
from splatcore.spec.config import Config
from splatcore.spec.raster import pair_record, position_record, readied_record


def lowest(value: Value) -> Value:
    """The lowest set bit alone."""
    return value & (~value + 1)[: len(value)]


class Expand(wiring.Component):
    """Makes a pair for each tile of a splat that still has live pixels, and a group's end.

    Members
        i: stream of `readied_record`.
        positions: stream of `position_record`, one for each group, taken with the group's end.
        live: the group's tiles that have live pixels.
        o: stream of `pair_record`; an offer is taken back if its tile ends before it is taken.

    **Timing**: a pair a cycle; a splat none of whose tiles is live takes a cycle. No registers but
    those of the tiles done.
    """

    def __init__(self, config: Config):
        self.config = config
        super().__init__(
            {
                "i": In(stream.Signature(layout(readied_record(config)))),
                "positions": In(stream.Signature(layout(position_record(config)))),
                "live": In(config.group**2),
                "o": Out(stream.Signature(layout(pair_record(config)))),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        side = self.config.group
        i, o, position = self.i.payload, self.o.payload, self.positions.payload
        done = Signal(side**2)
        open_tiles, chosen = Signal(side**2), Signal(side**2)
        valid = self.i.valid & self.positions.valid
        m.d.comb += [
            open_tiles.eq(i.mask & self.live & ~done),
            chosen.eq(lowest(open_tiles)),
            self.o.valid.eq(valid & (i.end | open_tiles.any())),
            self.i.ready.eq(
                valid & Mux(self.o.valid, self.o.ready & (i.end | (open_tiles == chosen)), 1)
            ),
            self.positions.ready.eq(self.i.ready & i.end),
            o.splat.eq(i.splat),
            o.end.eq(i.end),
            o.tile.eq(encoded(chosen)),
        ]
        columns = [Cat(chosen[row * side + k] for row in range(side)).any() for k in range(side)]
        rows = [chosen[row * side : (row + 1) * side].any() for row in range(side)]
        m.d.comb += [
            o.column.eq(position.column * side + encoded(Cat(columns))),
            o.row.eq(position.row * side + encoded(Cat(rows))),
        ]
        with m.If(self.i.ready):
            m.d.sync += done.eq(0)
        with m.Elif(self.o.valid & self.o.ready):
            m.d.sync += done.eq(done | chosen)
        return m
