"""Writes items of a fixed size to memory."""

from amaranth.hdl import Const, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.memory.axi import write_data
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, DATA_BITS, port_beats, write_record
from splatcore.spec.config import Config


class Store(wiring.Component):
    """Writes items of a fixed number of beats, each as one burst.

    Parameters:
        beats: beats of the machine per item

    **Timing**: one beat of the port per cycle, latency 0. A path from `writes.ready` to `i.ready`.
    """

    def __init__(self, config: Config, beats: int):
        self.config, self.beats = config, beats
        item = data.StructLayout({"beat": BEAT_ADDRESS_BITS, "data": beats * DATA_BITS})
        ports = {
            # {beat, data}: an item and its address in beats, a multiple of its beats
            "i": In(stream.Signature(item)),
            "writes": Out(stream_of(write_record(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        item, write = self.i.payload, self.writes.payload
        bits, count = self.config.port, max(self.beats // port_beats(self.config), 1)
        number = Signal(range(max(count, 2)))  # of the port's beat
        data, strobe = item.data, Const((1 << bits // 8) - 1)
        if count * bits > len(data):  # an item is a part of the port's beat
            place = item.beat[: exact_log2(bits // len(data))]
            data = data.replicate(bits // len(data))
            strobe = Const((1 << BEAT) - 1) << place * BEAT
        last = number == count - 1
        m.d.comb += [
            self.writes.valid.eq(self.i.valid),
            write.beat.eq(item.beat),
            write.length.eq(count - 1),
            write.strobe.eq(strobe),
            write_data(self.config, write).eq(data.word_select(number, bits)),
            self.i.ready.eq(self.writes.ready & last),
        ]
        with m.If(self.writes.valid & self.writes.ready):
            m.d.sync += number.eq(number + 1)
            with m.If(last):
                m.d.sync += number.eq(0)
        return m
