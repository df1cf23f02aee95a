"""Properties of the AXI4 master's writes, with their induction invariants."""

from amaranth.hdl import Array, Assert, Assume, Cat, Cover, Module, Mux, Signal, Value

from splatcore.hdl.memory.axi import ERROR, Axi, lanes, write_data
from splatcore.spec import axi as spec
from tb.formal.axi_rules import (
    CHANNEL_DEPTH,
    InOrder,
    addresses,
    allowed,
    at_most_one,
    channel,
    passes,
)

UNSENT = CHANNEL_DEPTH
"""Maximum number of bursts begun whose address or last beat has not passed the port: the master
holds that many addresses, and no more last beats, including a last beat still to come."""


class Given:
    """Model of the writers: addresses and beats that wait for the port, and the active writer.

    Asserts:
    - the port's beats and addresses follow the order in which the bursts began;
    - a burst has as many beats as it announced, and its last one is marked;
    - data and strobes are the writer's, and bytes without a strobe are 0; a failing half begins no
      burst, and the beats that complete its open burst have no strobes set;
    - while the port takes beats, a writer that can continue its burst, or that can begin one and is
      not patient, does not wait.
    """

    def __init__(self, m: Module, part: Axi):
        self.within, self.owner = Signal(), Signal(spec.ID_BITS)  # a burst is open; its writer
        self.rest = Signal(spec.LENGTH_BITS)  # its beats still to come
        self.aw, self.w = Signal(part.aw.i.payload.shape()), Signal(part.w.i.payload.shape())
        self.wants, self.gives = Signal(len(spec.WRITERS)), Signal()
        taken, within, rest = part.beats_written, self.within, self.rest
        for k in range(len(spec.WRITERS)):
            self._take(m, part, k)
        m.d.comb += self.w.last.eq(Mux(within, rest == 1, self.aw.burst.length == 0))
        self.begins = taken.any() & ~within
        with m.If(taken.any()):
            m.d.sync += [self.within.eq(~self.w.last), self.owner.eq(self.w.client)]
            m.d.sync += rest.eq(Mux(within, rest - 1, self.aw.burst.length))
        port, handshake = part.m_axi, channel(part.m_axi, "w")[:2]
        self.addresses = addresses(m, part, "aw", part.aw, self.begins, self.aw)
        self.beats = InOrder(m, part.w, taken.any(), self.w, *handshake)
        first, full = self.beats.first, self.beats.count == CHANNEL_DEPTH
        data = port.wdata == (first.data & lanes(first.strobe))
        strobes = port.wstrb == first.strobe
        begin = (self.wants & ~part.patient).any() & (self.addresses.count != CHANNEL_DEPTH)
        m.d.comb += [
            Assert(at_most_one(taken)),
            Assert(~port.wvalid | (data & strobes & (port.wlast == first.last))),
            Assert(taken.any() | full | ~Mux(within, self.gives, begin)),
            # Why: the burst being written.
            Assert(part.inside == within),
            Assert(~within | ((part.left == rest) & (rest != 0))),
            Assert(~within | (part.owner == 1 << self.owner)),
            Assert(~within | (self.owner < len(spec.WRITERS))),
        ]

    def _take(self, m: Module, part: Axi, k: int):
        """Check a beat of writer k, or the one sent in its place if its half fails."""
        i, taken = part.writes[k], part.beats_written[k]
        failing, burst = part.failing[list(spec.WRITERS.values())[k]], Signal(self.aw.burst.shape())
        goes_on, wants = self.within & (self.owner == k), self.wants[k]
        m.d.comb += [
            burst.beat.eq(i.payload.beat),
            burst.length.eq(i.payload.length),
            Assume(~i.valid | allowed(part.config, burst)),
            wants.eq(i.valid & ~failing & ~part.bursts[k].all()),
            Assert(~taken | Mux(self.within, goes_on & (i.valid | failing), wants)),
            Assert(i.ready == (taken & ~(self.within & failing))),
            Cover(taken & goes_on & failing & self.w.last),
        ]
        if spec.window_bits(part.config):
            with m.If(taken):
                m.d.comb += self.aw.window.eq(part.write_windows[k])
        with m.If(goes_on):
            m.d.comb += self.gives.eq(i.valid | failing)
        with m.If(taken):
            m.d.comb += [
                self.aw.client.eq(k),
                self.aw.burst.eq(burst),
                self.w.client.eq(k),
                self.w.data.eq(write_data(part.config, i.payload)),
                self.w.strobe.eq(Mux(self.within & failing, 0, i.payload.strobe)),
            ]


