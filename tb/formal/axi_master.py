"""Properties to prove of the AXI4 master.

Nothing is assumed of the slave: it may accept in any cycle, and send any response at any time, any
number of times. Models at the port count only its transfers; models of the clients know what the
clients sent. Between the two are registers of two items; comments "Why" mark the induction
invariants, which say what these registers hold.
"""

from amaranth.hdl import Assert, Cat, Cover, Module, Mux, Signal, Value

from splatcore.hdl.memory.axi import HALVES
from splatcore.spec import axi as spec
from tb.formal.axi_bursts import works_for
from tb.formal.axi_reads import asked, returned
from tb.formal.axi_rules import Around, channel, kept
from tb.formal.axi_writes import Given, answered


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
