"""Properties of an AXI4-Lite slave, the registers, as a component to prove."""

from amaranth.hdl import Assert, Cover, Module, Signal

from splatcore.hdl.registers import WORD_BITS
from splatcore.spec.axi import OKAY
from tb.formal.axi_rules import Around, channel, kept, open_ones, passes, within

ROOM = 2  # questions of a channel inside: one being done, one answered that is not taken
LATENCY = 1  # cycles without an answer, with a question inside


class Answers(Around):
    """Registers, before a master of which nothing is assumed: it may withdraw its offers.

    Asserted: an answer is kept until it is taken; there is none without its question, an address
    and data for a write, and one for each; it comes `LATENCY` cycles later at the latest, as the
    answer before it is taken. Address and data are taken in any order: neither waits for the other.
    A write is done once, in its own address with its own data, if all strobes are set; it says
    OKAY if it was done, and only then.
    """

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        port = part.s_axi
        for name in ("b", "r"):
            kept(m, *channel(port, name))
        addresses, datas, reads = (
            open_ones(m, passes(port, question), passes(port, answer))
            for question, answer in (("aw", "b"), ("w", "b"), ("ar", "r"))
        )
        for valid, count, ready in (
            (port.bvalid, addresses, port.awready),
            (port.bvalid, datas, port.wready),
            (port.rvalid, reads, port.arready),
        ):
            m.d.comb += [
                Assert(~valid | (count != 0)),
                Assert(count <= ROOM),
                # Why: a question is held, behind it an answer. None is refused if none is held.
                Assert(count == ~ready + valid),
            ]
        within(m, (addresses != 0) & (datas != 0) & ~port.bvalid, LATENCY)
        within(m, (reads != 0) & ~port.rvalid, LATENCY)
        self._done_once(m)
        answered = passes(port, "b") & passes(port, "r")
        for first, second in ((addresses, datas), (datas, addresses)):  # either before the other
            m.d.comb += Cover(answered & (first == ROOM) & (second == 1))
        return m

    def _done_once(self, m: Module):
        """What is written is what was given last, and its answer begins when it is done."""
        part, port = self.inner, self.inner.s_axi
        word, value, whole = Signal.like(part.word), Signal.like(part.value), Signal()
        with m.If(passes(port, "aw")):
            m.d.sync += word.eq(port.awaddr[WORD_BITS:])
        with m.If(passes(port, "w")):
            m.d.sync += [value.eq(port.wdata), whole.eq(port.wstrb.all())]
        done, taken, answered = Signal(), Signal(), Signal()
        m.d.sync += [done.eq(part.write), answered.eq(port.bvalid & ~port.bready)]
        with m.If(part.write):
            m.d.sync += taken.eq(part.taken)
        m.d.comb += [
            Assert(~part.write | (~port.awready & ~port.wready)),
            Assert(port.awready | (part.word == word)),
            Assert(port.wready | ((part.value == value) & (part.whole == whole))),
            Assert(~part.taken | (part.write & whole)),
            Assert(port.bvalid == (done | answered)),
            Assert(~done | ~answered),
            Assert(~port.bvalid | ((port.bresp == OKAY) == taken)),
        ]
