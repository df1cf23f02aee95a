"""Bounds to prove on the cycles from START to a frame's outcome, if both halves answer in time; all
proofs of frame control, and planted faults that break them."""

from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal, Value
from amaranth.lib.wiring import In

from splatcore.hdl.frame import Frame
from splatcore.hdl.memory.axi import HALVES
from splatcore.spec.axi import PREPROCESSING, RENDERING
from tb.formal.axi_rules import constant
from tb.formal.frame import QUIET, Controlled, Parameters
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

LIMIT_BITS = 8
"""Bits of `limit`, the cycles within which a half answers: any number of this width."""

TIME_BITS = LIMIT_BITS + 3


class Answering(Controlled):
    """Frame control between halves and a bus that answer within `limit` cycles, a free constant.

    Asserts:
    - a frame has its outcome at most 3 `limit` + 9 cycles after its START, or 2 `limit` + 4 if the
      second half does not fail before it has this frame;
    - a half is free at most `limit` + 6 cycles after its frame ended by an error or ABORT, so READY
      follows ABORT within the same time.

    Assumes, in addition to `Controlled`:
    - a half is done or has an error at most `limit` cycles after the cycle that follows its begin;
    - while a half fails, the bus is busy for at most `limit` cycles and then stays idle.
    """

    def __init__(self):
        super().__init__(limit=In(LIMIT_BITS))
        # Cycles since START, per half's frame; since the hand-over, until the second half is free.
        self.age, self.rendering = [self._time(f"age{k}") for k in HALVES], self._time("rendering")
        self.calm = Signal(len(HALVES))  # the second half has not failed since START

    def _time(self, name: str) -> Signal:
        return Signal(TIME_BITS, name=name)

    def elaborate(self, platform) -> Module:
        m = super().elaborate(platform)
        constant(m, self.limit)
        waited = [self._answers(m, half) for half in HALVES]
        drained = [self._drains(m, half) for half in HALVES]
        self._first(m, waited[PREPROCESSING])
        self._second(m, waited[RENDERING], drained[RENDERING])
        self._reached(m)
        return m

    def _answers(self, m: Module, half: int) -> Signal:
        """Count the cycles in which a half worked on a frame and was neither done nor in error."""
        waited, answers = self._time(f"waited{half}"), (self.inner.done | self.faults)[half]
        waits = (self.alive & self.busy)[half] & ~answers
        with m.If(self.inner.begin[half]):
            m.d.sync += waited.eq(0)
        with m.Elif(waits):
            m.d.sync += waited.eq(waited + 1)
        m.d.comb += Assume(~waits | (waited < self.limit))
        m.d.comb += Assert(~(self.alive & self.busy)[half] | (waited <= self.limit))
        return waited

    def _drains(self, m: Module, half: int) -> Value:
        """Count the cycles for which a half has been failing, without the current one."""
        part, quiet = self.inner, self.inner.quiet[half]
        drained, failed = self._time(f"drained{half}"), self._time(f"failed{half}")
        idle, was_idle = part.idle[half], Signal(name=f"was_idle{half}")
        fails, reset = part.failing[half], part.reset[half]
        m.d.sync += [
            drained.eq(Mux(fails, drained + ~idle, 0)),
            failed.eq(Mux(fails, failed + 1, 0)),
            was_idle.eq(fails & idle & ~reset),
        ]
        since = drained + Mux(reset, QUIET, quiet)
        m.d.comb += [
            Assume(~fails | idle | ((drained < self.limit) & ~was_idle)),
            Assert(~fails | (drained <= self.limit)),
            Assert((quiet == 0) | was_idle),
            Assert(~reset | was_idle),
            Assert(~fails | (failed == since)),
            Assert(~fails | (failed <= self.limit + QUIET)),
        ]
        return since

    def _first(self, m: Module, waited: Signal):
        """A frame is handed over as soon as it is done and the second half is free."""
        part, age, limit = self.inner, self.age[PREPROCESSING], self.limit
        alive, calm = self.alive[PREPROCESSING], self.calm[PREPROCESSING]
        m.d.sync += age.eq(Mux(self.taken, 1, age + alive))
        m.d.sync += calm.eq((calm | self.taken) & ~part.failing[RENDERING])
        through = Signal()
        active = (self.alive & self.busy)[PREPROCESSING]
        m.d.sync += through.eq(active & part.done[PREPROCESSING])
        m.d.comb += [
            Assert(~(alive & part.begin[PREPROCESSING]) | (age == 1)),
            Assert(~active | through | (age == waited + 2)),
            Assert(~(active & through) | part.done[PREPROCESSING]),
            Assert(~alive | self.free | (age <= self.rendering)),
            Assert(~alive | (age <= 2 * limit + 7)),
            Assert(~alive | ~calm | (age <= limit + 2)),
        ]

    def _second(self, m: Module, waited: Signal, since: Value):
        """The second half has a frame from its hand-over to its outcome."""
        part, age, limit, rendering = self.inner, self.age[RENDERING], self.limit, self.rendering
        alive, calm = self.alive[RENDERING], self.calm[RENDERING]
        m.d.sync += rendering.eq(Mux(part.taken, 0, rendering + ~self.free))
        m.d.sync += age.eq(Mux(part.taken, self.age[PREPROCESSING] + 1, age + alive))
        with m.If(part.taken):
            m.d.sync += calm.eq(self.calm[PREPROCESSING])
        active, fails = (self.alive & self.busy)[RENDERING], part.failing[RENDERING]
        m.d.comb += [
            Assert(~part.begin[RENDERING] | (rendering == 0)),
            Assert(~active | (rendering == waited + 1)),
            Assert(~fails | (rendering <= limit + 2 + since)),
            Assert(~alive | (age <= 2 * limit + 8 + rendering)),
            Assert(~alive | ~calm | (age <= limit + 3 + rendering)),
            Assert(~alive | (age <= 3 * limit + 9)),
            Assert(~alive | ~calm | (age <= 2 * limit + 4)),
        ]

    def _reached(self, m: Module):
        """Cover two complete frames, and complete frames in spite of faults and ABORT."""
        part, alive, fault = self.inner, self.alive, self.given_up
        two = Signal()  # two frames have been in flight
        spared, kept, over, both = (Signal(name=f"was_{k}") for k in range(4))
        handing = (alive & part.done & ~self.faults)[PREPROCESSING] & self.free
        m.d.sync += [
            two.eq(two | alive.all()),
            spared.eq(alive[RENDERING] & (spared | (fault[PREPROCESSING] & ~self.completed))),
            kept.eq(kept | (fault[RENDERING] & (alive & ~fault)[PREPROCESSING])),
            over.eq(over | (part.abort & handing)),
            both.eq(both | fault.all()),
        ]
        completed, finished, started = self.completed, part.finished, part.started
        m.d.comb += [
            Cover(two & (finished == 2) & (started == 2)),
            Cover(spared & completed),  # a frame completes, and its successor had an error
            Cover(kept & completed & (started == 2)),  # … or the other way round
            Cover(over & completed),
            Cover(both & completed),
            Cover(completed & part.abort & alive.all()),
            Cover(completed & (self.age[RENDERING] == 3 * self.limit + 9) & (self.limit != 0)),
        ]


COVER_DEPTH = 24  # cycles: a frame waits for the reset of the previous one, and is rendered
FAULT_DEPTH = 18  # cycles within which every planted fault shows

LOOP = "    for name in area_windows(self.config, READING, WRITING)"  # source text of `Frame`

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
            f"    {LOOP}:\n            m.d.sync",
            f"{LOOP}:\n        m.d.comb",
        ),
        "a background with alpha": ('Mux(frame["format"], 0, colour)', "colour"),
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
