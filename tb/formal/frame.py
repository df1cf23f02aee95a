"""Properties to prove of frame control, between two halves and a bus that are nearly free.

They follow docs/integration.md: a frame is alive from its START until its one outcome: FRAME, an
error bit of its half, or ABORT.
"""

from dataclasses import replace

from amaranth.hdl import Assert, Assume, Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring

from splatcore.hdl.frame import Frame
from splatcore.hdl.lib.record import frame_layout
from splatcore.hdl.memory.axi import HALVES
from splatcore.hdl.memory.window import area_windows
from splatcore.hdl.raster.job import READING, WRITING
from splatcore.spec.axi import BEAT_BITS, PREPROCESSING, READERS, RENDERING, WRITERS
from splatcore.spec.config import TINY, Config
from splatcore.spec.raster import COLOURS
from splatcore.spec.registers import FRAME_BITS, ErrorCode
from tb.formal.axi_rules import Around
from tb.helpers.configs import wide_addresses

QUIET = 4  # consecutive cycles for which a failing half is idle on the bus before it is reset

USED = ("groups", "lists", "features", "work_area", "width", "height", "scratch", "pixels")
USED += ("stride", *(f"background_{name}" for name in COLOURS))
"""Frame registers that frame control reads."""

WIDE = replace(wide_addresses(TINY), rgba=True)
WINDOWS = area_windows(WIDE, READING, WRITING)
"""Areas of the second half that have an address window."""


