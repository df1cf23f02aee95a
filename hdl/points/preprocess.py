"""First half of a frame: turns the model in memory into features and groups' lists in memory."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.binning.bin import Bin
from splatcore.hdl.binning.binned import WRITING, Binned
from splatcore.hdl.lib.record import AREA, ERROR, frame_layout, stream_of
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.window import client_windows
from splatcore.hdl.points.check import Check
from splatcore.hdl.points.model_reader import READING, ModelReader
from splatcore.hdl.points.points import Points
from splatcore.spec import axi
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.compensation import MODEL_CONSTANTS
from splatcore.spec.config import Config
from splatcore.spec.frame import fixed_constants
from splatcore.spec.registers import ErrorCode


class Preprocess(wiring.Component):
    """Stages 0 and 1 and binning with their memory access, frame by frame.

    **Timing**: as its slowest part, one Gaussian in 6 cycles in `DEFAULT`, if memory keeps up.
    """

    def __init__(self, config: Config):
        self.config = config
        self.model, self.points = ModelReader(config), Points(config)
        self.bin, self.binned = Bin(config), Binned(config)
        parts = {"points": self.points, "bin": self.bin}
        counters = {name: part.counters.shape() for name, part in parts.items()}
        ports = {
            "start": In(1),  # begin a frame
            # its registers, stable from `hdl.points.check.LATENCY` cycles before `start` until
            # `done`
            "frame": In(frame_layout(config)),
            "area": In(AREA),  # the work area to be written
            # to memory, one for each of `model_reader.READING`
            "reads": Out(stream_of(axi.read_record())).array(len(READING)),
            # from memory, one for each of `model_reader.READING`
            "data": In(stream.Signature(read_beat(config))).array(len(READING)),
            # to memory, one for each of `binned.WRITING`
            "writes": Out(stream_of(axi.write_record(config))).array(len(WRITING)),
            "settled": In(1),  # all written data is in memory
            "done": Out(1),  # the work area is complete; until `taken`
            "taken": In(1),  # the work area has been handed over
            "needed": Out(PAGE_BITS),  # list pages that the frame takes, while `counted` is high
            "counted": Out(1),  # `needed` is valid, for one cycle
            "error": Out(ERROR),  # the frame cannot be rendered; nothing more happens until reset
            # counters of `hdl.points.points` and `hdl.binning.bin`
            "counters": Out(data.StructLayout(counters)),
        }
        # `read_windows` and `write_windows` of `reads` and `writes`, if there are windows
        windows = client_windows(config, len(READING), len(WRITING))
        super().__init__(ports | {name: Out(shape) for name, shape in windows.items()})

    def elaborate(self, platform) -> Module:
        m = Module()
        model, points, bin = self.model, self.points, self.bin
        m.submodules.model, m.submodules.points = model, points
        m.submodules.bin, m.submodules.binned = bin, self.binned
        for number in range(len(READING)):
            connect(m, model.reads[number], flipped(self.reads[number]))
            connect(m, flipped(self.data[number]), model.data[number])
        for number in range(len(WRITING)):
            connect(m, self.binned.writes[number], flipped(self.writes[number]))
        for source, target in (
            (model.headers, points.headers),
            (points.fetch, model.fetch),
            (model.positions, points.positions),
            (points.wanted, model.wanted),
            (model.attributes, points.attributes),
            (model.write, points.write),
            (points.splats, bin.i),
            (bin.features, self.binned.features),
            (bin.bursts, self.binned.bursts),
            (bin.groups, self.binned.groups),
        ):
            connect(m, source, target)
        self._registers(m)
        self._control(m)
        return m

    def _registers(self, m: Module):
        """Registers of the frame and of the model to the parts that use them."""
        frame, points, config = self.frame, self.points, self.config
        fixed = fixed_constants(config)
        for name in points.frame.constants.shape().members:
            if name in MODEL_CONSTANTS:
                code = Mux(self.model.model[name], int(config.arithmetic.encode(1.0)), 0)
            elif name in fixed:
                code = Const(int(config.arithmetic.encode(fixed[name])), config.arithmetic.width)
            else:
                code = frame[f"constant_{name}"]
            m.d.comb += points.frame.constants[name].eq(code)
        for k, axis in enumerate("xyz"):
            low, high = frame[f"camera_{axis}_low"], frame[f"camera_{axis}_high"]
            m.d.comb += points.frame.camera[k].eq(Cat(low, high))
        if config.levels:
            reader = self.model
            m.d.comb += [points.levels.eq(reader.levels), points.turn.eq(reader.turn)]
            m.d.comb += [reader.jump.eq(points.jump), reader.target.eq(points.target)]
        m.d.comb += [
            self.model.model_at.eq(frame.model[axi.BEAT_BITS :]),
            points.model.eq(self.model.model),
            points.frame.near_plane.eq(frame.near_plane),
            self.bin.width.eq(frame.width),
            self.bin.height.eq(frame.height),
            self.bin.pages.eq(frame.lists_pages),
            self.binned.features_max.eq(frame.features_max),
            self.binned.area.eq(self.area),
            self.counters.points.eq(points.counters),
            self.counters.bin.eq(self.bin.counters),
        ]
        if axi.window_bits(config):
            for areas, names, windows in (
                (axi.READ_AREAS, READING, self.read_windows),
                (axi.WRITE_AREAS, WRITING, self.write_windows),
            ):
                for number, name in enumerate(names):
                    m.d.comb += windows[number].eq(frame[f"{areas[name]}_high"])

    def _control(self, m: Module):
        """A frame from its start until its work area is complete."""
        model, points, bin, binned = self.model, self.points, self.bin, self.binned
        exceeded = Signal()  # the lists have taken too many pages
        m.submodules.check = check = Check(self.config)
        m.d.comb += check.frame.eq(self.frame)
        for part in (points, bin, binned):
            m.d.comb += part.clear.eq(self.start)
        with m.FSM():
            with m.State("IDLE"), m.If(self.start):
                m.next = "CHECK"
            with m.State("CHECK"):
                m.d.comb += model.start.eq(check.error == ErrorCode.NONE)
                m.next = "LOAD"
                with m.If(check.error != ErrorCode.NONE):
                    self._fail(m, check.error, check.detail)
            with m.State("LOAD"):
                with m.If(model.error != ErrorCode.NONE):
                    self._fail(m, model.error, model.detail)
                with m.Elif(model.loaded):
                    m.next = "CHUNKS"
            with m.State("CHUNKS"):
                m.d.comb += model.run.eq(1)
                m.next = "POINTS"
            with m.State("POINTS"):
                with m.If(model.given & points.idle):
                    m.next = "FINISH"
                if self.config.levels:
                    with m.If(points.fault):
                        self._fail(m, ErrorCode.LEVELS)
            with m.State("FINISH"):
                m.d.comb += bin.finish.eq(1)
                with m.If(bin.done):
                    m.d.comb += [self.needed.eq(bin.needed), self.counted.eq(1)]
                    m.d.sync += exceeded.eq(bin.exceeded)
                    m.next = "SETTLE"
            with m.State("SETTLE"):
                m.d.comb += binned.finish.eq(1)
                with m.If(binned.empty & self.settled):
                    m.next = "DONE"
                    with m.If(binned.exceeded):
                        self._fail(m, ErrorCode.FEATURES)
                    with m.Elif(exceeded):
                        self._fail(m, ErrorCode.PAGES)
            with m.State("DONE"):
                m.d.comb += self.done.eq(1)
                with m.If(self.taken):
                    m.next = "IDLE"
            with m.State("FAILED"):
                pass

    def _fail(self, m: Module, code, detail=0):
        """Report an error, and wait for the reset."""
        m.d.comb += [self.error.valid.eq(1), self.error.code.eq(code), self.error.detail.eq(detail)]
        m.next = "FAILED"
