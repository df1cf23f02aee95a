"""Proof of the AXI4-Lite slave; each planted fault breaks it."""

import pytest

from splatcore.hdl.registers import Registers
from splatcore.sim.rtl.formal import ProofError, cover, prove
from splatcore.spec.config import TINY
from tb.formal.axi_lite import Answers
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow


def test_slave_is_proved():
    prove(Answers(Registers(TINY)))
    cover(Answers(Registers(TINY)), depth=8)


FAULTS = {
    "an answer is overwritten": ("_take", "addressed & given & ~s_axi.bvalid", "addressed & given"),
    "an answer is withdrawn": ("_take", "m.Elif(s_axi.bready)", "m.Else()"),
    "an answer to an address alone": ("_take", "addressed & given & ~s", "addressed & ~s"),
    "data waits for its address": ("_take", "wready.eq(~given)", "wready.eq(~given & addressed)"),
    "a second address is lost": ("_take", "awready.eq(~addressed)", "awready.eq(1)"),
    "strobes are not looked at": ("_take", "& self.whole & writable", "& writable"),
    "a read is answered twice": ("_read", "[asked.eq(0), s_axi.rvalid", "[s_axi.rvalid"),
    "data of an answer change": ("_read", "m.If(asked & ~s_axi.rvalid)", "m.If(asked)"),
}


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, Registers, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        prove(Answers(Registers(TINY)))
