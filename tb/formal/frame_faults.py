"""The proofs of frame control, and planted faults that break them."""

from splatcore.hdl.frame import Frame
from tb.formal.frame import Controlled, Parameters
from tb.formal.frame_times import Answering
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

COVER_DEPTH = 24  # cycles: a frame waits for the reset of the previous one, and is rendered
FAULT_DEPTH = 18  # cycles within which every planted fault shows

WINDOWS = "    for name in area_windows(self.config, READING, WRITING)"  # source text of `Frame`

OF_HALVES = planted_in(
    Frame,
    elaborate={
        "handed over to a busy half": ("& ~self.working[RENDERING]", "& 1"),
        "handed over to a half that fails": ("& ~self.failing.any()", "& 1"),
        "handed over with an error": ("(faults[PREPROCESSING] | self.abort)", "self.abort"),
        "handed over with ABORT": ("(faults[PREPROCESSING] | self.abort)", "faults[PREPROCESSING]"),
        "FRAME in the cycle of an error": ("& ~faults[RENDERING]", "& 1"),
        "FRAME of a failed frame": (
            "self.done[RENDERING] & ~self.failing[RENDERING]",
            "self.done[RENDERING]",
        ),
        "a frame fails twice": ("self.working[half] & ~self.failing[half]", "self.working[half]"),
        "START when not READY": ("(self.start & self.ready,", "(self.start,"),
        "an error takes the other half's frame": (
            "ends[half], faults[half] |",
            "ends[half], Cat(faults).any() |",
        ),
        "ABORT leaves the second half": (
            "faults[half] | self.abort)",
            "faults[half] | (self.abort & (half == PREPROCESSING)))",
        ),
        "READY while the half fails": (
            "(~self.working[PREPROCESSING])",
            "((~self.working | self.failing)[PREPROCESSING])",
        ),
    },
    _half={
        "reset with a burst in flight": ("quiet.all() & self.idle[half]", "quiet.all()"),
        "busy after a reset": ("failing.eq(0), working.eq(0)", "failing.eq(0)"),
    },
    _errors={
        "errors of the other half's clients": ("if of == half", "if of != half"),
        "reported again while failing": ("mine[half] & ~self.failing[half]", "mine[half]"),
    },
)

OF_AREAS = planted_in(
    Frame,
    _areas={
        "one work area for both": ("second.eq(~second)", "second.eq(0)"),
        "the next frame's registers": ("m.If(self.handing)", "m.If(self.begin[PREPROCESSING])"),
        "the next frame's windows": (
            f"    {WINDOWS}:\n            m.d.sync",
            f"{WINDOWS}:\n        m.d.comb",
        ),
        "another area's window": ('frame[f"{name}_high"]', 'frame["lists_high"]'),
    },
)

OF_TIMES = planted_in(
    Frame,
    _half={
        "never reset": ("reset.eq(1)", "reset.eq(0)"),
        "a reset waits for the other half's bus": (
            "Mux(self.idle[half], quiet + 1, 0)",
            "Mux(self.idle.all(), quiet + 1, 0)",
        ),
    },
)

FAULTY = {Controlled: OF_HALVES, Parameters: OF_AREAS, Answering: OF_TIMES}

PROOF = Proof(
    {
        proof.__name__: Part(proof, cover=COVER_DEPTH if proof is Answering else None)
        for proof in FAULTY
    },
    OF_HALVES | OF_AREAS | OF_TIMES,
    {name: Part(proof, search=FAULT_DEPTH) for proof, faults in FAULTY.items() for name in faults},
)
