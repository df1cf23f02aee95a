"""Stage 3, second step: a splat and its tiles, one at a time."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.spec.config import Config
from splatcore.spec.raster import pair_record, place_record, readied_record


def lowest(value: Value) -> Value:
    """The lowest set bit alone."""
    return value & (~value + 1)[: len(value)]


def encoded(one_hot: Value) -> Value:
    """The number of the set bit."""
    width = max((len(one_hot) - 1).bit_length(), 1)
    return Cat(
        Cat(one_hot[k] for k in range(len(one_hot)) if k >> bit & 1).any() for bit in range(width)
    )


class Expand(wiring.Component):
    """Gives a pair for each tile of a splat that still has live pixels, and a group's end.

    Members
        i: stream of `readied_record`.
        places: stream of `place_record`, one for each group; it is taken with the group's end.
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
                "places": In(stream.Signature(layout(place_record(config)))),
                "live": In(config.group**2),
                "o": Out(stream.Signature(layout(pair_record(config)))),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        side = self.config.group
        i, o, place = self.i.payload, self.o.payload, self.places.payload
        done = Signal(side**2)
        open_tiles, now = Signal(side**2), Signal(side**2)
        there = self.i.valid & self.places.valid
        m.d.comb += [
            open_tiles.eq(i.mask & self.live & ~done),
            now.eq(lowest(open_tiles)),
            self.o.valid.eq(there & (i.end | open_tiles.any())),
            self.i.ready.eq(
                there & Mux(self.o.valid, self.o.ready & (i.end | (open_tiles == now)), 1)
            ),
            self.places.ready.eq(self.i.ready & i.end),
            o.splat.eq(i.splat),
            o.end.eq(i.end),
            o.tile.eq(encoded(now)),
        ]
        columns = [Cat(now[row * side + k] for row in range(side)).any() for k in range(side)]
        rows = [now[row * side : (row + 1) * side].any() for row in range(side)]
        m.d.comb += [
            o.column.eq(place.column * side + encoded(Cat(columns))),
            o.row.eq(place.row * side + encoded(Cat(rows))),
        ]
        with m.If(self.i.ready):
            m.d.sync += done.eq(0)
        with m.Elif(self.o.valid & self.o.ready):
            m.d.sync += done.eq(done | now)
        return m
