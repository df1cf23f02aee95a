"""Reads a packed model from memory: header, codebooks, chunk headers, positions, attributes."""

from math import gcd

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Slot, passes
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import FetchBeats
from splatcore.hdl.memory.words import Words
from splatcore.hdl.points.codebook import codebook_line
from splatcore.hdl.points.load import RANGE_BITS, Load
from splatcore.hdl.points.state import ModelState
from splatcore.spec import axi
from splatcore.spec.config import Config
from splatcore.spec.memory import ATTRIBUTE_BITS, CHUNK, CHUNK_HEADER, HEADER
from splatcore.spec.point import FETCH, NUMBER_BITS, WANTED
from splatcore.spec.registers import CODE_BITS, DETAIL_BITS
from splatcore.spec.small import position_widths

READING = ("model", "positions", "attributes")
"""Names of its readers in `spec.axi.READERS`, in that order."""

BEATS_WAITING = 2 * axi.BURST_BEATS
"""Beats of chunk headers and of positions that may wait: two bursts of each."""

HEADER_BEATS = CHUNK_HEADER.size // axi.BEAT

COUNT_BITS = NUMBER_BITS + 1 + (HEADER_BEATS - 1).bit_length()
"""Width of the number of beats of all chunk headers."""


def multiple(value: Value, factor: int) -> Value:
    """factor · value by shifts and sums."""
    return sum(value << k for k in range(factor.bit_length()) if factor >> k & 1)


