"""`sim.rtl.formal`: proofs, searches and covers hold, or fail with the step and the line."""

from collections.abc import Callable

import pytest
from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.sim.rtl.formal import ProofError, cover, prove, search

pytestmark = pytest.mark.slow


class Counter(wiring.Component):
    """Counts from 0 to 5 and stays there; `check` makes a statement about its value."""

    def __init__(self, check: Callable):
        super().__init__({"i": In(1)})
        self.check = check

    def elaborate(self, platform) -> Module:
        m = Module()
        value = Signal(3)
        m.d.sync += value.eq(Mux(value == 5, 5, value + 1))
        m.d.comb += self.check(value)
        return m


def test_step():
    with pytest.raises(ProofError, match="fails in step 0") as found:
        prove(Counter(lambda value: Assert(value != 0)))
    assert found.value.step == 0
    search(Counter(lambda value: Assert(value != 5)), depth=5)
    for check in (prove, search):
        with pytest.raises(ProofError, match=r"fails in step 5: .*test_formal.py:\d+$") as found:
            check(Counter(lambda value: Assert(value != 5)), depth=6)
        assert found.value.step == 5


def test_true_but_not_by_induction():
    """Before 7 comes 6, and before 6 only 5, which stays: induction needs one cycle more."""
    with pytest.raises(ProofError, match="does not follow by induction over 1 cycles") as found:
        prove(Counter(lambda value: Assert(value != 7)), depth=1)
    assert found.value.step is None and len(found.value.lines) == 1
    prove(Counter(lambda value: Assert(value != 7)), depth=2)


def test_cover():
    cover(Counter(lambda value: Cover(value == 5)), depth=6)
    with pytest.raises(ProofError, match=r"not reached in 5 cycles: .*test_formal.py:\d+$"):
        cover(Counter(lambda value: Cover(value == 5)), depth=5)
    with pytest.raises(ProofError, match="not reached"):
        cover(Counter(lambda value: [Assume(value != 3), Cover(value == 5)]), depth=8)


@pytest.mark.parametrize("check", [prove, search, cover])
def test_nothing_to_check(check):
    with pytest.raises(ValueError, match="nothing to check"):
        check(Counter(lambda value: []), depth=1)
