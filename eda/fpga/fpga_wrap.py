"""Registers around a part that is placed alone on an FPGA; a rasterizer's lanes as a part."""

from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.spec.config import Config
from splatcore.spec.raster import block_count


class Wrap(wiring.Component):
    """A part between registers that are written through one pin and read through another.

    Parts have hundreds of port bits, more than a package has pins, and a path to a pin would hide
    the part's own paths. So one long shift register drives all inputs, and outputs are captured in
    registers and XORed into a signature, another shift register. Each input can take any value and
    each output is observed, so synthesis cannot remove any logic of the part, and all paths are
    between registers.

    Members
        d: next bit of the inputs
        q: last bit of the signature

    Attributes
        input_ports, output_ports: ports of the part
        inputs, outputs: their total widths

    **Timing**: two cycles or more from the part's outputs to `q`.
    """

    def __init__(self, part: wiring.Component):
        self.part = part
        ports = [
            (member.flow, Value.cast(value))
            for _, member, value in part.signature.flatten(part)
        ]  # fmt: skip
        self.input_ports = [value for flow, value in ports if flow == In]
        self.output_ports = [value for flow, value in ports if flow == Out]
        self.inputs = sum(map(len, self.input_ports))
        self.outputs = sum(map(len, self.output_ports))
        super().__init__({"d": In(1), "q": Out(1)})

    @property
    def flip_flops(self) -> int:
        """Number of flip-flops around the part."""
        return self.inputs + 2 * self.outputs

    @property
    def luts(self) -> int:
        """Number of LUTs around the part: one XOR per bit of the signature except the first."""
        return self.outputs - 1

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = self.part
        shift = Signal(self.inputs, reset_less=True)
        captured = Signal(self.outputs, reset_less=True)
        signature = Signal(self.outputs, reset_less=True)
        m.d.sync += [
            shift.eq(Cat(self.d, shift)),
            captured.eq(Cat(*self.output_ports)),
            signature.eq(captured ^ (signature << 1)),
        ]
        place = 0
        for value in self.input_ports:
            m.d.comb += value.eq(shift[place : place + len(value)])
            place += len(value)
        m.d.comb += self.q.eq(signature[-1])
        return m


class Lanes(wiring.Component):
    """Lanes of a rasterizer: evaluation of E and blending for some pixels of a block.

    A rasterizer has one lane for each of a block's 16 pixels; this component has fewer, and no
    queues and control.

    Members
        those of `hdl.raster.evaluate.Evaluate` and `hdl.raster.blend.Blend`, without the alphas
            between them

    **Timing**: as these two.
    """

    def __init__(self, config: Config, pixels: int):
        self.evaluate = Evaluate(config, 0, pixels)
        self.blend = Blend(config, block_count(config), pixels)
        members = self.evaluate.signature.members, self.blend.signature.members
        both = {name: member for part in members for name, member in part.items()}
        del both["log2_alphas"]
        super().__init__(both)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.evaluate, m.submodules.blend = self.evaluate, self.blend
        m.d.comb += self.blend.log2_alphas.eq(self.evaluate.log2_alphas)
        for part in (self.evaluate, self.blend):
            for name in part.signature.members.keys() & self.signature.members.keys():
                member, inner, outer = (
                    self.signature.members[name],
                    getattr(part, name),
                    getattr(self, name),
                )
                m.d.comb += inner.eq(outer) if member.flow == In else outer.eq(inner)
        return m
