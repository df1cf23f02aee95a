"""Properties to prove of the registers as an AXI4-Lite slave."""

from amaranth.hdl import Assert, Cover, Module, Signal

from splatcore.hdl.registers import WORD_BITS, Registers
from splatcore.spec.axi import OKAY
from splatcore.spec.config import TINY
from tb.formal.axi_rules import Around, channel, kept, outstanding, passes, within
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

ROOM = 2  # requests inside, per channel: one being executed, one whose response is not yet taken
LATENCY = 1  # cycles without a response, with a request inside


class Answers(Around):
    """The registers before a free master, which may even withdraw its requests.

    Asserts:
    - a response stays until it is taken;
    - each request has exactly one response; a write's request is an address and data;
    - with a request inside, at most `LATENCY` cycles pass without a response;
    - a write's address and data are accepted in any order: neither waits for the other;
    - a write is executed once, at its own address with its own data, and only with all strobes set;
      its response is OKAY exactly if it was executed.
    """

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        port = part.s_axi
        for name in ("b", "r"):
            kept(m, *channel(port, name))
        addresses, datas, reads = (
            outstanding(m, passes(port, request), passes(port, response))
            for request, response in (("aw", "b"), ("w", "b"), ("ar", "r"))
        )
        for valid, count, ready in (
            (port.bvalid, addresses, port.awready),
            (port.bvalid, datas, port.wready),
            (port.rvalid, reads, port.arready),
        ):
            m.d.comb += [
                Assert(~valid | (count != 0)),
                Assert(count <= ROOM),
                # Why: one register holds a request, one a response; a free one accepts a request.
                Assert(count == ~ready + valid),
            ]
        within(m, (addresses != 0) & (datas != 0) & ~port.bvalid, LATENCY)
        within(m, (reads != 0) & ~port.rvalid, LATENCY)
        self._done_once(m)
        answered = passes(port, "b") & passes(port, "r")
        for first, second in ((addresses, datas), (datas, addresses)):  # either may come first
            m.d.comb += Cover(answered & (first == ROOM) & (second == 1))
        return m

    def _done_once(self, m: Module):
        """A write uses the latest address and data; its response begins when it is executed."""
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


FAULTS = planted_in(
    Registers,
    _take={
        "an answer is overwritten": ("addressed & given & ~s_axi.bvalid", "addressed & given"),
        "an answer is withdrawn": ("m.Elif(s_axi.bready)", "m.Else()"),
        "an answer to an address alone": ("addressed & given & ~s", "addressed & ~s"),
        "data waits for its address": ("wready.eq(~given)", "wready.eq(~given & addressed)"),
        "a second address is lost": ("awready.eq(~addressed)", "awready.eq(1)"),
        "strobes are not looked at": ("& self.whole & writable", "& writable"),
    },
    _read={
        "a read is answered twice": ("[asked.eq(0), s_axi.rvalid", "[s_axi.rvalid"),
        "data of an answer change": ("m.If(asked & ~s_axi.rvalid)", "m.If(asked)"),
    },
)

PROOF = Proof({"registers": Part(lambda: Answers(Registers(TINY)), cover=8)}, FAULTS)
