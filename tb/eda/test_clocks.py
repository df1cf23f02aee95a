"""Clock gates: observers of registers in Verilog, groups of flip-flops, their shares of cycles."""

import re

from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.eda.gates.machine_gates import PARTS, Piece
from splatcore.eda.gates.synth import CLOCK_GATE_NAND2, Netlist, gates
from splatcore.eda.power import clocks
from splatcore.eda.power.activity import Register
from splatcore.eda.power.clocks import Clocked, clocked
from splatcore.eda.power.loads import observed
from splatcore.hdl.lib.stream import Queue
from splatcore.sim.rtl.convert import converted
from splatcore.spec.config import TINY


class Registers(wiring.Component):
    """Registers with and without enables."""

    def __init__(self):
        super().__init__({
            "i": In(8), "enable": In(1), "high": In(1),
            "held": Out(8), "parts": Out(8), "free": Out(8), "rest": Out(8),
        })  # fmt: skip

    def elaborate(self, platform) -> Module:
        m = Module()
        kept = Signal(8, reset_less=True, name="kept")
        m.d.comb += self.rest.eq(kept)
        m.d.sync += self.free.eq(self.i)
        with m.If(self.enable):
            m.d.sync += [self.held.eq(self.i), kept.eq(~self.i)]
        with m.If(self.high):
            m.d.sync += self.parts[4:].eq(self.i)
        with m.Else():
            m.d.sync += self.parts[:4].eq(self.i)
        return m


def test_observers():
    """One bit per register that is loaded as a whole, else one per bit; a reset is not a load."""
    text = observed(converted(Registers()))
    lines = {line.strip() for line in text.splitlines()}
    assert {r"reg \held$loads ;", r"reg \rest$loads ;", r"reg [7:0] \parts$loads ;"} <= lines
    assert r"\parts$loads  = 0;" in lines
    for part in ("[7:4]", "[3:0]"):
        assert any(line.endswith(rf"\parts$loads {part} = '1; end") for line in lines)
    assert text.count(r"\held$loads  = '1;") == text.count(r"\rest$loads  = '1;") == 1
    reset = text[text.index("if (rst) begin") :].partition("end")[0]
    assert "$loads" not in reset
    assert text.count("$loads ") == text.count(r"\free$loads ") + 10


def test_observers_are_in_order():
    """The text is the same in each process: the cache finds it again."""
    registers = "".join(f"  always @(posedge clk)\n    q{k} <= d{k};\n" for k in range(20))
    text = observed(f"module top(clk);\n{registers}endmodule\n")
    assert re.findall(r"wire \\q(\d+)\$loads", text) == [str(k) for k in range(20)]


def test_gates():
    """Four groups of eight or four flip-flops get a gate; the free ones do not."""
    found = gates(Registers())
    assert (found.flip_flops, found.clock_gates) == (32, 4)
    enables = 24 * 3  # multiplexers in place of gates
    assert found.nand2 < 32 * 8 + enables + CLOCK_GATE_NAND2 * 4


def test_clocked(monkeypatch):
    """A gate is open as often as its registers load; words of a memory share its writes."""
    registers, queue = Netlist.of(Registers()), Netlist.of(Queue(8, 4))
    pieces = [Piece(PARTS[0], "a", registers), Piece(PARTS[1], "b$1.c", queue)]
    monkeypatch.setattr(clocks, "netlist", lambda config: None)
    monkeypatch.setattr(clocks, "pieces", lambda hierarchy: pieces)
    clocks.clock_groups.cache_clear()
    name = PARTS[0].name
    loads = {"a.held": [0.25], "a.rest": [0.5], "a.parts": 4 * [0.125] + 4 * [1.0], "a.free": [0.5]}
    known = {key: Register(name, 8, share, 0.0) for key, share in loads.items()}
    known |= {"b.c.storage": Register(PARTS[1].name, 0, [0.5], 0.0)}
    found = clocked(TINY, known)
    both = found[name]
    assert (both.flip_flops, both.gated, both.gates) == (32, 24, 4)
    assert both.clocked == 8 + 8 * 0.25 + 8 * 0.5 + 4 * 0.125 + 4 * 1.0
    memory = found[PARTS[1].name]
    assert memory.gates == 4 and memory.gated == 32
    assert memory.clocked == memory.flip_flops - 32 + 32 * 0.5 / 4
    assert Clocked(0, 0, 0, 0.0).share == 1.0
    clocks.clock_groups.cache_clear()