class Controlled(Around):
    """Frame control, and for each half whether its frame is alive.

    Asserts: see the methods.

    Assumes: a half is done only if it has been begun, and has not been done or reset since; the
    first half stays done until its work area is taken or it is reset. START, ABORT, errors of
    either half, stray responses, an idle bus and reset may come in any cycle.

    Members
        part: the ports of `Frame`
        alive: one bit per half: its frame has had no outcome yet
        busy: one bit per half: it has been begun
        faults: one bit per half: it has an error in this cycle
        taken: START is taken
        free: the second half is neither working nor failing
        completed: outcome FRAME
        given_up, aborted: one bit per half: outcome by an error, by ABORT
    """

    def __init__(self, config: Config = TINY, **ports: wiring.Member):
        super().__init__(Frame(config), **ports)
        count = len(HALVES)
        self.alive, self.busy, self.faults = Signal(count), Signal(count), Signal(count)
        self.given_up, self.aborted = Signal(count), Signal(count)
        self.taken, self.free, self.completed = Signal(), Signal(), Signal()

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        self._faults(m)
        m.d.comb += self.taken.eq(part.start & part.ready)
        m.d.comb += self.free.eq(~part.working[RENDERING] & ~part.failing[RENDERING])
        self._halves(m)
        self._outcomes(m)
        self._lives(m)
        self._reports(m)
        self._recovers(m)
        return m

    def _of(self, error: Value, clients: dict[str, int], half: int) -> Value:
        """Return whether an error of the bus belongs to a client of the half."""
        mine = [error.client == k for k, of in enumerate(clients.values()) if of == half]
        return error.valid & Cat(mine).any()

    def _faults(self, m: Module):
        part = self.inner
        for half in HALVES:
            read = self._of(part.read_error, READERS, half)
            write = self._of(part.write_error, WRITERS, half)
            own = part.fails.valid if half == PREPROCESSING else 0
            m.d.comb += self.faults[half].eq(read | write | own)

    def _halves(self, m: Module):
        """A half is begun only while it is not busy, in the cycle after START or the hand-over."""
        part, busy = self.inner, self.busy
        ends = Cat(part.taken, part.done[RENDERING]) | part.reset
        m.d.sync += busy.eq((busy | part.begin) & ~ends)
        kept = Signal()
        m.d.sync += kept.eq(part.done[PREPROCESSING] & ~ends[PREPROCESSING])
        m.d.comb += Assume((part.done & ~busy) == 0)
        m.d.comb += Assume(~kept | part.done[PREPROCESSING])
        asked = Signal(len(HALVES))
        m.d.sync += asked.eq(Cat(self.taken, part.taken))
        m.d.comb += [
            Assert(part.begin == asked),
            Assert((part.begin & busy) == 0),
            # Why: the state of each half.
            Assert(busy[PREPROCESSING] == (part.working & ~part.begin)[PREPROCESSING]),
            Assert(~busy[RENDERING] | ~self.free),
            Assert((self.alive & ~part.begin & ~busy) == 0),
            Assert((part.begin & ~self.alive) == 0),
        ]

    def _outcomes(self, m: Module):
        """Every START taken has one outcome: a frame begun is alive or has had its outcome.

        `STARTED` counts the frames begun, `FINISHED` each FRAME.
        """
        part, alive = self.inner, self.alive
        others = self.given_up | Cat(0, self.completed)
        m.d.comb += [
            self.completed.eq(part.frame_event),
            self.given_up.eq(part.gives_up),
            self.aborted.eq(Mux(part.abort, alive & ~others, 0)),
            Assert((others & ~alive) == 0),
            Assert(~self.completed | ~self.given_up[RENDERING]),
            Assert(~part.taken | (~others & ~self.aborted & alive)[PREPROCESSING]),
        ]
        outcomes = others | self.aborted
        goes, comes = outcomes | Cat(part.taken, 0), Cat(self.taken, part.taken)
        m.d.sync += alive.eq((alive & ~goes) | comes)
        lost = Signal(FRAME_BITS)  # frames ended by an error or ABORT
        gone = self.given_up | self.aborted
        m.d.sync += lost.eq(lost + gone[0] + gone[1])
        inside = alive[0] + alive[1]
        m.d.comb += Assert(part.started == (part.finished + lost + inside)[:FRAME_BITS])

    def _lives(self, m: Module):
        """Each outcome has its cause in its own half, and each cause its outcome in the same cycle.

        So an error of one half does not touch the other's frame. A frame done in the cycle of ABORT
        counts as complete; a frame done in the cycle of an error of its half ends by the error.
        """
        part, alive, faults = self.inner, self.alive, self.faults
        through = alive & part.done & ~faults
        m.d.comb += [
            Assert(alive == (part.working & ~part.failing)),
            Assert(self.given_up == (alive & faults)),
            Assert(self.completed == through[RENDERING]),
            Assert(part.taken == (through[PREPROCESSING] & ~part.abort & self.free)),
            Assert(part.ready == ~part.working[PREPROCESSING]),
            Assert(~(part.failing & ~part.working)[PREPROCESSING]),
        ]
        before = Signal(init=1)
        m.d.sync += before.eq(part.ready)
        m.d.comb += Assert(part.ready_event == (part.ready & ~before))

    def _reports(self, m: Module):
        """An error is reported once, unless its half is failing; of several in a cycle, one is."""
        part, faults = self.inner, self.faults
        new = {}
        for name, clients in (("read_error", READERS), ("write_error", WRITERS)):
            error = getattr(part, name)
            mine = [self._of(error, clients, half) & ~part.failing[half] for half in HALVES]
            new[name] = Cat(mine).any()
        own = part.fails.valid & ~part.failing[PREPROCESSING]
        stray = part.stray.valid
        m.d.comb += Assert(part.error.valid == (Cat(new.values()).any() | own | stray))
        is_code = {code: part.error.code == code for code in ErrorCode}
        bus = is_code[ErrorCode.READ] | is_code[ErrorCode.WRITE]
        with m.If(own):
            m.d.comb += Assert(Value.cast(part.error) == Value.cast(part.fails))
        with m.Elif(Cat(new.values()).any()):
            m.d.comb += Assert(bus)
            for name, code in (("read_error", ErrorCode.READ), ("write_error", ErrorCode.WRITE)):
                detail = part.error.detail == getattr(part, name).client
                m.d.comb += Assert(~is_code[code] | (new[name] & detail))
        with m.Elif(stray):
            m.d.comb += Assert(is_code[ErrorCode.STRAY])
        m.d.comb += Assert(part.error.valid | ((self.alive & faults) == 0))

    def _recovers(self, m: Module):
        """A half is reset only if it fails and has been idle on the bus for `QUIET` cycles.

        It starts to fail only if its frame ended by an error, or was alive in the cycle of ABORT.
        """
        part = self.inner
        fails = Signal(len(HALVES))
        m.d.sync += fails.eq(self.given_up | self.aborted | (self.alive & part.abort.replicate(2)))
        for half in HALVES:
            rested = Signal(range(QUIET + 1), name=f"rested{half}")
            before, reset = Signal(name=f"failed{half}"), part.reset[half]
            rests = (part.failing & part.idle & ~part.reset)[half]
            m.d.sync += rested.eq(Mux(rests, rested + 1, 0))
            m.d.sync += before.eq(part.failing[half] & ~reset)
            m.d.comb += [
                Assert(~reset | (part.failing[half] & (rested == QUIET))),
                Assert(part.failing[half] == (before | fails[half])),
                # Why: frame control's counter of idle cycles.
                Assert(reset | (self.inner.quiet[half] == rested)),
                Assert(~reset | (self.inner.quiet[half] == 0)),
            ]


