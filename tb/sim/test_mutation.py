"""Mutation: faults are found where they can be, wake alone, and are caught by thorough tests."""

import random
from collections import Counter

import numpy as np
import pytest
from amaranth.back import verilog

from splatcore.golden.arithmetic import multiply
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.lib.stream import Queue
from splatcore.sim.planted.faults import KINDS, faults
from splatcore.sim.planted.mutation import Trial, by_kind, mutants, run_mutants
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.number import Float
from tb.helpers.parts import Beside

FORMAT = Float(4, 3)
CODES = 1 << FORMAT.width
LATENCY = 2
ROWS = 2000

SMALL = r"""
module top(clk, rst, i, enable, go, o, n__valid);
  wire \$1 ;
  wire [3:0] \$2 ;
  wire [7:0] \$3 ;
  reg [7:0] \$4 ;
  wire \$5 ;
  wire \$6 ;
  input clk;
  wire clk;
  input rst;
  wire rst;
  input [7:0] i;
  wire [7:0] i;
  input enable;
  wire enable;
  input go;
  wire go;
  output [7:0] o;
  reg [7:0] o = 8'h00;
  output n__valid;
  wire n__valid;
  wire [7:0] unused;
  assign unused = i + 8'h01;
  assign \$1  = i[7] ^ i[0];
  assign \$2  = i[7:4] - i[3:0];
  assign \$3  = \$1  ? { 3'h5, \$2 , i[1] } : 8'h00;
  assign \$6  = 1'h0;
  assign n__valid = ~ \$5 ;
  always @(posedge clk)
    o <= \$4 ;
  always @* begin
    \$4  = o;
    if (enable) begin
      \$4  = \$3 ;
    end
    if (\$6 ) begin
      \$4  = 8'hff;
    end
    if (rst) begin
      \$4  = 8'h12;
    end
  end
  \top.inner  inner (
    .\a$1 (\$2 ),
    .o(\$5 )
  );
endmodule

module \top.inner (\a$1 , o);
  input [3:0] \a$1 ;
  wire [3:0] \a$1 ;
  output o;
  wire o;
  assign o = \a$1 [0] & \a$1 [1];
endmodule
"""


def expected_faults() -> dict[str, set[tuple[str, str]]]:
    """All faults of `SMALL` by line; for those that choose a bit all choices."""
    return {
        r"assign \$1  = i[7] ^ i[0];": {
            ("operator", "i[7] ~^ i[0]"), ("index", "i[6] ^ i[0]"), ("index", "i[7] ^ i[1]"),
        },
        r"assign \$2  = i[7:4] - i[3:0];": {
            ("operator", "i[7:4] + i[3:0]"),
            ("index", "i[6:3] - i[3:0]"), ("index", "i[7:4] - i[4:1]"),
        },
        r"assign \$3  = \$1  ? { 3'h5, \$2 , i[1] } : 8'h00;": {
            ("operator", r"\$1  ? 8'h00 : { 3'h5, \$2 , i[1] } "),
            *(("constant", rf"\$1  ? {{ 3'h{k}, \$2 , i[1] }} : 8'h00") for k in (1, 4, 7)),
            *(("constant", rf"\$1  ? {{ 3'h5, \$2 , i[1] }} : 8'h{1 << k:x}") for k in range(8)),
            *(("index", rf"\$1  ? {{ 3'h5, \$2 , i[{k}] }} : 8'h00") for k in (0, 2)),
        },
        r"assign \$6  = 1'h0;": {("constant", "1'h1")},
        r"assign n__valid = ~ \$5 ;": {("stall", "1'h1"), ("operator", r"\$5 ")},
        "if (enable) begin": {("stall", "1'h1"), ("condition", "1'h0")},
        r"if (\$6 ) begin": {("condition", "1'h1")},
        r"\$4  = 8'h12;": {("reset", f"8'h{0x12 ^ 1 << k:x}") for k in range(8)},
        r"assign o = \a$1 [0] & \a$1 [1];": {
            ("operator", r"\a$1 [0] | \a$1 [1]"), ("index", r"\a$1 [1] & \a$1 [1]"),
            *(("index", rf"\a$1 [0] & \a$1 [{k}]") for k in (0, 2)),
        },
    }  # fmt: skip


def test_all_faults_of_a_text():
    """Also: what is dead has none, nor has what never happens; reset itself is left alone."""
    lines = SMALL.splitlines()
    found = {}
    for seed in range(60):
        for _, place, here in faults(lines, random.Random(seed)):
            listed = {(fault.kind, fault.value) for fault in here}
            found.setdefault(lines[place.line].strip(), set()).update(listed)
    assert {line: listed for line, listed in found.items() if listed} == expected_faults()


def test_bits_that_nobody_uses():
    """A literal is flipped only where an output depends on it: through sums upward, else alone."""
    source = r"""
module top(i, o, p);
  input [7:0] i;
  output [3:0] o;
  output p;
  wire [7:0] sum;
  wire [7:0] joined;
  wire [7:0] more;
  assign sum = i + 8'h00;
  assign more = sum & 8'h00;
  assign joined = { 2'h0, more[3:1], 3'h0 };
  assign o = joined[6:3];
  assign p = more[0];
endmodule
"""
    flips = Counter()
    for seed in range(100):
        for _, _, here in faults(source.splitlines(), random.Random(seed)):
            flips.update(fault.value for fault in here if fault.kind == "constant")
    assert set(flips) == {
        *(f"i + 8'h{1 << k:x}" for k in range(4)),
        *(f"sum & 8'h{1 << k:x}" for k in range(4)),
        "{ 2'h1, more[3:1], 3'h0 }",
    }


