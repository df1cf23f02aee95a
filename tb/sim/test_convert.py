"""Converted Verilog has the right values from time 0 on, and nothing twice."""

import gc
import re
import subprocess

import pytest
from amaranth.hdl import Const, Elaboratable, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.eda.deliver.names import readable
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.merge import merged
from tb.helpers.front_ends import read_slang
from tb.helpers.runs import needs_icarus

BENCH = """
module bench;
  reg clk = 0, rst = 0;
  wire [7:0] chosen, part;
  top top (.clk(clk), .rst(rst), .turn(1'b0), .chosen(chosen), .part(part));
  initial #1 $display("%b %b", chosen, part);
endmodule
"""


class Still(wiring.Component):
    """Logic behind a register that keeps its initial value, and a signal assigned in slices."""

    turn: In(1)
    chosen: Out(8)
    part: Out(8)

    def elaborate(self, platform) -> Module:
        m = Module()
        at_time_0 = Signal(init=1)  # the converter uses this name, too
        m.d.sync += at_time_0.eq(at_time_0 ^ self.turn)
        m.d.comb += self.chosen.eq(0x0F)
        with m.If(at_time_0):
            m.d.comb += self.chosen.eq(0x5A)
        m.d.comb += [self.part[:2].eq(Const(0)), self.part[2:7].eq(self.chosen), self.part[7].eq(1)]
        return m


@needs_icarus
@pytest.mark.parametrize("standard", ["-g2005", "-g2012"])
def test_every_block_runs_before_the_first_edge(standard, tmp_path):
    """Every block runs once, although its inputs never change: in SystemVerilog initial values
    are set before blocks start to wait, so no event would trigger them."""
    (tmp_path / "bench.v").write_text(converted(Still()) + BENCH)
    subprocess.run(["iverilog", standard, "-s", "bench", "-o", "bench", "bench.v"],
                   cwd=tmp_path, check=True)  # fmt: skip
    done = subprocess.run(
        ["vvp", "bench"], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert done.stdout.split() == ["01011010", "11101000"]


def test_yosys_reads_it(tmp_path):
    """slang in yosys knows few statements in `initial`, and no names like `\\$1`."""
    (tmp_path / "top.v").write_text(readable(converted(Still(), emit_src=True)))
    assert not read_slang("top", tmp_path / "top.v")


def test_garbage_collection_is_restored():
    before = gc.get_threshold()
    converted(Still())
    assert gc.get_threshold() == before


class Next(Elaboratable):
    """A value plus a step."""

    def __init__(self, value: Value, step: int):
        self.value, self.step = value, step
        self.o, _ = Signal(9), None  # without a name

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.comb += self.o.eq(self.value + self.step)
        return m


class Twins(wiring.Component):
    """Three submodules, of which the first two are equal, and the same product in each output."""

    a: In(4)
    b: In(4)
    o: Out(9).array(3)

    def elaborate(self, platform) -> Module:
        m = Module()
        for k, step in enumerate((1, 1, 2)):
            m.submodules[f"part{k}"] = part = Next(self.a, step)
            m.d.comb += self.o[k].eq(part.o ^ (self.a * self.b))
        return m


def test_equal_operators_are_emitted_once():
    text = converted(Twins())
    assert text.count("a * b") == 1


def test_equal_modules_are_merged():
    """Each instance is connected to the ports of the module that stands for its own."""
    text = merged(converted(Twins()))
    assert re.findall(r"^module (\\\S+|\w+)", text, re.M) == [r"\top.part0", r"\top.part2", "top"]
    parts = re.findall(r"^  (\\top\S+)  \w+ \(\n    \.a\(a\),\n    \.(\S+) \((\S+) \)", text, re.M)
    names, ports, signals = zip(*parts, strict=True)
    assert names == (r"\top.part0", r"\top.part0", r"\top.part2")
    assert set(ports) == {r"\port$0"} and len(set(signals)) == 3