class Parameters(Controlled):
    """Frame control of a machine with 64-bit addresses and alpha, and the frame registers of each
    half.

    Asserts:
    - frames handed over use the work areas in turn, so two frames in flight never share one;
    - until it is free, each half sees the register values from the START of its frame, and no
      background if its pixels have alpha.

    Assumes: these registers stay constant from START until READY returns.
    """

    def __init__(self):
        super().__init__(WIDE)

    def elaborate(self, platform) -> Module:
        m = super().elaborate(platform)
        part, frame = self.inner, self.inner.frame
        used = (*USED, "format", *(f"{name}_high" for name in WINDOWS))
        layout = frame_layout(WIDE)
        first, second = (
            {name: Signal(layout[name].width, name=f"{half}_{name}") for name in used}
            for half in ("first", "second")
        )
        turn, others = Signal(), Signal()  # work area of the first half's frame, the second's
        for name in used:
            stays = Signal(name=f"stays_{name}")
            locked = part.working[PREPROCESSING] & ~part.taken
            m.d.sync += stays.eq(self.taken | locked)
            before = Signal.like(first[name], name=f"before_{name}")
            m.d.sync += before.eq(frame[name])
            m.d.comb += Assume(~stays | (frame[name] == before))
            m.d.comb += Assert(part.ready | (frame[name] == first[name]))  # why
            with m.If(self.taken):
                m.d.sync += first[name].eq(frame[name])
            with m.If(part.taken):
                m.d.sync += second[name].eq(first[name])
        with m.If(part.taken):
            m.d.sync += [turn.eq(~turn), others.eq(turn)]
        job, both = part.job, part.working[PREPROCESSING] & ~self.free
        apart = (first["work_area"] != 0) & (first["work_area"][:BEAT_BITS] == 0)
        m.d.comb += Assert(part.second == turn)
        m.d.comb += Assert(self.free | (others != turn))
        for name in ("groups", "lists", "features"):
            at = (first[name] + Mux(turn, first["work_area"], 0))[: len(first[name])]
            own = (second[name] + Mux(others, second["work_area"], 0))[: len(first[name])]
            same = (first[name] == second[name]) & (first["work_area"] == second["work_area"])
            m.d.comb += [
                Assert(part.ready | (part.area[name] == at[BEAT_BITS:])),
                Assert(self.free | (job.area[name] == own[BEAT_BITS:])),
                Assert(~both | ~same | ~apart | (part.area[name] != job.area[name])),
            ]
        for name in ("width", "height"):
            m.d.comb += Assert(self.free | (job[name] == second[name]))
        for name in ("scratch", "pixels", "stride"):
            m.d.comb += Assert(self.free | (job[name] == second[name][BEAT_BITS:]))
        for name in WINDOWS:
            m.d.comb += Assert(self.free | (job.windows[name] == second[f"{name}_high"]))
        m.d.comb += Assert(self.free | (job.rgba == second["format"]))
        for name in COLOURS:
            colour = Mux(second["format"], 0, second[f"background_{name}"])
            m.d.comb += Assert(self.free | (job.background[name] == colour))
        return m
