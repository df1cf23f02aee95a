"""Properties of the AXI4 master, as a component to prove.

Nothing is assumed of the slave: it takes when it likes, and answers what, when and as often as it
likes. What follows the port counts what passes there alone; what follows the clients knows what
they have given. In between are registers of two items; parts marked “why” say what these hold.
"""

from amaranth.hdl import Assert, Cat, Cover, Module, Mux, Signal, Value

from splatcore.hdl.memory.axi import HALVES
from splatcore.spec import axi as spec
from tb.formal.axi_bursts import works_for
from tb.formal.axi_reads import asked, returned
from tb.formal.axi_rules import Around, channel, kept
from tb.formal.axi_writes import Given, answered


class Master(Around):
    """The master before any slave, and what is under way at the port and in between.

    Assumed: what clients ask for are bursts that AXI allows (`allowed`). They may withdraw and
    change their offers, and a half may fail and recover in any cycle.

    Asserted: an offer is kept until it is taken, on AR, AW and W; what is asked for and given comes
    to the port in order, once and unchanged, as bursts that AXI allows, with their clients' IDs
    (`addresses`, `asked`, `Given`); what comes back is counted and told once and for its client,
    an error too (`returned`, `answered`). What comes too early, too often or for nobody is told as
    a stray, ends no burst and keeps nothing waiting. A half is idle, a writer settled, if nothing
    of it is under way, and only then. No count wraps.
    """

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        for name in ("ar", "aw", "w"):
            kept(m, *channel(part.m_axi, name))
        reads, read_stray = returned(m, part, asked(m, part))
        given = Given(m, part)
        writes, write_stray = answered(m, part, given)
        self._idle(m, reads, writes, given)
        (read, reader), (written, writer), told = read_stray, write_stray, part.stray
        m.d.comb += [
            Assert(told.valid == (read | written)),
            Assert(~told.valid | (told.written == written)),  # of two at a time one is told
            Assert(~told.valid | (told.client == Mux(written, writer, reader))),
        ]
        return m

    def _idle(self, m: Module, reads: list[Value], writes: list[Value], given: Given):
        """What is told of clients and halves that have nothing under way."""
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
