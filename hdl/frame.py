"""Frame control: starts both halves on successive frames, and recovers from errors."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import AREA, ERROR, frame_layout
from splatcore.hdl.memory.axi import CLIENT_ERROR, HALVES, STRAY
from splatcore.hdl.memory.window import area_windows
from splatcore.hdl.raster.job import READING, WRITING, job_layout
from splatcore.spec.axi import BEAT_BITS, PREPROCESSING, READERS, RENDERING, WRITERS
from splatcore.spec.config import Config
from splatcore.spec.raster import COLOURS
from splatcore.spec.registers import FRAME_BITS, ErrorCode


class Frame(wiring.Component):
    """Starts the halves, passes each frame from the first half to the second, and recovers from
    errors.

    A half that fails begins nothing more on the bus. When all its transfers have ended, it is
    reset, its frame is dropped, and it is idle again. The other half continues. If rendering ends
    in the same cycle as an error of its half, the frame is aborted; in the same cycle as ABORT, it
    counts as complete.

    **Timing**: two cycles from the end of one half to the start of the other.
    """

    def __init__(self, config: Config):
        self.config = config
        halves = len(HALVES)
        ports = {
            "frame": In(frame_layout(config)),  # the host's frame registers
            "start": In(1),  # the host's commands
            "abort": In(1),  # the host's commands
            "ready": Out(1),  # bit READY of STATUS: START is accepted
            "working": Out(halves),  # one bit per half: the half is busy (bits of STATUS)
            "ready_event": Out(1),  # `ready` has risen
            "frame_event": Out(1),  # a frame is complete
            "error": Out(ERROR),  # an error of a frame or of the bus, at most one per cycle
            # one bit per half: an error aborts its frame in this cycle, reported or not
            "gives_up": Out(halves),
            "started": Out(FRAME_BITS),  # number of frames started
            "finished": Out(FRAME_BITS),  # number of frames finished
            "begin": Out(halves),  # one bit per half: the half starts
            "done": In(halves),  # one bit per half: the half has finished its frame
            "taken": Out(1),  # the first half's work area has been handed over
            "fails": In(ERROR),  # an error of the first half
            "area": Out(AREA),  # work area of the first half, in beats
            "job": Out(job_layout(config)),  # parameters of the second half
            "read_error": In(CLIENT_ERROR),  # from the bus
            "write_error": In(CLIENT_ERROR),  # from the bus
            "stray": In(STRAY),  # from the bus; fails no half
            "idle": In(halves),  # one bit per half: it has nothing in flight on the bus
            "failing": Out(halves),  # one bit per half: it may begin nothing more
            "reset": Out(halves),  # one bit per half: resets it
        }
        super().__init__(ports)
        self.handing = Signal()
        self.second = Signal()  # the frame of the first half uses work area 1
        self.quiet = [Signal(2, name=f"quiet{half}") for half in HALVES]  # cycles with an idle bus

    def elaborate(self, platform) -> Module:
        m = Module()
        faults = self._errors(m)
        m.d.comb += [
            self.handing.eq(
                self.done[PREPROCESSING]
                & self.working[PREPROCESSING]
                & ~self.working[RENDERING]
                & ~self.failing.any()
                & ~(faults[PREPROCESSING] | self.abort)  # in this very cycle: it is aborted here
            ),
            self.ready.eq(~self.working[PREPROCESSING]),
        ]
        begins = (self.start & self.ready, self.handing)
        through = self.done[RENDERING] & ~self.failing[RENDERING] & ~faults[RENDERING]
        ends = (self.handing, through)
        for half in HALVES:
            given_up = faults[half] & self.working[half] & ~self.failing[half]
            m.d.comb += self.gives_up[half].eq(given_up)
            self._half(m, half, begins[half], ends[half], faults[half] | self.abort)
        self._areas(m)
        was_ready = Signal(init=1)
        m.d.sync += was_ready.eq(self.ready)
        m.d.comb += [self.taken.eq(self.handing), self.ready_event.eq(self.ready & ~was_ready)]
        m.d.comb += self.frame_event.eq(ends[RENDERING] & self.working[RENDERING])
        with m.If(begins[PREPROCESSING]):
            m.d.sync += self.started.eq(self.started + 1)
        with m.If(self.frame_event):
            m.d.sync += self.finished.eq(self.finished + 1)
        return m

    def _half(self, m: Module, half: int, begins: Value, ends: Value, fault: Value):
        """One half: idle, busy, or failing until the bus is quiet, when it is reset."""
        working, failing, reset = (
            getattr(self, name)[half] for name in ("working", "failing", "reset")
        )
        quiet = self.quiet[half]
        m.d.sync += [self.begin[half].eq(begins & ~failing), reset.eq(0)]
        with m.If(begins & ~failing):
            m.d.sync += working.eq(1)
        with m.Elif(ends):
            m.d.sync += working.eq(0)
        with m.If(failing):
            m.d.sync += quiet.eq(Mux(self.idle[half], quiet + 1, 0))
            with m.If(reset):  # until then the half's offers are not taken
                m.d.sync += [failing.eq(0), working.eq(0), quiet.eq(0)]
            with m.Elif(quiet.all() & self.idle[half]):
                m.d.sync += reset.eq(1)
        with m.Elif(fault & working):
            m.d.sync += failing.eq(1)

    def _errors(self, m: Module) -> list[Value]:
        """Report one error; return one fault bit per half."""
        faults = [self.fails.valid, Const(0, 1)]
        with m.If(self.stray.valid):
            m.d.comb += [self.error.valid.eq(1), self.error.code.eq(ErrorCode.STRAY)]
            m.d.comb += self.error.detail.eq(Cat(self.stray.client, self.stray.written))
        for error, clients, code in (
            (self.read_error, READERS, ErrorCode.READ),
            (self.write_error, WRITERS, ErrorCode.WRITE),
        ):
            mine = [
                Cat(error.client == k for k, of in enumerate(clients.values()) if of == half).any()
                for half in HALVES
            ]
            reported = Cat(mine[half] & ~self.failing[half] for half in HALVES).any()
            for half in HALVES:
                faults[half] = faults[half] | (error.valid & mine[half])
            with m.If(error.valid & reported):
                m.d.comb += [self.error.valid.eq(1), self.error.code.eq(code)]
                m.d.comb += self.error.detail.eq(error.client)
        with m.If(self.fails.valid & ~self.failing[PREPROCESSING]):
            m.d.comb += self.error.eq(self.fails)
        return faults

    def _areas(self, m: Module):
        """Frames use the work areas in turn; the second half's parameters are held for a frame."""
        frame, area, job, second = self.frame, self.area, self.job, self.second
        for part in ("groups", "lists", "features"):
            behind = Mux(second, frame.work_area, 0)
            m.d.sync += area[part].eq((frame[part] + behind) >> BEAT_BITS)
        with m.If(self.handing):
            m.d.sync += [second.eq(~second), job.area.eq(area)]
            for name in ("width", "height"):
                m.d.sync += job[name].eq(frame[name])
            for name in ("scratch", "pixels", "stride"):
                m.d.sync += job[name].eq(frame[name] >> BEAT_BITS)
            for name in COLOURS:
                colour = frame[f"background_{name}"]
                if self.config.rgba:
                    colour = Mux(frame["format"], 0, colour)
                m.d.sync += job.background[name].eq(colour)
            if self.config.rgba:
                m.d.sync += job.rgba.eq(frame["format"])
            for name in area_windows(self.config, READING, WRITING):
                m.d.sync += job.windows[name].eq(frame[f"{name}_high"])
