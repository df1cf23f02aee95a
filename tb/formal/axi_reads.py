"""Properties of the AXI4 master's reads, with their induction invariants."""

from functools import partial

from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal, Value

from splatcore.hdl.memory.axi import ERROR, HALVES, Axi
from splatcore.spec import axi as spec
from tb.formal.axi_rules import (
    CHANNEL_DEPTH,
    InOrder,
    addresses,
    allowed,
    at_most_one,
    passes,
    works_for,
)


def asked(m: Module, part: Axi) -> InOrder:
    """Check that the readers' requests reach the port, and that a failing half requests nothing.

    While the channel has room, one reader that wants it is served. Returns the requests that wait
    for the port.
    """
    item, count = Signal(part.ar.i.payload.shape()), len(spec.READERS)
    taken, wants = Signal(count), Signal(count)
    for k, (i, half) in enumerate(zip(part.reads, spec.READERS.values(), strict=True)):
        m.d.comb += [
            Assume(~i.valid | allowed(part.config, i.payload)),
            taken[k].eq(i.valid & i.ready),
            wants[k].eq(i.valid & ~part.failing[half] & ~part.asked[half].all()),
            Assert(~i.ready | wants[k]),
        ]
        with m.If(taken[k]):
            m.d.comb += [item.client.eq(k), item.burst.eq(i.payload)]
            if spec.window_bits(part.config):
                m.d.comb += item.window.eq(part.read_windows[k])
    order = addresses(m, part, "ar", part.ar, taken.any(), item)
    for number, waiting in enumerate((order.first, order.second)):
        m.d.comb += Assert((order.count <= number) | (waiting.client < count))
    m.d.comb += Assert(at_most_one(taken))
    m.d.comb += Assert(taken.any() | ~wants.any() | (order.count == CHANNEL_DEPTH))
    return order


def returned(m: Module, part: Axi, ar: InOrder) -> tuple[list[Value], tuple[Value, Value]]:
    """Check that a beat goes to its reader, once, if its half has an unanswered request.

    A request counts from the cycle in which the port takes it. Any other beat is a stray and is
    dropped at once. Returns the number of unanswered requests per half, including those that wait
    for the port; and whether a beat is a stray, with its ID.
    """
    port = part.m_axi
    held, client, error = Signal(), Signal(spec.ID_BITS), Signal()
    beat = Signal(part.data[0].payload.shape())
    with m.If(port.rready):
        m.d.sync += [held.eq(port.rvalid), client.eq(port.rid), error.eq(port.rresp[ERROR])]
        m.d.sync += [beat.beat.eq(port.rdata), beat.last.eq(port.rlast)]
    fires, right, failing, ready, left = Signal(), Signal(), Signal(), Signal(), []
    for half in HALVES:
        of = partial(works_for, spec.READERS, half)
        count, mine = Signal(len(part.asked[half]) + 1, name=f"out{half}"), of(client)
        done = fires & mine & beat.last
        m.d.sync += count.eq(count + (passes(port, "ar") & of(port.arid)) - done)
        waiting = ar.count_of(of)
        left.append(count + waiting)
        m.d.comb += Assert(part.asked[half] == left[half])  # so the counter does not wrap
        with m.If(mine):
            m.d.comb += [right.eq(held & (count != 0)), failing.eq(part.failing[half])]
        m.d.comb += Cover(done & (count == 2) & (waiting != 0))
    for k, o in enumerate(part.data):
        m.d.comb += Assert(o.valid == (right & (client == k) & ~failing))
        m.d.comb += Assert(~o.valid | (o.payload == beat))
        with m.If(client == k):
            m.d.comb += ready.eq(o.ready)
    reported = part.read_error
    m.d.comb += [
        fires.eq(right & (ready | failing)),
        Assert(port.rready == (~right | fires)),  # only its own reader can stall a beat
        Assert(part.beats_read == Mux(fires, 1 << client, 0)),
        Assert(reported.valid == (fires & error)),
        Assert(~reported.valid | (reported.client == client)),
        # Why: the register holds the beat read last.
        Assert(part.r_full == held),
        Assert(~held | ((part.r_client == client) & (part.r_error == error))),
        Assert(~held | (part.data[0].payload == beat)),
        Cover(held & ~right & (ar.count != 0) & (client == ar.first.client)),
    ]
    return left, (held & ~right, client)