class ModelReader(wiring.Component):
    """Reads a model: header and codebooks, then all chunk headers, and other parts on request.

    **Timing**: a chunk header in four cycles; bursts of positions end at multiples of 16 beats; the
    attributes of a Gaussian are one burst every two cycles, or two bursts if they cross a multiple
    of 4 KB: the second one follows after one cycle, with a port of 256 bits after two.
    """

    def __init__(self, config: Config):
        self.config, self.load = config, Load(config)
        ports = {
            "start": In(1),  # read header and codebooks
            # address of the model in beats; stable during the frame
            "model_at": In(axi.BEAT_ADDRESS_BITS),
            "write": Out(stream.Signature(codebook_line(config))),  # words of the codebook memory
            "model": Out(ModelState),  # as in `hdl.points.load.Load`
            "loaded": Out(1),  # as in `hdl.points.load.Load`
            "error": Out(CODE_BITS),  # as in `hdl.points.load.Load`
            "detail": Out(DETAIL_BITS),  # as in `hdl.points.load.Load`
            "run": In(1),  # once `loaded` is high: begin with the chunk headers
            # with levels, a record of `spec.levels` before each one
            "headers": Out(stream_of(CHUNK_HEADER)),
            "fetch": In(stream_of(FETCH)),  # chunks whose positions are to be read
            "positions": Out(stream.Signature(axi.DATA_BITS)),  # the beats of these positions
            "wanted": In(stream_of(WANTED)),  # Gaussians whose attributes are to be read
            "attributes": Out(stream.Signature(ATTRIBUTE_BITS)),  # the beats of these attributes
            "given": Out(1),  # all chunk headers have been taken
            # to memory, one for each of `READING`
            "reads": Out(stream_of(axi.read_record())).array(len(READING)),
            # from memory, one for each of `READING`
            "data": In(stream.Signature(read_beat(config))).array(len(READING)),
        }
        if config.levels:
            ports |= {
                "levels": Out(1),  # as in `hdl.points.load.Load`
                "turn": Out(NUMBER_BITS),  # of the first chunk whose header is not asked for yet
                # the header of this chunk comes instead, high for one cycle
                "jump": In(1),
                "target": In(NUMBER_BITS),
            }
        super().__init__(ports)
        self.chunks = Signal(NUMBER_BITS + 1 + config.levels)  # headers and records of levels

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.load = load = self.load
        connect(m, flipped(self).write, load.write)
        m.d.comb += [
            load.start.eq(self.start),
            load.model_at.eq(self.model_at),
            self.model.eq(load.model),
            self.loaded.eq(load.loaded),
            self.error.eq(load.error),
            self.detail.eq(load.detail),
        ]
        chunks = (self.model.gaussians + CHUNK - 1) >> CHUNK.bit_length() - 1
        if self.config.levels:
            chunks = chunks << load.levels
            m.d.comb += self.levels.eq(load.levels)
        m.d.sync += self.chunks.eq(chunks)
        self._headers(m)
        self._positions(m)
        self._attributes(m)
        return m

    def _reader(self, m: Module, name: str, count_bits: int) -> FetchBeats:
        """The reader of ranges for one of `READING`."""
        number = READING.index(name)
        m.submodules[name] = fetch = FetchBeats(self.config, BEATS_WAITING, count_bits)
        connect(m, fetch.reads, flipped(self.reads[number]))
        connect(m, flipped(self.data[number]), fetch.data)
        return fetch

    def _headers(self, m: Module):
        """Read header and codebooks first, then the chunk headers of two beats each."""
        load = self.load
        fetch = self._reader(m, "model", RANGE_BITS if self.config.levels else COUNT_BITS)
        m.submodules.beat = beat = Slot(axi.DATA_BITS)
        connect(m, fetch.o, beat.i)
        left = Signal.like(self.chunks)
        upper, low = Signal(), Signal(axi.DATA_BITS, reset_less=True)
        running = Signal()
        ask = self._turning if self.config.levels else self._asking
        asks, first, count, spared = ask(m, running, fetch)
        m.d.comb += [
            fetch.i.valid.eq(asks | load.ranges.valid),
            fetch.i.payload.beat.eq(Mux(asks, first, load.ranges.payload.beat)),
            fetch.i.payload.count.eq(Mux(asks, count, load.ranges.payload.count)),
            load.ranges.ready.eq(fetch.i.ready & ~asks),
            load.beats.payload.eq(beat.o.payload),
            load.beats.valid.eq(beat.o.valid & ~running),
            self.headers.payload.eq(Cat(low, beat.o.payload)),
            self.headers.valid.eq(beat.o.valid & running & upper),
            beat.o.ready.eq(Mux(running, ~upper | self.headers.ready, load.beats.ready)),
            self.given.eq(running & ~left.any()),
        ]
        with m.If(self.run):
            m.d.sync += [running.eq(1), left.eq(self.chunks)]
        with m.If(self.start):
            m.d.sync += running.eq(0)
        with m.If(running & passes(beat.o)):
            m.d.sync += [upper.eq(~upper), low.eq(beat.o.payload)]
            with m.If(upper):
                m.d.sync += left.eq(left - 1)
        if self.config.levels:
            with m.If(self.jump):  # no header is taken in this cycle
                m.d.sync += left.eq(left - spared)

    def _asking(self, m: Module, running: Signal, fetch: FetchBeats) -> tuple[Value, ...]:
        """Ask for all headers at once. Returns whether to ask, first beat, beats, and 0."""
        asks = Signal()
        with m.If(self.run):
            m.d.sync += asks.eq(self.chunks.any())
        with m.Elif(asks & fetch.i.ready):
            m.d.sync += asks.eq(0)
        first = self.model_at + HEADER.size // axi.BEAT
        return asks, first, self.chunks * HEADER_BEATS, Const(0)

    def _turning(self, m: Module, running: Signal, fetch: FetchBeats) -> tuple[Value, ...]:
        """Ask for the headers burst by burst, once there is room, to turn at any time: headers and
        records are pairs of beats, and the bursts those of one range. Returns whether to ask, first
        beat, beats, and the pairs that a jump spares."""
        asked, first = Signal.like(self.chunks), Signal(axi.BEAT_ADDRESS_BITS)
        rest, burst = Signal.like(asked), Signal(range(axi.BURST_BEATS // HEADER_BEATS + 1))
        place = first[exact_log2(HEADER_BEATS) :][: len(burst) - 1]  # in a burst
        part = fetch.fetch
        room = ~part.sized & (part.used.count <= part.depth - part.burst)
        target, asks = self.target << 1, running & rest.any() & room & ~self.jump
        m.d.comb += [
            first.eq(self.model_at + HEADER.size // axi.BEAT + asked * HEADER_BEATS),
            rest.eq(self.chunks - asked),
            burst.eq(Mux(rest < (1 << len(place)) - place, rest, (1 << len(place)) - place)),
            self.turn.eq(asked >> 1),
        ]
        with m.If(self.run):
            m.d.sync += asked.eq(0)
        with m.Elif(self.jump):
            m.d.sync += asked.eq(target)
        with m.Elif(asks & fetch.i.ready):
            m.d.sync += asked.eq(asked + burst)
        return asks, first, burst * HEADER_BEATS, target - asked

    def _positions(self, m: Module):
        """Read each chunk that is fetched as one range of beats."""
        most = 3 * CHUNK * max(position_widths(self.config)) // axi.DATA_BITS  # of one chunk
        shape = axi.range_record(most.bit_length())
        fetch = self._reader(m, "positions", most.bit_length())
        m.submodules.fetched = fetched = Slot(self.fetch.payload.shape())
        connect(m, flipped(self).fetch, fetched.i)
        m.submodules.ranges = ranges = Slot(layout(shape))
        chunk, asked = fetched.o.payload, ranges.i.payload
        bits = self._bits(chunk.count)
        before = self._bits(chunk.number) << exact_log2(CHUNK // axi.DATA_BITS)
        m.d.comb += asked.beat.eq(self.load.positions + before)
        m.d.comb += asked.count.eq((bits + axi.DATA_BITS - 1) // axi.DATA_BITS)
        m.d.comb += [ranges.i.valid.eq(fetched.o.valid), fetched.o.ready.eq(ranges.i.ready)]
        connect(m, ranges.o, fetch.i)
        connect(m, fetch.o, flipped(self).positions)

    def _bits(self, count: Value) -> Value:
        """Bits of the positions of `count` Gaussians; small models have fewer."""
        widths = [3 * width for width in position_widths(self.config)]
        unit = gcd(*widths)
        of_model = [multiple(multiple(count, unit), width // unit) for width in widths]
        return Mux(self.model.small, *reversed(of_model)) if len(of_model) > 1 else of_model[0]

    def _attributes(self, m: Module):
        """Read each Gaussian's beats in one burst, or in two if they cross a `BOUNDARY`."""
        number = READING.index("attributes")
        read, back = self.reads[number], self.data[number]
        if axi.port_beats(self.config) == 1:
            m.d.comb += [
                self.attributes.valid.eq(back.valid),
                self.attributes.payload.eq(back.payload.beat),
                back.ready.eq(self.attributes.ready),
            ]
        else:
            m.submodules.attributes = words = Words(self.config, 1 << WANTED["count"].width)
            m.submodules.asked = asked = Slot(read.payload.shape())
            connect(m, words.reads, asked.i)
            connect(m, asked.o, flipped(read))
            connect(m, flipped(back), words.data)
            connect(m, words.o, flipped(self).attributes)
            read = words.i
        m.submodules.wanted = wanted = Slot(self.wanted.payload.shape())
        connect(m, flipped(self).wanted, wanted.i)
        beat = Signal(axi.BEAT_ADDRESS_BITS, reset_less=True)
        # Beats of the present burst, and of a second one behind it.
        burst, rest = (Signal(WANTED["count"].width, name=name) for name in ("burst", "rest"))
        count, first = wanted.o.payload.count, Signal.like(beat)
        place = first[: exact_log2(axi.BOUNDARY // axi.BEAT)]
        left = (-place)[: len(place)]  # up to the boundary; 0 at one
        divided = left.any() & (left < count)
        m.d.comb += [
            first.eq(self.load.attributes + wanted.o.payload.beat),
            wanted.o.ready.eq(~burst.any()),
            read.valid.eq(burst.any()),
            read.payload.beat.eq(beat),
            read.payload.length.eq((burst - 1)[: len(burst)]),
        ]
        with m.If(~burst.any()):
            m.d.sync += beat.eq(first)
            with m.If(wanted.o.valid):
                m.d.sync += burst.eq(Mux(divided, left[: len(count)], count))
                m.d.sync += rest.eq(Mux(divided, count - left, 0))
        with m.Elif(read.ready):
            m.d.sync += beat.eq(Cat(Const(0, len(place)), beat[len(place) :] + 1))
            m.d.sync += [burst.eq(rest), rest.eq(0)]