def answered(m: Module, part: Axi, given: Given) -> tuple[list[Value], tuple[Value, Value]]:
    """Check that a response ends a burst of its writer: address and last beat passed the port.

    Each burst takes one response, and responses never wait. Any other response is a stray. Returns
    the number of unanswered bursts per writer; and whether a response is a stray, with its ID.
    """
    port = part.m_axi
    address, last = passes(port, "aw"), passes(port, "w") & port.wlast
    lead = Signal(range(-UNSENT - 1, UNSENT + 1))  # addresses passed minus last beats
    m.d.sync += lead.eq(lead + address - last)
    by_last = last & ((lead > 0) | ((lead == 0) & address))
    leaves = by_last | (address & (lead < 0))
    leaver = Mux(by_last, given.beats.first.client, port.awid)
    recent, unsent = _recent(m, given, lead)
    held, client, error = Signal(), Signal(spec.ID_BITS), Signal()
    m.d.sync += [held.eq(port.bvalid), client.eq(port.bid), error.eq(port.bresp[ERROR])]
    right, left = Signal(), []
    for k in range(len(spec.WRITERS)):
        count, mine = Signal(len(part.bursts[k]) + 1, name=f"sent{k}"), held & (client == k)
        done = mine & (count != 0)
        m.d.sync += count.eq(count + (leaves & (leaver == k)) - done)
        inside = Cat((recent[n] == k) & (unsent > n) for n in range(UNSENT))
        left.append(count + sum(inside))
        m.d.comb += Assert(part.bursts[k] == left[k])  # so the counter does not wrap
        with m.If(done):
            m.d.comb += right.eq(1)
        m.d.comb += Cover(mine & ~done & inside.any())
    reported = part.write_error
    m.d.comb += [
        Assert(port.bready),
        Assert(reported.valid == (right & error)),
        Assert(~reported.valid | (reported.client == client)),
        Cover(lead == -CHANNEL_DEPTH),
        Cover((lead == CHANNEL_DEPTH) & (recent[0] == recent[1]) & right & error),
    ]
    return left, (held & ~right, client)


def _recent(m: Module, given: Given, lead: Signal) -> tuple[Array, Value]:
    """Return the writers of the newest bursts, newest first, and the number not fully sent.

    Their addresses and last beats are the waiting ones; the burst being written adds its last beat.
    """
    aw, w, within = given.addresses, given.beats, given.within
    recent = Array(Signal(spec.ID_BITS, name=f"recent{n}") for n in range(UNSENT + 1))
    with m.If(given.begins):
        m.d.sync += recent[0].eq(given.aw.client)
        m.d.sync += [recent[n + 1].eq(recent[n]) for n in range(UNSENT)]
    second, first = (w.count == CHANNEL_DEPTH) & w.second.last, (w.count != 0) & w.first.last
    lasts, unsent = Signal(range(UNSENT + 2)), Signal(range(UNSENT + 1))
    m.d.comb += [
        lasts.eq(first + second + within),
        unsent.eq(Mux(lasts > aw.count, lasts, aw.count)),
    ]
    m.d.comb += [Assert((unsent <= n) | (recent[n] < len(spec.WRITERS))) for n in range(UNSENT)]
    # A beat that is not the last is followed by one of its own burst, waiting or still to come.
    newest = Mux(w.count == CHANNEL_DEPTH, w.second.client, w.first.client)
    ended = Mux(w.count == CHANNEL_DEPTH, w.second.last, w.first.last)
    m.d.comb += [
        Assert((w.count == 0) | Mux(ended, ~within, within & (newest == given.owner))),
        Assert((w.count != CHANNEL_DEPTH) | w.first.last | (w.first.client == w.second.client)),
        Assert(lasts <= UNSENT),
        Assert(lead == lasts - aw.count),
        Assert(~within | (given.owner == recent[0])),
        Assert(~second | (w.second.client == recent[within])),
        Assert(~first | (w.first.client == recent[within + second])),
        Assert((aw.count != CHANNEL_DEPTH) | (aw.second.client == recent[0])),
        Assert((aw.count == 0) | (aw.first.client == recent[aw.count == CHANNEL_DEPTH])),
    ]
    return recent, unsent
