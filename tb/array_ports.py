"""`Array` with a port for each number, for benches that drive arrays of numbers."""

import numpy as np
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden.program import Values
from hdl.array import Array
from sim.vectors import run
from spec.config import Config
from spec.microprogram import Program


class Ports(wiring.Component):
    def __init__(self, config: Config, program: Program):
        self.array, self.program = Array(config, program), program
        code = config.arithmetic.width
        super().__init__(
            {f"i_{name}": In(code) for name in program.inputs}
            | {f"o_{name}": Out(code) for name in program.outputs}
            | {"i_valid": In(1), "i_ready": Out(1), "o_valid": Out(1), "o_ready": In(1)}
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.array = array = self.array
        for name in self.program.fields:
            m.d.comb += array.i.payload.fields[name].eq(getattr(self, f"i_{name}"))
        for name in self.program.constants:
            m.d.comb += array.constants[name].eq(getattr(self, f"i_{name}"))
        for name in self.program.outputs:
            m.d.comb += getattr(self, f"o_{name}").eq(array.o.payload.outputs[name])
        m.d.comb += [array.i.valid.eq(self.i_valid), self.i_ready.eq(array.i.ready)]
        m.d.comb += [self.o_valid.eq(array.o.valid), array.o.ready.eq(self.o_ready)]
        return m


def run_array(config: Config, program: Program, inputs: Values) -> dict[str, np.ndarray]:
    """Codes [N] of a program's outputs for fields [N], one item after the other, never stalled."""
    ports = Ports(config, program)
    plan, format = ports.array.plan, config.arithmetic
    count = max(np.size(inputs[name]) for name in program.fields)
    rounds = count + plan.length // plan.interval + 2
    driven = {"i_valid": np.repeat(np.arange(rounds) < count, plan.interval), "o_ready": 1}
    for name in program.inputs:
        codes = format.encode(inputs[name])
        if codes.ndim:
            codes = np.repeat(np.resize(codes, rounds), plan.interval)
        driven[f"i_{name}"] = codes.astype(np.uint64)
    outputs = run(ports, driven)
    valid = outputs["o_valid"] == 1
    return {name: outputs[f"o_{name}"][valid] for name in program.outputs}
