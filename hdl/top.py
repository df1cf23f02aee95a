"""The top module: registers, frame control, both halves of the machine, and the memory port."""

from amaranth.hdl import Cat, Module, ResetInserter
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.frame import Frame
from splatcore.hdl.lib.counters import Counters
from splatcore.hdl.memory.axi import HALVES, Axi
from splatcore.hdl.memory.bus import axi, axi_lite
from splatcore.hdl.points.preprocess import Preprocess
from splatcore.hdl.raster.job import WRITING
from splatcore.hdl.raster.render import Render
from splatcore.hdl.registers import Registers
from splatcore.spec.axi import PREPROCESSING, READERS, RENDERING, WRITERS, window_bits
from splatcore.spec.config import Config
from splatcore.spec.counters import HALF, beats


class Top(wiring.Component):
    """Splatcore: renders packed models in memory to images in memory.

    **Timing**: the first half preprocesses a frame while the second renders the previous one; each
    half takes as long as its slowest stage.
    """

    def __init__(self, config: Config):
        self.config, self.windows = config, bool(window_bits(config))
        self.registers, self.frame, self.axi = Registers(config), Frame(config), Axi(config)
        self.preprocess, self.render = Preprocess(config), Render(config)
        ports = {
            "s_axi": In(axi_lite()),  # the registers of `spec.registers`
            "m_axi": Out(axi(config)),  # memory
            "interrupt": Out(1),  # an enabled event has occurred
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        frame, halves = self.frame, {"preprocess": self.preprocess, "render": self.render}
        m.submodules.registers, m.submodules.axi = self.registers, self.axi
        m.submodules.frame = frame
        for half, (name, part) in enumerate(halves.items()):
            m.submodules[name] = ResetInserter(frame.reset[half])(part)
            m.d.comb += [part.start.eq(frame.begin[half]), frame.done[half].eq(part.done)]
            self._connect(m, part, half)
            self._count(m, name, half)
        connect(m, flipped(self).s_axi, self.registers.s_axi)
        connect(m, self.axi.m_axi, flipped(self).m_axi)
        m.d.comb += frame.fails.eq(self.preprocess.error)
        settled = [
            Cat(self.axi.settled[k] for k, of in enumerate(WRITERS.values()) if of == half)
            for half in HALVES
        ]
        m.d.comb += [
            self.preprocess.frame.eq(self.registers.frame),
            self.preprocess.area.eq(frame.area),
            self.preprocess.taken.eq(frame.taken),
            self.preprocess.settled.eq(settled[PREPROCESSING].all()),
            self.render.job.eq(frame.job),
            self.render.settled.eq(settled[RENDERING]),
            *(
                self.axi.patient[list(WRITERS).index(name)].eq(patient)
                for name, patient in zip(WRITING, self.render.patient, strict=True)
            ),
        ]
        self._host(m)
        return m

    def _connect(self, m: Module, part: Preprocess | Render, half: int):
        """Connect a half's readers and writers to their streams at the memory port."""
        readers = [k for k, of in enumerate(READERS.values()) if of == half]
        writers = [k for k, of in enumerate(WRITERS.values()) if of == half]
        for number, port in enumerate(readers):
            connect(m, part.reads[number], self.axi.reads[port])
            connect(m, self.axi.data[port], part.data[number])
        for number, port in enumerate(writers):
            connect(m, part.writes[number], self.axi.writes[port])
        for way, ports in (("read", readers), ("write", writers)) if self.windows else ():
            name = f"{way}_windows"
            for number, port in enumerate(ports):
                m.d.comb += getattr(self.axi, name)[port].eq(getattr(part, name)[number])

    def _count(self, m: Module, name: str, half: int):
        """Count a half's cycles and traffic."""
        names = tuple(HALF | beats(half))
        m.submodules[f"{name}_counters"] = counters = Counters(names)
        events = {"cycles": self.frame.working[half]}
        for way, clients, passed in (
            ("read", READERS, self.axi.beats_read),
            ("write", WRITERS, self.axi.beats_written),
        ):
            for port, (client, of) in enumerate(clients.items()):
                if of == half:
                    events[f"{way}_{client}"] = passed[port]
        m.d.comb += [counters.event[name].eq(event) for name, event in events.items()]
        m.d.comb += counters.clear.eq(self.frame.begin[half])
        stage = ("preprocessing", "rendering")[half]
        m.d.comb += self.registers.counters[stage].eq(counters.value)

    def _host(self, m: Module):
        """Connect the host's registers and frame control."""
        registers, frame = self.registers, self.frame
        m.d.comb += [
            frame.frame.eq(registers.frame),
            frame.start.eq(registers.start),
            frame.abort.eq(registers.abort),
            registers.status.eq(Cat(frame.ready, frame.working)),
            registers.locked.eq(frame.working[PREPROCESSING]),
            self.interrupt.eq(registers.interrupt),
            frame.idle.eq(self.axi.idle),
            self.axi.failing.eq(frame.failing),
            registers.ready_event.eq(frame.ready_event),
            registers.frame_event.eq(frame.frame_event),
            registers.error.eq(frame.error),
            registers.gives_up.eq(frame.gives_up),
            registers.started.eq(frame.started),
            registers.finished.eq(frame.finished),
            frame.read_error.eq(self.axi.read_error),
            frame.write_error.eq(self.axi.write_error),
            frame.stray.eq(self.axi.stray),
        ]
        with m.If(self.preprocess.counted):  # kept when the half fails (as for PAGES) and is reset
            m.d.sync += registers.needed.eq(self.preprocess.needed)
        for part in (self.preprocess, self.render):
            for stage in part.counters.shape().members:
                m.d.comb += registers.counters[stage].eq(part.counters[stage])
