"""Registers and memory words without a value are random in simulation, so early reads show."""

import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.streams import Simulation
from splatcore.sim.rtl.verilator import without_initial

pytestmark = pytest.mark.slow

WORDS, COUNT = 4, 9
CONTENTS = [7, 0, 5, 9]


class Reads(wiring.Component):
    """Reads a register and a memory without a value, and a register and a table with one."""

    at: In(range(WORDS))
    written: In(1)
    kept: Out(64)
    word: Out(64)
    begun: Out(4)
    known: Out(8)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.memory = memory = Memory(shape=64, depth=WORDS, init=[])
        m.submodules.table = table = Memory(shape=8, depth=WORDS, init=CONTENTS)
        port, known = memory.read_port(domain="comb"), table.read_port(domain="comb")
        never, begun = Signal(64, reset_less=True), Signal(4, init=COUNT)
        m.d.comb += memory.write_port().en.eq(self.written)
        m.d.sync += [never.eq(never), begun.eq(begun)]
        m.d.comb += [port.addr.eq(self.at), known.addr.eq(self.at), self.known.eq(known.data)]
        m.d.comb += [self.kept.eq(never), self.word.eq(port.data), self.begun.eq(begun)]
        return m


def samples(seed: int) -> dict[str, np.ndarray]:
    names = ("kept", "word", "begun", "known")
    given = {"at": np.arange(WORDS), "written": 0}
    return Simulation(Reads(), names).run({}, constants=given, seed=seed, cycles_max=WORDS).samples


def test_missing_values_are_random():
    """Values without a reset are random by the seed; reset values and table contents are kept."""
    first, again, other = (samples(seed) for seed in (1, 1, 2))
    for name in ("kept", "word"):
        assert np.array_equal(first[name], again[name])
        assert not (first[name] == other[name]).any()
    assert (other["begun"] == COUNT).all()
    assert other["known"].tolist() == CONTENTS


def test_only_simulations_drop_initial_values():
    source = converted(Reads())
    left = without_initial(source)
    assert "reg [63:0] kept = " in source and "memory[0] = " in source
    assert "reg [63:0] kept ;" in left and "memory[0] = " not in left
    assert "table [2] = 8'h05" in left
