"""The AXI4 master: all readers and writers share the one memory port, in turns."""

from collections.abc import Callable

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.shift import encoded
from splatcore.hdl.lib.stream import Register
from splatcore.hdl.memory.bus import axi, fixed
from splatcore.hdl.memory.turns import Turns, selected
from splatcore.hdl.memory.window import client_windows
from splatcore.spec import axi as spec
from splatcore.spec.config import Config

HALVES = (spec.PREPROCESSING, spec.RENDERING)

CROWD = 32  # outstanding bursts of a half from which on patient writers do not write
OUTSTANDING_BITS = 8
"""Width of the count of bursts of a half's readers, or of a writer, that are not yet answered."""

ERROR = 1  # the bit of a response that signals an error

CLIENT_ERROR = data.StructLayout({"valid": 1, "client": spec.ID_BITS})
"""An error response to a beat or burst of a client."""

STRAY = data.StructLayout({"valid": 1, "client": spec.ID_BITS, "written": 1})
"""An unexpected answer. client: its ID. written: answers a burst written, not a beat read."""


def read_beat(config: Config) -> data.StructLayout:
    """Layout of a beat that was read. last: of its burst."""
    return data.StructLayout({"beat": config.port, "last": 1})


def write_data(config: Config, write: data.View) -> Value:
    """All data of a `write_record`."""
    return Cat(write[f"data{k}"] for k in range(config.port // spec.WRITE_BITS))


def lanes(strobe: Value) -> Value:
    """The bits of data to which the bits of a strobe belong."""
    return Cat(bit.replicate(8) for bit in strobe)


def of_half(clients: dict[str, int], half: int) -> int:
    """Mask of the clients that work for a half."""
    return sum(1 << k for k, of in enumerate(clients.values()) if of == half)


def held(register: Register, of: Callable[[data.View], Value]) -> Value:
    """Number of items in a register for which `of` is 1."""
    return (register.o.valid & of(register.head)) + (register.full & of(register.spare))


class Axi(wiring.Component):
    """The memory port: an AXI4 master that serves all readers and writers of the machine.

    Each client is a stream and works for one half. Reads of one reader stay in order, as do bursts
    of one writer.

    Internal:
        asked, bursts, inside, left, owner, r_full, r_client, r_error: state

    **Timing**: per cycle one read request, one beat read and one beat written; a burst begins in
    the cycle after the previous burst's last beat. Latency 1 for requests, beats written and beats
    read. No path from an input of the port to an output of it. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        write = layout(spec.write_record(config))
        ports = {
            "m_axi": Out(axi(config)),  # the port; written bytes without a strobe are 0
            # one per reader in the order of `READERS`
            "reads": In(stream_of(spec.read_record())).array(len(spec.READERS)),
            # the beats read; a reader that stalls keeps all others waiting
            "data": Out(stream.Signature(read_beat(config))).array(len(spec.READERS)),
            # `write_record`, one per writer in the order of `WRITERS`; after a burst's first beat
            # the writer offers the others without waiting for anything else
            "writes": In(stream.Signature(write)).array(len(spec.WRITERS)),
            # one bit per writer: it comes after all others, and not while a half waits for `CROWD`
            # bursts or more, with which it would share memory; applies to new bursts
            "patient": In(len(spec.WRITERS)),
            # one bit per half: no new burst begins for it, data for it is dropped, and its burst
            # being written ends without strobes. Reset its clients meanwhile: data is not sent
            # again.
            "failing": In(len(HALVES)),
            "idle": Out(len(HALVES)),  # one bit per half: none of its bursts is in flight
            # one bit per writer: all beats taken before this cycle are in memory
            "settled": Out(len(spec.WRITERS)),
            "read_error": Out(CLIENT_ERROR),  # possibly several per burst read
            "write_error": Out(CLIENT_ERROR),  # possibly several per burst read
            # an answer that is dropped: its ID is no client's, or no request it could answer has
            # left: a read of its half, or the writer's burst with address and last beat
            "stray": Out(STRAY),
            "beats_read": Out(len(spec.READERS)),  # one bit per client: a beat has passed
            "beats_written": Out(len(spec.WRITERS)),  # one bit per client: a beat has passed
        }
        # `read_windows` and `write_windows`, if there are windows: of the burst that a client
        # offers, for a write with its first beat
        windows = client_windows(config, len(spec.READERS), len(spec.WRITERS))
        super().__init__(ports | {name: In(shape) for name, shape in windows.items()})
        fields = {"client": spec.ID_BITS, "burst": layout(spec.read_record())}
        if windows:
            fields["window"] = spec.window_bits(config)
        request = data.StructLayout(fields)
        beat = {"data": config.port, "strobe": config.port // 8, "last": 1, "client": spec.ID_BITS}
        self.ar, self.aw = Register(request), Register(request)
        self.w = Register(data.StructLayout(beat))
        # Bursts of each half's readers, and of each writer, that are not yet answered.
        self.asked, self.bursts = (
            [Signal(OUTSTANDING_BITS, name=f"{name}{k}") for k in range(count)]
            for name, count in (("asked", len(HALVES)), ("bursts", len(spec.WRITERS)))
        )
        # The burst being written: whether there is one, its beats still to come, its writer.
        self.inside, self.left = Signal(), Signal(spec.LENGTH_BITS)
        self.owner = Signal(len(spec.WRITERS))
        # The beat that was read last.
        self.r_full, self.r_client = Signal(), Signal(spec.ID_BITS, reset_less=True)
        self.r_error = Signal(reset_less=True)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.ar, m.submodules.aw, m.submodules.w = self.ar, self.aw, self.w
        self._address(m, "ar", self.ar.o)
        self._address(m, "aw", self.aw.o)
        w = self.w.o
        m.d.comb += [
            self.m_axi.wdata.eq(w.payload.data & lanes(w.payload.strobe)),
            self.m_axi.wstrb.eq(w.payload.strobe),
            self.m_axi.wlast.eq(w.payload.last),
            self.m_axi.wvalid.eq(w.valid),
            w.ready.eq(self.m_axi.wready),
        ]
        self._ask(m, self._return(m))
        self._write(m, self._answers(m), Cat(count >= CROWD for count in self.asked).any())
        for half in HALVES:
            settled = (self.settled | ~of_half(spec.WRITERS, half)).all()
            m.d.comb += self.idle[half].eq((self.asked[half] == 0) & settled)
        return m

    def _address(self, m: Module, channel: str, request):
        """Drive an address channel of the port from its register."""
        below = exact_log2(spec.port_beats(self.config))  # bits within the port's beat
        burst = request.payload.burst
        window = [request.payload.window] if spec.window_bits(self.config) else []
        wires = {name: value for name, (_, value) in fixed(self.config).items()}
        wires |= {
            "id": request.payload.client,
            "addr": Cat(Const(0, spec.BEAT_BITS + below), burst.beat[below:], *window),
            "len": burst.length,
            "valid": request.valid,
        }
        for name, value in wires.items():
            m.d.comb += getattr(self.m_axi, channel + name).eq(value)
        m.d.comb += request.ready.eq(getattr(self.m_axi, f"{channel}ready"))

    def _of_halves(self, bits: Value, clients: dict[str, int]) -> Value:
        """One bit per client: the bit of its half."""
        return Cat(bits[half] for half in clients.values())

    def _count(self, m: Module, count: Signal, begins: Value, ends: Value):
        """Count items that have begun and not ended."""
        with m.If(begins ^ ends):
            m.d.sync += count.eq(count + Mux(begins, 1, -1))

    def _return(self, m: Module) -> Value:
        """Pass on the beats read; return one bit per half: the last beat of a burst has passed.

        They pass a register that holds one beat, so that `rready` of the port depends on that
        beat's reader, not on inputs of the port."""
        m_axi = self.m_axi
        full, client, error = self.r_full, self.r_client, self.r_error
        beat = Signal(read_beat(self.config), reset_less=True)
        target, fire = Signal(len(spec.READERS)), Signal(len(spec.READERS))
        stray, left = Signal(), Signal(len(HALVES))
        for half in HALVES:
            mine = Const(of_half(spec.READERS, half), 1 << spec.ID_BITS)
            waits = held(self.ar, lambda asks, mine=mine: mine.bit_select(asks.client, 1))
            m.d.comb += left[half].eq(self.asked[half] > waits)
        awaited = self._of_halves(left, spec.READERS)
        failing = self._of_halves(self.failing, spec.READERS)
        ready = Cat(o.ready for o in self.data) | failing
        m.d.comb += [
            target.eq(Mux(full, (Const(1) << client) & awaited, 0)),
            fire.eq(target & ready),
            stray.eq(full & ~target.any()),
            m_axi.rready.eq(~full | fire.any() | stray),
            self.beats_read.eq(fire),
            self.read_error.valid.eq(fire.any() & error),
            self.read_error.client.eq(client),
        ]
        with m.If(stray):
            m.d.comb += [self.stray.valid.eq(1), self.stray.client.eq(client)]
            m.d.comb += self.stray.written.eq(0)
        for k, (o, half) in enumerate(zip(self.data, spec.READERS.values(), strict=True)):
            m.d.comb += [o.payload.eq(beat), o.valid.eq(target[k] & ~self.failing[half])]
        with m.If(m_axi.rready):
            m.d.sync += [
                full.eq(m_axi.rvalid),
                beat.beat.eq(m_axi.rdata),
                beat.last.eq(m_axi.rlast),
                client.eq(m_axi.rid),
                error.eq(m_axi.rresp[ERROR]),
            ]
        return Cat((fire & of_half(spec.READERS, half)).any() & beat.last for half in HALVES)

    def _ask(self, m: Module, returned: Value):
        """Request the bursts to be read."""
        m.submodules.read_turns = turns = Turns(len(spec.READERS))
        request, began = self.ar.i, Signal(len(spec.READERS))
        blocked = Cat(self.failing[k] | self.asked[k].all() for k in spec.READERS.values())
        m.d.comb += [
            turns.wants.eq(Cat(i.valid for i in self.reads) & ~blocked),
            turns.served.eq(request.valid & request.ready),
            request.valid.eq(turns.wants.any()),
            request.payload.client.eq(encoded(turns.chosen)),
            request.payload.burst.eq(selected(turns.chosen, [i.payload for i in self.reads])),
            began.eq(Mux(request.ready, turns.chosen, 0)),
        ]
        if spec.window_bits(self.config):
            m.d.comb += request.payload.window.eq(selected(turns.chosen, self.read_windows))
        for k, i in enumerate(self.reads):
            m.d.comb += i.ready.eq(began[k])
        for half in HALVES:
            begins = (began & of_half(spec.READERS, half)).any()
            self._count(m, self.asked[half], begins, returned[half])

    def _answers(self, m: Module) -> Value:
        """Answers to bursts written; return one bit per writer.

        A writer's newest bursts may not have left: their address is in its register, or their last
        beat is in its register or still to come."""
        m_axi = self.m_axi
        full, error = Signal(), Signal()
        client = Signal(spec.ID_BITS, reset_less=True)
        m.d.sync += [full.eq(m_axi.bvalid), client.eq(m_axi.bid), error.eq(m_axi.bresp[ERROR])]
        mine, answered = Signal(len(spec.WRITERS)), Signal(len(spec.WRITERS))
        count, addresses, lasts = Signal(OUTSTANDING_BITS), Signal(2), Signal(2)
        m.d.comb += [
            m_axi.bready.eq(1),
            mine.eq(Mux(full, Const(1) << client, 0)),
            count.eq(selected(mine, self.bursts)),
            addresses.eq(held(self.aw, lambda burst: burst.client == client)),
            lasts.eq(
                held(self.w, lambda beat: beat.last & (beat.client == client))
                + (self.inside & (self.owner & mine).any())
            ),
            answered.eq(Mux((count > addresses) & (count > lasts), mine, 0)),
            self.write_error.valid.eq(answered.any() & error),
            self.write_error.client.eq(client),
        ]
        with m.If(full & ~answered.any()):
            m.d.comb += [self.stray.valid.eq(1), self.stray.client.eq(client)]
            m.d.comb += self.stray.written.eq(1)
        return answered

    def _write(self, m: Module, answered: Value, crowded: Value):
        """Write bursts; a writer has the port for its whole burst."""
        m.submodules.write_turns = turns = Turns(len(spec.WRITERS))
        count = len(spec.WRITERS)
        valid = Cat(i.valid for i in self.writes)
        failing = self._of_halves(self.failing, spec.WRITERS)
        inside, left, owner = self.inside, self.left, self.owner
        current, full, began, wants = (
            Signal(count, name=name) for name in ("current", "full", "began", "wants")
        )
        address, beat = self.aw.i, self.w.i
        given = Signal(layout(spec.write_record(self.config)))
        abandoned, takes = Signal(), Signal()
        m.d.comb += [
            wants.eq(valid & ~failing & ~full),
            turns.wants.eq(
                Mux(crowded | (wants & ~self.patient).any(), wants & ~self.patient, wants)
            ),
            turns.served.eq(~inside & takes),
            current.eq(Mux(inside, owner, turns.chosen)),
            given.eq(selected(current, [i.payload for i in self.writes])),
            abandoned.eq(inside & (owner & failing).any()),
            address.valid.eq(~inside & turns.wants.any() & beat.ready),
            address.payload.client.eq(encoded(turns.chosen)),
            address.payload.burst.beat.eq(given.beat),
            address.payload.burst.length.eq(given.length),
            beat.payload.data.eq(write_data(self.config, given)),
            beat.payload.strobe.eq(Mux(abandoned, 0, given.strobe)),
            beat.payload.last.eq(Mux(inside, left == 1, given.length == 0)),
            beat.payload.client.eq(encoded(current)),
        ]
        if spec.window_bits(self.config):
            m.d.comb += address.payload.window.eq(selected(turns.chosen, self.write_windows))
        # A burst's first beat goes to both registers or to none.
        m.d.comb += [
            beat.valid.eq(
                Mux(inside, abandoned | (owner & valid).any(), turns.wants.any() & address.ready)
            ),
            takes.eq(beat.valid & beat.ready),
            began.eq(Mux(turns.served, turns.chosen, 0)),
            self.beats_written.eq(Mux(takes, current, 0)),
        ]
        with m.If(takes):
            m.d.sync += inside.eq(~beat.payload.last)
            m.d.sync += [left.eq(Mux(inside, left - 1, given.length)), owner.eq(current)]
        for k, i in enumerate(self.writes):
            m.d.comb += i.ready.eq(self.beats_written[k] & ~abandoned)
            self._count(m, self.bursts[k], began[k], answered[k])
            m.d.comb += [full[k].eq(self.bursts[k].all()), self.settled[k].eq(self.bursts[k] == 0)]
