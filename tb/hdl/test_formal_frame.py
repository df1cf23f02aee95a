"""Proofs of frame control: one outcome per START, independent halves, work areas, time bounds."""

import pytest

from splatcore.hdl.frame import Frame
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.frame import Controlled, Parameters
from tb.formal.frame_times import Answering
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 24  # cycles: a frame waits for the reset of the previous one, and is rendered
FAULT_DEPTH = 18  # cycles within which every planted fault shows


@pytest.mark.parametrize("proof", [Controlled, Parameters, Answering])
def test_frame_control_is_proved(proof):
    prove(proof())


def test_frames_come_to_their_ends():
    cover(Answering(), COVER_DEPTH)


WINDOWS = "    for name in area_windows(self.config, READING, WRITING)"  # source text of `Frame`

FAULTS = {
    "handed over to a busy half": (
        Controlled, "elaborate", "& ~self.working[RENDERING]", "& 1"
    ),
    "handed over to a half that fails": (
        Controlled, "elaborate", "& ~self.failing.any()", "& 1"
    ),
    "handed over with an error": (
        Controlled, "elaborate", "(faults[PREPROCESSING] | self.abort)", "self.abort"
    ),
    "handed over with ABORT": (
        Controlled, "elaborate", "(faults[PREPROCESSING] | self.abort)", "faults[PREPROCESSING]"
    ),
    "FRAME in the cycle of an error": (
        Controlled, "elaborate", "& ~faults[RENDERING]", "& 1"
    ),
    "FRAME of a failed frame": (
        Controlled, "elaborate", "self.done[RENDERING] & ~self.failing[RENDERING]",
        "self.done[RENDERING]",
    ),
    "a frame fails twice": (
        Controlled, "elaborate", "self.working[half] & ~self.failing[half]", "self.working[half]"
    ),
    "START when not READY": (
        Controlled, "elaborate", "(self.start & self.ready,", "(self.start,"
    ),
    "an error takes the other half's frame": (
        Controlled, "elaborate", "ends[half], faults[half] |", "ends[half], Cat(faults).any() |"
    ),
    "ABORT leaves the second half": (
        Controlled, "elaborate", "faults[half] | self.abort)",
        "faults[half] | (self.abort & (half == PREPROCESSING)))",
    ),
    "READY while the half fails": (
        Controlled, "elaborate", "(~self.working[PREPROCESSING])",
        "((~self.working | self.failing)[PREPROCESSING])",
    ),
    "reset with a burst in flight": (
        Controlled, "_half", "quiet.all() & self.idle[half]", "quiet.all()"
    ),
    "busy after a reset": (
        Controlled, "_half", "failing.eq(0), working.eq(0)", "failing.eq(0)"
    ),
    "errors of the other half's clients": (
        Controlled, "_errors", "if of == half", "if of != half"
    ),
    "reported again while failing": (
        Controlled, "_errors", "mine[half] & ~self.failing[half]", "mine[half]"
    ),
    "one work area for both": (
        Parameters, "_areas", "second.eq(~second)", "second.eq(0)"
    ),
    "the next frame's registers": (
        Parameters, "_areas", "m.If(self.handing)", "m.If(self.begin[PREPROCESSING])"
    ),
    "the next frame's windows": (
        Parameters, "_areas",
        f"    {WINDOWS}:\n            m.d.sync", f"{WINDOWS}:\n        m.d.comb",
    ),
    "another area's window": (
        Parameters, "_areas", 'frame[f"{name}_high"]', 'frame["lists_high"]'
    ),
    "never reset": (
        Answering, "_half", "reset.eq(1)", "reset.eq(0)"
    ),
    "a reset waits for the other half's bus": (
        Answering, "_half", "Mux(self.idle[half], quiet + 1, 0)",
        "Mux(self.idle.all(), quiet + 1, 0)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    proof, *change = FAULTS[fault]
    plant(monkeypatch, Frame, *change)
    with pytest.raises(ProofError, match="fails in step"):
        search(proof(), FAULT_DEPTH)
