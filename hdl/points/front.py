"""Stage 1's end in a machine without culling: drops splats behind the near plane."""

from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.lib.record import layout
from splatcore.spec.config import Config
from splatcore.spec.point import splat_record


class Front(wiring.Component):
    """Splats in, those out whose centres are in front.

    With culling (`Config.culling`) they all are, and a machine has no such part.

    Members
        i, o: streams of `splat_record`.
        near_plane: register of the frame.

    **Timing**: combinational; a splat a cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        splats = stream.Signature(layout(splat_record(config)))
        super().__init__(
            {"i": In(splats), "near_plane": In(config.arithmetic.width), "o": Out(splats)}
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.config.arithmetic
        compare = compared(m, "compare", format, self.near_plane, self.i.payload.z)
        m.d.comb += [
            self.o.payload.eq(self.i.payload),
            self.o.valid.eq(self.i.valid & compare.less),
            self.i.ready.eq(self.o.ready | ~compare.less),
        ]
        return m
