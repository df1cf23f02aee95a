"""Binning, second step: finds the columns of tiles that an outline meets in each row of tiles."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, ValueLike, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.binning.outline import PHASES, outline_layout, pixel
from splatcore.hdl.binning.row_end import LATENCY as END_LATENCY
from splatcore.hdl.binning.row_end import SLOPE_AT, WIDTH_AT, RowEnd
from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import enough, holds, never_waits
from splatcore.hdl.lib.stream import Queue, passes
from splatcore.spec.binning import HALF_BITS, TILE_BITS
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE

BAND_AT = 2  # cycles from a row's start to its band
LATENCY = BAND_AT + END_LATENCY + 2  # cycles from a row's start to its columns
ROWS_WAITING = 32  # rows in flight or waiting to be taken
SQUARE_LATENCY = 3  # the same for a square, whose ends are known

OUTLINES = 8
"""Outlines that may have rows in flight: at most one comes every third cycle, and it is last read
less than `LATENCY` cycles later."""


def columns_layout(config: Config) -> data.StructLayout:
    """Tiles begin … end of a row, none if begin is above end; last: of the splat."""
    row, column = range(-(-config.side_max // TILE)), range(-(-config.side_max // TILE) + 1)
    return data.StructLayout({"row": row, "begin": column, "end": column, "last": 1})


class Rows(wiring.Component):
    """Turns outlines into rows of tiles.

    The path never stalls: a row starts if it will find room in the queue behind it. Parts of an
    outline that are needed late wait in two small memories.

    **Timing**: one row per cycle, also from one outline to the next; latency `LATENCY` + 3, for
    squares `SQUARE_LATENCY` + 3. Multipliers of two `RowEnd`; squares need none, and no memories.
    """

    def __init__(self, config: Config):
        self.config = config
        self.square = config.tile_test == "3sigma"
        self.latency = SQUARE_LATENCY if self.square else LATENCY
        # An outline's place is reused after it has been read for its last row.
        enough(PHASES * (OUTLINES - 1), BAND_AT + WIDTH_AT, "OUTLINES, cycles until one goes")
        self.queue = Queue(columns_layout(config), ROWS_WAITING, memory=True)
        ports = {
            "i": In(stream.Signature(outline_layout(config))),
            "width": In(range(config.side_max + 1)),  # of the image, pixels
            "o": Out(stream.Signature(columns_layout(config))),
            "row": Out(1),  # a row starts
            "busy": Out(1),  # something is inside
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        held, full = Signal(outline_layout(self.config), reset_less=True), Signal()
        row, number = Signal.like(held.first), Signal(range(OUTLINES))
        room = self._output(m, full)
        last = row == held.last
        m.d.comb += [self.row.eq(full & room), self.i.ready.eq(~full | (self.row & last))]
        with m.If(self.i.ready):
            m.d.sync += [held.eq(self.i.payload), row.eq(self.i.payload.first)]
            m.d.sync += full.eq(self.i.valid)
            if not self.square:
                m.d.sync += number.eq(number + self.i.valid)
        with m.Elif(self.row):
            m.d.sync += row.eq(row + 1)

        self.start, self.passing = {"row": row, "last": last}, Signal(self.latency)
        m.d.sync += self.passing.eq(Cat(self.row, self.passing))
        if self.square:
            ends = dict.fromkeys(("left", "right"), self._at(m, "end", held.half_x, 0, 1))
            self._columns(m, held, ends)
        else:
            self._columns(m, *self._ends(m, held, row, number))
        return m

    def _ends(
        self, m: Module, held: data.View, row: Value, number: Value
    ) -> tuple[data.View, dict[str, Value]]:
        """The part of an outline that columns need, a cycle before its ends; and its ends."""
        ends = self._band(m, held, row)
        slope = self._memory(m, number, ("slope",), BAND_AT + SLOPE_AT - 1).slope
        slope = self._at(m, "slope", slope, BAND_AT + SLOPE_AT - 1, 1)
        late = ("half_x", "centre_x", "limit_x", "shift_x", "vast_x", "between")
        outline = self._memory(m, number, late, BAND_AT + WIDTH_AT)
        for end in ends.values():
            m.d.comb += [end.slope.eq(slope), end.half_width.eq(outline.half_x)]
        return outline, {side: end.o for side, end in ends.items()}

    def _passes(self, since: int) -> Value:
        """High `since` cycles after a row's start."""
        return self.passing[since - 1] if since else self.row

    def _at(self, m: Module, name: str, value: ValueLike, since: int, cycles: int) -> Value:
        """A value that is valid `since` cycles after a row's start, `cycles` later."""
        for k in range(cycles):
            later = Signal(Value.cast(value).shape(), name=f"{name}_{k + 1}", reset_less=True)
            with m.If(self._passes(since + k)):
                m.d.sync += later.eq(value)
            value = later
        return value

    def _band(self, m: Module, held: data.View, row: Value) -> dict[str, RowEnd]:
        """Send a row's band of the outline to both its ends."""
        top, below = row << held.shift_y, (row + 1) << held.shift_y
        edges = {
            "low": top - held.centre_y - 1,
            "high": below - (held.centre_y + pixel(held.shift_y)),
            "limit": held.limit_y - held.centre_y,
            "half": held.half_y,
        }
        low, high, limit, half = (self._at(m, name, edges[name], 0, 1) for name in edges)
        most = Mux(limit > half, half, limit)
        band = signed(HALF_BITS + 1)
        clipped = {
            name: Signal(band, name=f"band_{name}", reset_less=True) for name in ("low", "high")
        }
        with m.If(self._passes(1)):
            m.d.sync += clipped["low"].eq(Mux(low < -half, -half, low))
            m.d.sync += clipped["high"].eq(Mux(high > most, most, high))
        lean, shear = held.lean, self._at(m, "shear", held.shear, 0, BAND_AT + 1)
        ends = {}
        for side in ("right", "left"):
            mirror = side == "left"
            m.submodules[side] = ends[side] = end = RowEnd(self.config)
            m.d.comb += [
                *(bit.eq(self._passes(BAND_AT + k)) for k, bit in enumerate(end.passing)),
                end.low.eq(clipped["low"]),
                end.high.eq(clipped["high"]),
                end.box.eq(self._at(m, "box", held.vast_y, 0, BAND_AT)),
                end.lean.eq(self._at(m, f"lean_{side}", -lean if mirror else lean, 0, BAND_AT)),
                end.half.eq(self._at(m, "half_again", half, 1, BAND_AT - 1)),
                end.normalise.eq(self._at(m, "normalise", held.normalise, 0, BAND_AT)),
                end.shear.eq(
                    self._at(m, f"shear_{side}", -shear if mirror else shear, BAND_AT + 1, 1)
                ),
            ]
        return ends

    def _memory(self, m: Module, number: Value, names: tuple, cycles: int):
        """Some fields of the outline, `cycles` after a row's start."""
        outline = self.i.payload
        shape = data.StructLayout({name: outline[name].shape() for name in names})
        m.submodules[f"late_{names[0]}"] = memory = Memory(shape=shape, depth=OUTLINES, init=[])
        write, read = memory.write_port(), memory.read_port()
        # Written once; the first row reads it cycles later, none while it is written.
        m.d.comb += [write.en.eq(self.i.valid & self.i.ready), write.addr.eq(number + 1)]
        m.d.comb += [write.data[name].eq(outline[name]) for name in names]
        asked, clash = number, Const(0)
        for k in range(1, cycles):
            asked = self._at(m, f"number_{names[0]}_{k}", asked, k - 1, 1)
            clash |= self.passing[k - 1] & (asked == write.addr)
        holds(m, names[0], ~(write.en & clash), "an outline is lost that is still needed: OUTLINES")
        m.d.comb += [read.en.eq(self._passes(cycles - 1)), read.addr.eq(asked)]
        return read.data

    def _columns(self, m: Module, outline: data.View, ends: dict[str, Value]):
        """Convert ends to columns of tiles."""
        since = self.latency - 2  # cycles from a row's start to its ends
        names = ("centre_x", "limit_x", "shift_x", "vast_x", "between")
        late = {name: self._at(m, name, outline[name], since - 1, 1) for name in names}
        one = pixel(late["shift_x"])
        left = late["centre_x"] - ends["left"]
        beyond = (left > late["limit_x"]) & ~late["vast_x"]
        beyond = self._at(m, "beyond", beyond | late["between"], since, 1)
        left = self._at(m, "left", left + one - 1, since, 1)
        right = self._at(m, "right", late["centre_x"] + 1 + ends["right"], since, 1)
        shift, vast = (self._at(m, name, late[name], since, 1) for name in ("shift_x", "vast_x"))
        bound = Signal(range(-(-self.config.side_max // TILE)))
        m.d.comb += bound.eq((self.width - 1) >> TILE_BITS)
        first, end = left >> shift, right >> shift
        first, end = Mux((first < 0) | vast, 0, first), Mux((end > bound) | vast, bound, end)
        none = (first > end) | beyond
        columns = self.queue.i.payload
        found = Signal(columns_layout(self.config), reset_less=True)
        with m.If(self._passes(since + 1)):
            m.d.sync += [found.begin.eq(Mux(none, 1, first)), found.end.eq(Mux(none, 0, end))]
        m.d.comb += [columns.eq(found)]
        for name in ("row", "last"):
            m.d.comb += columns[name].eq(self._at(m, name, self.start[name], 0, since + 2))
        m.d.comb += self.queue.i.valid.eq(self.passing[-1])
        never_waits(m, "queue", self.queue.i, "a row: ROWS_WAITING")

    def _output(self, m: Module, full: Value) -> Value:
        """The queue of rows; return whether it will have room for one more."""
        m.submodules.queue = self.queue
        connect(m, flipped(self).o, self.queue.o)
        m.submodules.owed = owed = Credit(ROWS_WAITING, "rows in the queue or in flight")
        m.d.comb += [owed.comes.eq(self.row), owed.goes.eq(passes(self.o))]
        m.d.comb += self.busy.eq(owed.any | full)
        return owed.room
