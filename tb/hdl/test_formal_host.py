"""Proof of registers and frame control together: commands, ERROR, INTERRUPT, locked registers."""

import pytest

from splatcore.hdl.frame import Frame
from splatcore.hdl.registers import Registers
from splatcore.hdl.top import Top
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.host import Driven
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

DEPTH = 16  # cycles within which the host's writes can start two frames that end


def test_commands_are_proved():
    prove(Driven())
    cover(Driven(), DEPTH)


FAULTS = {
    "START when not READY": (Registers, "_commands", "eq(start & ready)", "eq(start)"),
    "START with ABORT": (Registers, "_commands", "registers.START).any() & ~abort", "1).any()"),
    "a refused START is not reported": (Registers, "_commands", "start & ~ready", "start & ready"),
    "READY is not seen": (Registers, "_commands", "registers.READY", "registers.RENDERING"),
    "not the first error": (Registers, "_errors", "m.If(clears | (", "m.If(1 | ("),
    "an event is lost while cleared": (
        Registers, "_errors", "event | (self.events[k] & ~cleared[k])",
        "(event | self.events[k]) & ~cleared[k]",
    ),
    "a half is lost while cleared": (
        Registers, "_errors", "Mux(clears, 0, self.given_up) | self.gives_up",
        "Mux(clears, 0, self.given_up | self.gives_up)",
    ),
    "a refused START is no interrupt": (Registers, "_errors", "| start_refused", ""),
    "written while points are made": (
        Registers, "_take", "& ~(of_frame & self.locked)", ""
    ),
    "locked by the other half": (
        Top, "_host", "frame.working[PREPROCESSING]", "frame.working[1 - PREPROCESSING]"
    ),
    "FRAME by READY": (Top, "_host", "eq(frame.frame_event)", "eq(frame.ready_event)"),
    "a half by its reset": (Top, "_host", "eq(frame.gives_up)", "eq(frame.reset)"),
    "handed over with ABORT": (
        Frame, "elaborate", "(faults[PREPROCESSING] | self.abort)", "faults[PREPROCESSING]"
    ),
    "not counted": (Frame, "elaborate", "self.started + 1", "self.started"),
}  # fmt: skip


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Driven(), DEPTH)
