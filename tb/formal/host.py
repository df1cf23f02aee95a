"""Properties to prove of the registers and frame control together, as the host sees them."""

from types import SimpleNamespace

from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.frame import Frame
from splatcore.hdl.lib.record import ERROR
from splatcore.hdl.memory.axi import CLIENT_ERROR, HALVES, STRAY
from splatcore.hdl.memory.bus import axi_lite
from splatcore.hdl.registers import Registers
from splatcore.hdl.top import Top
from splatcore.spec import registers as spec
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.config import TINY
from splatcore.spec.registers import CODE_BITS, ErrorCode
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in


class Driven(wiring.Component):
    """The registers and frame control, connected by `Top`; the rest of the machine is free.

    Asserts: see the methods.

    Assumes: an error has a code. The host, both halves, the bus and reset are free in every cycle.
    """

    def __init__(self):
        count = len(HALVES)
        ports = {"s_axi": In(axi_lite()), "interrupt": Out(1)}
        ports |= {"done": In(count), "fails": In(ERROR), "idle": In(count), "stray": In(STRAY)}
        super().__init__(ports | dict.fromkeys(("read_error", "write_error"), In(CLIENT_ERROR)))
        errors = {name: getattr(self, name) for name in ("read_error", "write_error", "stray")}
        half = SimpleNamespace(needed=Signal(PAGE_BITS), counted=Signal())
        half.counters = Signal(data.StructLayout({}))
        self.top = SimpleNamespace(
            registers=Registers(TINY),
            frame=Frame(TINY),
            interrupt=self.interrupt,
            axi=SimpleNamespace(idle=self.idle, failing=Signal(count), **errors),
            preprocess=half,
            render=half,
        )
        self.past = 0  # number of delayed signals made

    def elaborate(self, platform) -> Module:
        m = Module()
        top, frame = self.top, self.top.frame
        m.submodules.registers, m.submodules.frame = top.registers, frame
        Top._host(top, m)
        wiring.connect(m, wiring.flipped(self).s_axi, top.registers.s_axi)
        m.d.comb += [frame.done.eq(self.done), frame.fails.eq(self.fails)]
        start, abort = self._written(m)
        self._commands(m, start, abort)
        self._interrupts(m, start & ~frame.ready)
        self._errors(m, start & ~frame.ready)
        self._locked(m)
        return m

    def _before(self, m: Module, value: Value) -> Signal:
        """Return the value one cycle ago, 0 at first."""
        self.past += 1
        value = Value.cast(value)
        before = Signal(len(value), name=f"before{self.past}")
        m.d.sync += before.eq(value)
        return before

    def _at(self, name: str) -> Value:
        registers = self.top.registers
        return registers.taken & (registers.word == registers.address[name] // spec.WORD)

    def _written(self, m: Module) -> tuple[Signal, Signal]:
        """Return whether START without ABORT, and ABORT, are written in this cycle."""
        start, abort, value = Signal(), Signal(), self.top.registers.value
        m.d.comb += [
            abort.eq(self._at("CONTROL") & (value & spec.ABORT).any()),
            start.eq(self._at("CONTROL") & (value & spec.START).any() & ~abort),
        ]
        return start, abort

    def _commands(self, m: Module, start: Signal, abort: Signal):
        """START while READY begins a frame, otherwise none; ABORT ends all frames in flight.

        After ABORT, no FRAME comes until the next START; a FRAME in the cycle of ABORT is visible
        when the write is answered. STARTED counts each START that begins a frame.
        """
        frame, registers = self.top.frame, self.top.registers
        over, alive = Signal(), frame.working & ~frame.failing
        m.d.sync += over.eq((over | abort) & ~frame.start)
        begun, started = self._before(m, start & frame.ready), self._before(m, frame.started)
        known = Signal()
        m.d.sync += known.eq(1)
        completed = self._before(m, abort & frame.frame_event)
        m.d.comb += [
            Assert(frame.start == (start & frame.ready)),
            Assert(frame.abort == abort),
            Assert(~known | (frame.started == (started + begun)[: len(started)])),
            Assert(frame.begin[0] == begun),
            Assert(~(frame.failing & ~frame.working)[0]),
            Assert(~over | ((alive == 0) & ~frame.frame_event)),
            Assert(~completed | (registers.s_axi.bvalid & registers.events[1])),
            Cover(completed & over),
            Cover(over & frame.ready & start & registers.events[0] & (frame.started == 2)),
        ]

    def _interrupts(self, m: Module, refused: Value):
        """A bit of INTERRUPT is set by its event, and stays set until it is cleared."""
        frame, registers = self.top.frame, self.top.registers
        sources = (frame.ready_event, frame.frame_event, frame.error.valid | refused)
        clears = self._before(m, self._at("INTERRUPT"))
        value, events = self._before(m, registers.value), self._before(m, registers.events)
        for k, event in enumerate(sources):
            stays = events[k] & ~(clears & value[k])
            m.d.comb += Assert(registers.events[k] | ~(self._before(m, event) | stays))
        for k in range(2):
            m.d.comb += Assert(~registers.events[k] | events[k] | self._before(m, sources[k]))
        m.d.comb += Assert(self.interrupt == (registers.events & registers.enabled).any())

    def _errors(self, m: Module, refused: Value):
        """ERROR holds the first error until it is written, and one bit per half that had one."""
        frame, registers = self.top.frame, self.top.registers
        first, halves = self._before(m, registers.first_error), self._before(m, registers.given_up)
        clears, gave_up = self._before(m, self._at("ERROR")), self._before(m, frame.gives_up)
        code, none = registers.first_error.code, registers.first_error.code == ErrorCode.NONE
        kept = (first[:CODE_BITS] != ErrorCode.NONE) & ~clears
        error, valid = self._before(m, frame.error), self._before(m, frame.error.valid)
        m.d.comb += [
            Assume(~self.fails.valid | (self.fails.code != ErrorCode.NONE)),
            Assert(registers.given_up == (Mux(clears, 0, halves) | gave_up)),
            Assert(~kept | (Value.cast(registers.first_error) == first)),
            Assert(kept | ~valid | (Value.cast(registers.first_error) == error[1:])),
            Assert(kept | valid | ~self._before(m, refused) | (code == ErrorCode.START)),
            Assert(~none | (gave_up == 0)),
        ]

    def _locked(self, m: Module):
        """A frame's registers are constant from START until READY: writes to them are refused."""
        frame, registers = self.top.frame, self.top.registers
        before = self._before(m, registers.frame)
        stays = self._before(m, frame.start | ~frame.ready)
        m.d.comb += Assert(~stays | (Value.cast(registers.frame) == before))


DEPTH = 16  # cycles within which the host's writes can start two frames that end

FAULTS = (
    planted_in(
        Registers,
        _commands={
            "START when not READY": ("eq(start & ready)", "eq(start)"),
            "START with ABORT": ("registers.START).any() & ~abort", "1).any()"),
            "a refused START is not reported": ("start & ~ready", "start & ready"),
            "READY is not seen": ("registers.READY", "registers.RENDERING"),
        },
        _errors={
            "not the first error": ("m.If(clears | (", "m.If(1 | ("),
            "an event is lost while cleared": (
                "event | (self.events[k] & ~cleared[k])",
                "(event | self.events[k]) & ~cleared[k]",
            ),
            "a half is lost while cleared": (
                "Mux(clears, 0, self.given_up) | self.gives_up",
                "Mux(clears, 0, self.given_up | self.gives_up)",
            ),
            "a refused START is no interrupt": ("| start_refused", ""),
        },
        _take={"written while points are made": ("& ~(of_frame & self.locked)", "")},
    )
    | planted_in(
        Top,
        _host={
            "locked by the other half": (
                "frame.working[PREPROCESSING]",
                "frame.working[1 - PREPROCESSING]",
            ),
            "FRAME by READY": ("eq(frame.frame_event)", "eq(frame.ready_event)"),
            "a half by its reset": ("eq(frame.gives_up)", "eq(frame.reset)"),
        },
    )
    | planted_in(
        Frame,
        elaborate={
            "handed over with ABORT": (
                "(faults[PREPROCESSING] | self.abort)",
                "faults[PREPROCESSING]",
            ),
            "not counted": ("self.started + 1", "self.started"),
        },
    )
)

PROOF = Proof({"commands": Part(Driven, cover=DEPTH)}, FAULTS, {"": Part(Driven, search=DEPTH)})
