"""The AXI4-Lite slave: the host's registers (`spec.registers`)."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.counters import counters_layout
from splatcore.hdl.lib.record import ERROR as ERROR_EVENT
from splatcore.hdl.lib.record import frame_layout
from splatcore.hdl.memory.bus import axi_lite
from splatcore.spec import registers
from splatcore.spec.axi import LITE_ADDRESS_BITS, LITE_DATA_BITS, OKAY, SLAVE_ERROR
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.config import Config
from splatcore.spec.counters import counters

WORD_BITS = exact_log2(registers.WORD)
FIRST = registers.FRAME_START // registers.WORD

ERROR = data.StructLayout({"code": registers.CODE_BITS, "detail": registers.DETAIL_BITS})
"""Layout of an error in register ERROR, below the bits of the halves."""


class Registers(wiring.Component):
    """The machine's registers, read and written by the host.

    Words are written as a whole. A write is refused if not all strobes are set, if it is to a frame
    register while these are locked, or if the word is read-only or no register. A refused write
    changes nothing and is answered by SLAVE_ERROR. A read of a word that is no register returns 0
    and SLAVE_ERROR. The two lowest address bits and bits above a register's width are ignored.
    START while READY is low is answered by OKAY, starts nothing and is an error; together with
    ABORT it is ignored.

    **Timing**: a write is done in the cycle after its address and data have come; a read is
    answered two cycles after its address; one write and one read every two cycles. No path from an
    input of the port to an output of it. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        self.map: dict[int, registers.Register] = registers.register_map(config)
        self.address = {register.name: address for address, register in self.map.items()}
        stages = {stage: counters_layout(names) for stage, names in counters(config).items()}
        ports = {
            "s_axi": In(axi_lite()),  # AXI4-Lite slave
            "interrupt": Out(1),  # an enabled event of INTERRUPT has occurred
            "frame": Out(frame_layout(config)),  # the frame registers
            "locked": In(1),  # the frame registers cannot be written
            # the host's command, for one cycle; READY may stay high in this cycle and the next one,
            # not longer
            "start": Out(1),
            "abort": Out(1),
            "status": In(self.map[self.address["STATUS"]].width),  # the bits of STATUS
            "ready_event": In(1),  # high for one cycle: sets the bit of INTERRUPT
            "frame_event": In(1),  # high for one cycle: sets the bit of INTERRUPT
            # `hdl.lib.record.ERROR`, valid for one cycle: goes to register ERROR unless that holds
            # an error
            "error": In(ERROR_EVENT),
            # one bit per half, set in register ERROR in any case
            "gives_up": In(registers.HALVES_BITS),
            "started": In(self.map[self.address["STARTED"]].width),  # values of these registers
            "finished": In(self.map[self.address["FINISHED"]].width),  # values of these registers
            "needed": In(PAGE_BITS),  # values of these registers
            "counters": In(data.StructLayout(stages)),  # counts by stage and name
        }
        super().__init__(ports)
        # The present write: accepted (`taken`), with all strobes (`whole`), its word and value.
        self.write, self.taken = Signal(), Signal()
        self.whole = Signal()
        self.word = Signal(LITE_ADDRESS_BITS - WORD_BITS, reset_less=True)
        self.value = Signal(LITE_DATA_BITS, reset_less=True)
        self.events = Signal(self.map[self.address["INTERRUPT"]].width)
        self.enabled = Signal(self.map[self.address["INTERRUPT_ENABLE"]].width)
        self.first_error, self.given_up = Signal(ERROR), Signal(registers.HALVES_BITS)

    def elaborate(self, platform) -> Module:
        m = Module()
        lock_broken = self._take(m)
        start_refused = self._commands(m)
        self._errors(m, start_refused, lock_broken)
        for register in registers.frame_registers(self.config):
            with m.If(self._at(register.name)):
                m.d.sync += self.frame[register.name.lower()].eq(self.value)
        self._read(m)
        return m

    def _at(self, name: str) -> Value:
        """High if the named register is being written."""
        return self.taken & (self.word == self.address[name] // registers.WORD)

    def _take(self, m: Module) -> Value:
        """Handle writes; return whether a write of a locked register is refused."""
        s_axi = self.s_axi
        addressed, given = Signal(), Signal()
        with m.If(s_axi.awready):
            m.d.sync += [addressed.eq(s_axi.awvalid), self.word.eq(s_axi.awaddr[WORD_BITS:])]
        with m.If(s_axi.wready):
            m.d.sync += [given.eq(s_axi.wvalid), self.value.eq(s_axi.wdata)]
            m.d.sync += self.whole.eq(s_axi.wstrb.all())
        writable, of_frame = Signal(), Signal()
        with m.Switch(self.word):
            for address, register in self.map.items():
                if register.access != "read":
                    with m.Case(address // registers.WORD):
                        m.d.comb += writable.eq(1)
                        if register.access == "frame":
                            m.d.comb += of_frame.eq(1)
        m.d.comb += [s_axi.awready.eq(~addressed), s_axi.wready.eq(~given)]
        m.d.comb += self.write.eq(addressed & given & ~s_axi.bvalid)
        m.d.comb += self.taken.eq(self.write & self.whole & writable & ~(of_frame & self.locked))
        with m.If(self.write):
            m.d.sync += [addressed.eq(0), given.eq(0)]
            m.d.sync += [s_axi.bvalid.eq(1), s_axi.bresp.eq(Mux(self.taken, OKAY, SLAVE_ERROR))]
        with m.Elif(s_axi.bready):
            m.d.sync += s_axi.bvalid.eq(0)
        return self.write & self.whole & of_frame & self.locked

    def _commands(self, m: Module) -> Value:
        """Decode START and ABORT; return whether START is refused."""
        start, abort, ready = Signal(), Signal(), Signal()
        control = self._at("CONTROL")
        m.d.comb += [
            abort.eq(control & (self.value & registers.ABORT).any()),
            start.eq(control & (self.value & registers.START).any() & ~abort),
            ready.eq((self.status & registers.READY).any()),
            self.start.eq(start & ready),
            self.abort.eq(abort),
        ]
        return start & ~ready

    def _errors(self, m: Module, start_refused: Value, lock_broken: Value):
        """The first error, and interrupts. `error` takes precedence over errors of the host."""
        new, valid = Signal(ERROR), Signal()
        m.d.comb += [
            valid.eq(self.error.valid | start_refused | lock_broken),
            new.code.eq(Mux(lock_broken, registers.ErrorCode.LOCKED, registers.ErrorCode.START)),
            new.detail.eq(Mux(lock_broken, self.word - FIRST, 0)),
        ]
        with m.If(self.error.valid):
            m.d.comb += [new.code.eq(self.error.code), new.detail.eq(self.error.detail)]
        clears = self._at("ERROR")
        with m.If(clears | (self.first_error.code == registers.ErrorCode.NONE)):
            m.d.sync += self.first_error.eq(Mux(valid, new, 0))
        m.d.sync += self.given_up.eq(Mux(clears, 0, self.given_up) | self.gives_up)
        events = {
            registers.INTERRUPT_READY: self.ready_event,
            registers.INTERRUPT_FRAME: self.frame_event,
            registers.INTERRUPT_ERROR: valid,
        }
        cleared = Mux(self._at("INTERRUPT"), self.value, 0)
        for bit, event in events.items():
            k = exact_log2(bit)
            m.d.sync += self.events[k].eq(event | (self.events[k] & ~cleared[k]))
        with m.If(self._at("INTERRUPT_ENABLE")):
            m.d.sync += self.enabled.eq(self.value)
        m.d.comb += self.interrupt.eq((self.events & self.enabled).any())

    def _values(self) -> dict[str, Value]:
        """Values of registers by name, except constants and registers that read as 0."""
        values = {
            "STATUS": self.status,
            "INTERRUPT": self.events,
            "INTERRUPT_ENABLE": self.enabled,
            "ERROR": Cat(self.first_error, self.given_up),
            "STARTED": self.started,
            "FINISHED": self.finished,
            "NEEDED": self.needed,
        }
        values |= {name.upper(): self.frame[name] for name in self.frame.shape().members}
        for stage, names in counters(self.config).items():
            values |= {f"{stage}_{name}".upper(): self.counters[stage][name] for name in names}
        return values

    def _read(self, m: Module):
        """Handle reads."""
        s_axi, values = self.s_axi, self._values()
        asked = Signal()
        word = Signal(LITE_ADDRESS_BITS - WORD_BITS, reset_less=True)
        found, known = Signal(LITE_DATA_BITS), Signal()
        m.d.comb += s_axi.arready.eq(~asked)
        with m.If(s_axi.arready):
            m.d.sync += [asked.eq(s_axi.arvalid), word.eq(s_axi.araddr[WORD_BITS:])]
        with m.Switch(word):
            for address, register in self.map.items():
                with m.Case(address // registers.WORD):
                    m.d.comb += known.eq(1)
                    if register.value is not None:
                        m.d.comb += found.eq(register.value)
                    elif register.access != "control":
                        m.d.comb += found.eq(values[register.name])
        with m.If(asked & ~s_axi.rvalid):
            m.d.sync += [asked.eq(0), s_axi.rvalid.eq(1)]
            m.d.sync += [s_axi.rdata.eq(found), s_axi.rresp.eq(Mux(known, OKAY, SLAVE_ERROR))]
        with m.Elif(s_axi.rready):
            m.d.sync += s_axi.rvalid.eq(0)
