"""Parts on an FPGA: reading nextpnr's reports and logs, parts that do not fit, the wrapper."""

import json
import re
import sys
from pathlib import Path

import pytest
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator

from splatcore.app.cli import sizes
from splatcore.eda.fpga import fpga
from splatcore.eda.fpga.fpga import NotPlaced, Placed, placed
from splatcore.eda.fpga.fpga_wrap import Lanes, Wrap
from splatcore.hdl.lib.stream import Queue, Register
from splatcore.spec.cache import VARIABLE
from splatcore.spec.config import TINY
from splatcore.spec.raster import block_count
from tb.helpers.command import run

BITS = 30  # width of a queue's items

LOG = """\
Info: Packing constants..
Info: Device utilisation:
Info: \t          TRELLIS_IO:       4/    197     2%
Info: \t              DP16KD:       6/     56    10%
Info: \t          MULT18X18D:      64/     28   228%
Info: \t          TRELLIS_FF:    8437/  24288    34%
Info: \t        TRELLIS_COMB:   26670/  24288   109%

Info: Placed 0 cells based on constraints.
ERROR: Unable to place cell 'top.x', no BELs remaining to implement cell type 'MULT18X18D'
0 warnings, 1 error
"""


@pytest.fixture(autouse=True)
def kept(monkeypatch, tmp_path) -> Path:
    """An empty cache for each test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


def step(kind: str, delay: float, begin: str, end: str) -> dict:
    return {"type": kind, "delay": delay, "from": {"cell": begin}, "to": {"cell": end}}


REPORT = {
    "utilization": {
        kind: {"available": 24288, "used": used}
        for kind, used in (("DP16KD", 6), ("TRELLIS_FF", 400), ("TRELLIS_COMB", 300))
    },
    "fmax": {"$glbnet$clk": {"achieved": 123.456, "constraint": 100.0}},
    "critical_paths": [
        {"from": "<async>", "to": "posedge $glbnet$clk", "path": [step("routing", 9, "d", "x")]},
        {
            "from": "posedge $glbnet$clk",
            "to": "posedge $glbnet$clk",
            "path": [
                step("clk-to-q", 0.5, "part.a.b_TRELLIS_FF_Q_18", "part.a.b_TRELLIS_FF_Q_18"),
                step("routing", 1.25, "part.a.b_TRELLIS_FF_Q_18", "part.c_LUT4_Z"),
                step("logic", 0.25, "part.c_LUT4_Z", "part.c_LUT4_Z"),
                step("routing", 1.5, "part.c_LUT4_Z", "part.e.d$8_TRELLIS_FF_Q"),
                step("setup", 0.125, "part.e.d$8_TRELLIS_FF_Q", "part.e.d$8_TRELLIS_FF_Q"),
            ],
        },
    ],
}


class Small(wiring.Component):
    """Adds up a stream's nibbles; its ports include arrays and a stream."""

    def __init__(self):
        inputs = {"i": In(stream.Signature(4)), "pair": In(data.ArrayLayout(3, 2))}
        super().__init__(inputs | {"lines": Out(4).array(3), "sum": Out(12)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.comb += self.i.ready.eq(1)
        m.d.comb += [line.eq(self.pair[0] + k) for k, line in enumerate(self.lines)]
        with m.If(self.i.valid):
            m.d.sync += self.sum.eq(self.sum + self.i.payload * self.pair[1])
        return m


def test_log():
    found = fpga.used(LOG)
    assert (found["MULT18X18D"], found["TRELLIS_FF"]) == ((64, 28), (8437, 24288))
    assert fpga.why_not(LOG) == "does not fit: luts 26670 of 24288, multipliers 64 of 28"
    fits = LOG.replace("64/", "4/").replace("26670/", "2667/")
    assert fpga.why_not(fits).startswith("Unable to place cell")
    assert fpga.why_not("Info: a\nKilled\n") == "nextpnr failed: Killed"


def test_report():
    wrap = Wrap(Small())
    assert (wrap.inputs, wrap.outputs) == (4 + 1 + 6, 1 + 3 * 4 + 12)
    assert (wrap.flip_flops, wrap.luts) == (11 + 2 * 25, 24)
    assert fpga.from_report(REPORT, wrap) == Placed(
        300 - 24, 400 - 61, 0, 6, 123.46, "a.b", "e.d", logic=0.88, routing=2.75
    )  # fmt: skip
    assert fpga.register("part.x.y$3_TRELLIS_FF_Q_1") == "x.y"
    assert fpga.register("part.sums.0.33$DPRAM_COMB3") == "sums"


def shifted(word: int) -> tuple[list[int], list[int]]:
    """Shift a word in; return the part's inputs, and the bits that come out afterwards."""
    wrap, inputs, q = Wrap(Small()), [], []

    async def bench(ctx):
        for k in reversed(range(wrap.inputs)):
            ctx.set(wrap.d, word >> k & 1)
            await ctx.tick()
        inputs.extend(ctx.get(port) for port in wrap.input_ports)
        ctx.set(wrap.d, 0)
        for _ in range(2 * wrap.outputs):
            await ctx.tick()
            q.append(ctx.get(wrap.q))

    simulator = Simulator(wrap)
    simulator.add_clock(1e-6)
    simulator.add_testbench(bench)
    simulator.run()
    return inputs, q


def test_wrapper():
    """All inputs come from pin `d`, and a change of any input bit shows at pin `q`."""
    word = 0b101_011_1_1001
    inputs, q = shifted(word)
    assert sorted(inputs) == sorted([0b1001, 1, 0b101_011])
    others = [shifted(word ^ 1 << k)[1] for k in range(11)]
    assert len({tuple(q), *map(tuple, others)}) == 12


def test_lanes():
    """Four lanes have a quarter of the output bits of 16 lanes; the port names are checked."""
    four, all = (Lanes(TINY, pixels) for pixels in (4, 16))
    assert 4 * len(four.o.as_value()) == len(all.o.as_value())
    assert four.blend.blocks == block_count(TINY)
    names = {"quadratic", "number", "enable", "valid", "block", "colour", "inside", "rest"}
    assert names < set(four.signature.members) and "log2_alphas" not in four.signature.members


def test_failure_is_reported(monkeypatch, tmp_path, capsys):
    """A part that does not fit is named and the others are placed; both results are kept."""
    asked = []

    def place(text, device, speed, seed, folder, progress):
        asked.append((device, speed))
        return (None, LOG) if len(asked) == 1 else (REPORT, "")

    monkeypatch.setattr(fpga, "place", place)
    parts = {"wide": lambda config: Small(), "add": lambda config: Register(3)}
    monkeypatch.setattr(fpga, "PARTS", parts)
    out = tmp_path / "f.json"
    for _ in range(2):
        assert run("fpga", "--stage", "wide", "--stage", "add", "--device", "25K",
                   "--speed", "8", "--preset", "tiny", "--json", str(out)) == 1  # fmt: skip
        printed = capsys.readouterr().out
        assert "wide: not placed: does not fit: luts 26670 of 24288" in printed
        assert "add: from a.b to e.d" in printed and "123.5" in printed
    assert asked == [("25k", "8")] * 2
    facts = json.loads(out.read_text())
    assert list(facts["parts"]) == ["add"] and list(facts["failed"]) == ["wide"]
    assert facts["parts"]["add"]["block_rams"] == 6


NEXTPNR = """\
#!{python}
import json, sys
from pathlib import Path
seed, report = (sys.argv[sys.argv.index(name) + 1] for name in ("--seed", "--report"))
fmax = {{"$glbnet$clk": {{"achieved": {speeds}[seed], "constraint": 100.0}}}}
Path(report).write_text(json.dumps({report} | {{"fmax": fmax}}))
Path("{asked}").open("a").write(seed)
print("Info: Routing 279624 arcs.\\nInfo:    IterCnt |  w/ripup | remaining|")
print("Info:      61000 |    12318      48681 |  119   881 |    245263|       1.39      90.72|")
"""
"""A stand-in for nextpnr that writes a report and prints lines of its log."""


@pytest.fixture
def nextpnr(monkeypatch, tmp_path):
    """Install that stand-in, and one for yosys; return the file to which it adds its seeds."""
    program, asked = tmp_path / "nextpnr", tmp_path / "asked"
    program.write_text(
        NEXTPNR.format(
            python=sys.executable, report=REPORT, asked=asked,
            speeds={"1": 50.0, "2": 61.5, "3": 55.0},
        )
    )  # fmt: skip
    program.chmod(0o755)
    monkeypatch.setattr(fpga, "find_nextpnr", lambda: program)
    monkeypatch.setattr(fpga, "yosys", lambda script, files: {"top.json": "{}"})
    return asked


def test_without_nextpnr(monkeypatch, tmp_path, capsys):
    """The error names the extra that installs it."""
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    assert run("fpga", "--stage", "cull") == 2
    assert "pip install 'splatcore[fpga]'" in capsys.readouterr().err


def test_whole(monkeypatch, nextpnr, tmp_path, capsys):
    """`--whole` places with three seeds and reports the fastest; all results are kept."""
    monkeypatch.setattr(sizes, "Top", lambda config: Register(3))
    out = tmp_path / "f.json"
    for _ in range(2):
        assert run("fpga", "--whole", "--json", str(out)) == 0
        printed = capsys.readouterr().out
        assert "preset FPGA" in printed and "whole, seed 3" in printed and "61.5" in printed
    assert nextpnr.read_text() == "123"
    facts = json.loads(out.read_text())
    assert facts["parts"]["whole"]["fmax_mhz"] == 61.5
    assert [tried["fmax_mhz"] for tried in facts["seeds"]] == [50.0, 61.5, 55.0]


def test_progress(nextpnr):
    """Synthesis runs once for two seeds; progress shows the arcs left to route."""
    steps = []
    assert len(list(placed(Register(3), "25k", seeds=2, progress=steps.append))) == 2
    routing = ["placing", "routing, 245,263 arcs left"]
    assert steps == ["synthesis", *routing, *routing]


def test_plain_names():
    """Brackets are removed from names of array elements, and kept for bits of wires."""
    text = "  wire width 3 \\part.slots[1][23]\n  connect \\a [2:0] \\part.slots[1][23] [1]\n"
    expected = "  wire width 3 \\part.slots.1.23\n  connect \\a [2:0] \\part.slots.1.23 [1]\n"
    assert fpga.plain(text) == expected


class Elements(wiring.Component):
    """Registers whose names look like bits of a wire, and a wire of that name."""

    def __init__(self):
        super().__init__({"i": In(3), "o": Out(2)})

    def elaborate(self, platform) -> Module:
        m = Module()
        value, elements = Signal(2, name="value"), [Signal(name=f"value[{k}]") for k in range(3)]
        m.d.sync += value.eq(value + self.i[0] + self.i[1])
        m.d.sync += [elements[k].eq(self.i[k] ^ value[0]) for k in range(3)]
        m.d.sync += self.o.eq(Mux(elements[0], value, Cat(elements[1] & elements[2], elements[1])))
        return m


@pytest.mark.slow
def test_names_of_elements():
    """All registers survive: with brackets yosys would take one for the wire's bit."""
    (found,) = placed(Elements(), "25k")
    assert found.flip_flops == 7


@pytest.mark.slow
def test_small_part(monkeypatch, kept):
    """A multiplier's numbers equal nextpnr's log; a second run uses the cache."""
    part = fpga.PARTS["multiply"](TINY)
    (found,) = placed(part, "25k")
    (path,) = kept.glob("fpga/*.json")
    log, wrap = json.loads(path.read_text())["log"], Wrap(fpga.PARTS["multiply"](TINY))
    cells = fpga.used(log)
    assert found.multipliers == cells["MULT18X18D"][0] == 1
    assert found.flip_flops + wrap.flip_flops == cells["TRELLIS_FF"][0]
    assert found.luts + wrap.luts == cells["TRELLIS_COMB"][0]
    fmax = re.findall(r"Max frequency for clock .*: ([\d.]+) MHz", log)[-1]
    assert found.fmax_mhz == float(fmax)
    again = fpga.PARTS["multiply"](TINY)
    monkeypatch.setattr(fpga, "place", None)
    assert list(placed(again, "25k")) == [found]


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "block_rams"), [(8, 0), (64, 1)])
def test_memories(rows, block_rams):
    """A small queue becomes distributed RAM, a larger one block RAM, without registers for a
    row that is read while it is written."""
    (found,) = placed(Queue(BITS, rows, memory=True), "25k")
    assert found.block_rams == block_rams
    assert found.flip_flops < BITS + 4 * rows.bit_length()


class Large(wiring.Component):
    """More multipliers than a small device has."""

    def __init__(self):
        super().__init__({"a": In(18), "o": Out(36)})

    def elaborate(self, platform) -> Module:
        m = Module()
        value = self.a
        for k in range(30):
            factor = Signal(18, name=f"factor{k}")
            product = Signal(36, name=f"product{k}")
            m.d.sync += [factor.eq(value ^ (value << k)), product.eq(factor * value)]
            value = product[9:27]
        m.d.comb += self.o.eq(product)
        return m


@pytest.mark.slow
def test_too_large():
    with pytest.raises(NotPlaced, match="does not fit: multipliers 30 of 28"):
        list(placed(Large(), "25k"))
