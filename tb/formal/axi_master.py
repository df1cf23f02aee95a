"""Properties to prove of the AXI4 master.

Nothing is assumed of the slave: it may accept in any cycle, and send any response at any time, any
number of times. Models at the port count only its transfers; models of the clients know what the
clients sent. Between the two are registers of two items; comments "Why" mark the induction
invariants, which say what these registers hold.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from amaranth.hdl import Assert, Cat, Cover, Module, Mux, Signal, Value

from splatcore.hdl.memory import axi
from splatcore.hdl.memory.axi import HALVES, Axi
from splatcore.spec import axi as spec
from splatcore.spec.config import TINY, Config
from tb.formal.axi_reads import asked, returned
from tb.formal.axi_rules import Around, channel, kept, works_for
from tb.formal.axi_writes import Given, answered
from tb.formal.proof import Part, Proof
from tb.helpers.configs import other_port, wide_addresses
from tb.planted.fault import planted_in


class Master(Around):
    """The master before a free slave, with models of the transfers in flight.

    Assumes: clients request bursts that AXI allows (`allowed`). They may withdraw and change their
    offers, and a half may fail and recover in any cycle.

    Asserts:
    - AR, AW and W keep an offer until it is taken;
    - requests and data reach the port in order, once and unchanged, as bursts that AXI allows, with
      their client's ID (`addresses`, `asked`, `Given`);
    - responses and errors are counted and reported once, for their client (`returned`, `answered`);
    - a response that is early, surplus or of an unknown client is reported as a stray; it ends no
      burst and stalls nothing;
    - a half is idle, a writer settled, exactly if it has nothing in flight;
    - no counter wraps.
    """

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        for name in ("ar", "aw", "w"):
            kept(m, *channel(part.m_axi, name))
        reads, read_stray = returned(m, part, asked(m, part))
        given = Given(m, part)
        writes, write_stray = answered(m, part, given)
        self._idle(m, reads, writes, given)
        (read, reader), (written, writer), stray = read_stray, write_stray, part.stray
        m.d.comb += [
            Assert(stray.valid == (read | written)),
            Assert(~stray.valid | (stray.written == written)),  # of two at a time, the write's
            Assert(~stray.valid | (stray.client == Mux(written, writer, reader))),
        ]
        return m

    def _idle(self, m: Module, reads: list[Value], writes: list[Value], given: Given):
        """Check `settled` of the writers and `idle` of the halves against the bursts in flight."""
        part, port = self.inner, self.inner.m_axi
        for k, left in enumerate(writes):
            addresses, beat = port.awvalid & (port.awid == k), given.beats.first
            waits = port.wvalid & (beat.client == k)
            m.d.comb += Assert(part.settled[k] == (left == 0))
            m.d.comb += Assert(~part.settled[k] | ~(addresses | waits))
        for half, left in zip(HALVES, reads, strict=True):
            of = enumerate(spec.WRITERS.values())
            settled = Cat(part.settled[k] for k, its in of if its == half).all()
            m.d.comb += Assert(part.idle[half] == ((left == 0) & settled))
            mine = works_for(spec.READERS, half, port.arid)
            m.d.comb += Assert(~part.idle[half] | ~(port.arvalid & mine))
        worked = Signal(2)
        m.d.sync += worked.eq(worked | Cat(part.beats_read.any(), part.beats_written.any()))
        m.d.comb += Cover(worked.all() & part.idle.all())


COVER_DEPTH = 12  # cycles within which every cover is reached
FAULT_DEPTH = 7  # cycles within which every planted fault shows

WIDE = wide_addresses(TINY)

LEFT = "(count > addresses) & (count > lasts)"

FAULTS = planted_in(
    Axi,
    _answers={
        "done before its last beat": (LEFT, "(count > addresses)"),
        "done before its address": (LEFT, "(count > lasts)"),
        "surplus answers are counted": (f"Mux({LEFT}, mine, 0)", "mine"),
        "a stray's error is reported": ("answered.any() & error", "full & error"),
    },
    _return={
        "an answer before its request": ("self.asked[half] > waits", "self.asked[half] > 0"),
        "a stray blocks the channel": ("fire.any() | stray)", "fire.any())"),
        "a stray beat is not reported": ("self.stray.valid.eq(1)", "self.stray.valid.eq(0)"),
        "a beat to a half that fails": ("target[k] & ~self.failing[half]", "target[k]"),
        "a beat is lost": ("m_axi.rready.eq(~full", "m_axi.rready.eq(1"),
        "any beat is the last one": (".any() & beat.last", ".any()"),
    },
    _write={
        "a burst ends early": ("left == 1", "left == 2"),
        "another length is announced": ("length.eq(given.length)", "length.eq(0)"),
        "an address without its beat": ("wants.any() & beat.ready", "wants.any()"),
        "a beat without its address": ("wants.any() & address.ready", "wants.any()"),
        "another's ID": ("client.eq(encoded(turns.chosen))", "client.eq(encoded(owner))"),
        "a half that fails still writes": ("Mux(abandoned, 0, given.strobe)", "given.strobe"),
        "more than can be counted": ("full[k].eq(self.bursts[k].all())", "full[k].eq(0)"),
        "another writer's window": ("chosen, self.write_w", "wants, self.write_w"),
    },
    _address={
        "an offer is withdrawn": ("request.valid,", "request.valid & ~self.failing[0],"),
        "another address": ("burst.beat[below:]", "~burst.beat[below:]"),
        "a window that is not kept": ("request.payload.window", "self.read_windows[0]"),
    },
    _ask={"another reader's window": ("chosen, self.read_w", "wants, self.read_w")},
    elaborate={
        "idle while reads are open": ("(self.asked[half] == 0) & settled", "settled"),
        "a byte without a strobe": (" & lanes(w.payload.strobe)", ""),
    },
)


@contextmanager
def small() -> Iterator[None]:
    """Few clients, of both halves, and small counters, so that a search is quick."""
    clients = {"a": 0, "b": 1, "c": 1}
    with (
        patch.object(spec, "READERS", clients),
        patch.object(spec, "WRITERS", clients),
        patch.object(axi, "OUTSTANDING_BITS", 2),
    ):
        yield


def part(config: Config, **about) -> Part:
    return Part(lambda: Master(Axi(config)), **about)


PROOF = Proof(
    {
        "master": part(TINY, cover=COVER_DEPTH),
        "other port": part(other_port(TINY), verify=True),
        "wide addresses": part(WIDE, verify=True),
        "small": part(TINY, setting=small),
        "small, wide addresses": part(WIDE, setting=small, verify=True),
    },
    FAULTS,
    {"": part(WIDE, search=FAULT_DEPTH, setting=small)},
)