def test_a_draw_is_spread_and_repeats_itself():
    component = Beside({"queue": Queue(8, 5), "other": Queue(8, 3)})
    source = verilog.convert(component, name="top", emit_src=False)
    text, listed = mutants(source, 18, seed=3)
    assert (text, listed) == mutants(source, 18, seed=3)
    assert listed != mutants(source, 18, seed=4)[1]
    assert [mutant.number for mutant in listed] == list(range(1, 19))
    assert all(f"mutation::selected == {k})" in text for k in range(1, 19))
    for kind in KINDS:
        places = Counter(mutant.module for mutant in listed if mutant.kind == kind)
        assert sum(places.values()) == 3, kind
        assert set(places) == {r"\top.queue", r"\top.other"}, kind
    everything = mutants(source, 10_000, seed=3)[1]
    assert len({(m.module, m.line_before, m.line_after) for m in everything}) == len(everything)
    assert all(mutant.line_before != mutant.line_after for mutant in everything)


def pairs(seed: int) -> dict[str, np.ndarray]:
    """All pairs of codes in some order, each once, then more with random pauses."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(CODES * CODES)
    more = rng.integers(0, CODES * CODES, 5000)
    both = np.concatenate([order, more])
    enable = np.ones_like(both)
    enable[-4000:] = rng.integers(0, 2, 4000)
    return {"multiply__a": both % CODES, "multiply__b": both // CODES, "multiply__enable": enable}


@pytest.fixture(scope="module")
def parts() -> Beside:
    """Two components beside each other: one build for both."""
    return Beside({"queue": Queue(8, 5), "multiply": Multiply(FORMAT, LATENCY)})


@pytest.fixture(scope="module")
def rows() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (ROWS, 1), np.uint8)


def run(parts: Beside, rows: np.ndarray, **changed) -> list[Trial]:
    options = {
        "constants": pairs(0), "outputs": {"queue__o": rows}, "samples": ["multiply__o"],
        "ports": ["queue__level"], "timing": True, "stall": 0.5, "count": 140, "seed": 1,
    }  # fmt: skip
    return run_mutants(parts, {"queue__i": rows}, **options | changed)


@pytest.fixture(scope="module")
def trials(parts, rows) -> list[Trial]:
    return run(parts, rows)


@pytest.mark.slow
def test_every_fault_of_a_queue_is_caught(trials):
    of_queue = [trial for trial in trials if trial.mutant.module == r"\top.queue"]
    assert len(of_queue) > 25
    assert {kind for kind, _, _ in by_kind(of_queue)} == set(KINDS)
    assert [str(trial.mutant) for trial in of_queue if not trial.caught] == []
    reasons = " ".join(trial.reason for trial in of_queue)
    for reason in ("differs", "nothing moved", "stream queue__o", "cycles instead of"):
        assert reason in reasons, reason


@pytest.mark.slow
def test_faults_of_a_multiplier(trials, parts, rows):
    """All pairs pass: what is not caught is no fault, and all pairs in another order agree."""
    found = [trial for trial in trials if trial.mutant.module != r"\top.queue"]
    missed = {trial.mutant.number for trial in found if not trial.caught}
    assert len(found) > 80 and len(missed) < 0.25 * len(found)
    again = run(parts, rows, constants=pairs(1))
    assert missed == {trial.mutant.number for trial in again if not trial.caught}


@pytest.mark.slow
def test_a_weak_test_misses_more(trials, parts, rows):
    """A queue tried without stalls and a multiplier by zeros."""
    zeros = {name: np.minimum(codes, 1) for name, codes in pairs(0).items()}
    weak = run(parts, rows, constants=zeros, stall=0.0, timing=False)
    assert [trial.mutant for trial in weak] == [trial.mutant for trial in trials]
    caught = [sum(trial.caught for trial in tried) for tried in (weak, trials)]
    assert caught[0] < 0.6 * caught[1]
    for kind, number, everything in by_kind(weak):
        assert number <= everything == sum(trial.mutant.kind == kind for trial in trials)


@pytest.mark.slow
def test_asleep_nothing_changes(parts, rows):
    """With number 0, and with a number that no fault has, the products are the twin's."""
    source = verilog.convert(parts, name="top", emit_src=False)
    text, _ = mutants(source, 140, seed=1)
    simulation = Simulation(parts, ["multiply__o"], text)
    given = pairs(2)
    a, b = (given[f"multiply__{name}"][: CODES * CODES] for name in "ab")
    for number in (0, 1000):
        result = simulation.run(
            {"queue__i": rows}, constants=given, expected={"queue__o": ROWS}, mutant=number
        )
        np.testing.assert_array_equal(result.outputs["queue__o"], rows)
        products = result.samples["multiply__o"][LATENCY:][: len(a)]
        np.testing.assert_array_equal(products, multiply(FORMAT, a, b))


@pytest.mark.slow
def test_wrong_expectations_are_no_catch(parts, rows):
    with pytest.raises(AssertionError, match="the clean component: queue__o: row 7 differs"):
        wrong = rows.copy()
        wrong[7] ^= 1
        run(parts, rows, outputs={"queue__o": wrong})
