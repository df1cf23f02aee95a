"""Every stage and primitive by name: what the command line writes as Verilog and synthesises."""

from collections.abc import Callable

from amaranth.lib import wiring

from hdl.add import Add
from hdl.array import Array
from hdl.multiply import Multiply
from hdl.multiply_add import MultiplyAdd
from hdl.unary import Reciprocal, ReciprocalRoot
from spec.config import Config
from spec.microprogram import program, projection
from spec.schedule import latencies

Build = Callable[[Config], wiring.Component]

STAGES: dict[str, Build] = {
    "chunk": lambda config: Array(config, program("chunk")),
    "cull": lambda config: Array(config, program("cull")),
    "place": lambda config: Array(config, program("place")),
    "project": lambda config: Array(config, projection(config.sh_degree, config.skip_zeros)),
}
"""Arithmetic of the stages: the arrays that run their microprograms."""

PRIMITIVES: dict[str, Build] = {
    "multiply": lambda config: Multiply(config.arithmetic, config.multiply_latency),
    "add": lambda config: Add(config.arithmetic, config.add_latency),
    "multiply_add": lambda config: MultiplyAdd(config.arithmetic, latencies(config)["pe"]),
    "reciprocal": lambda config: Reciprocal(config.arithmetic, config.unary_latency),
    "reciprocal_root": lambda config: ReciprocalRoot(config.arithmetic, config.unary_latency),
}
"""Parts that stages are made of, on their own."""

PAPER_GATES = {"cull": 12_900, "project": 71_600, "sort": 761_400, "raster": 88_900}
"""NAND2-equivalents of the paper's stages 0 to 3 (its table of gate counts)."""
