"""Every stage and primitive by name: what the command line writes as Verilog and synthesises."""

from collections.abc import Callable

from amaranth.lib import wiring

from hdl.add import Add
from hdl.array import Array
from hdl.chunk import Chunk
from hdl.codebook import Codebook
from hdl.cull import Cull
from hdl.multiply import Multiply
from hdl.multiply_add import MultiplyAdd
from hdl.place import Place
from hdl.points import Points
from hdl.position import Position
from hdl.project import Project
from hdl.unary import Reciprocal, ReciprocalRoot
from spec.config import Config
from spec.microprogram import projection
from spec.schedule import latencies

Build = Callable[[Config], wiring.Component]

STAGES: dict[str, Build] = {
    "chunk": Chunk,
    "cull": Cull,
    "place": Place,
    "project": Project,
    "points": Points,
}
"""Stage 0 is chunk and cull, stage 1 place and project; points is both stages together."""

PRIMITIVES: dict[str, Build] = {
    "position": Position,
    "codebook": Codebook,
    "array": lambda config: Array(
        config, projection(config.sh_degree, config.skip_zeros), stalls=False
    ),
    "multiply": lambda config: Multiply(config.arithmetic, config.multiply_latency),
    "add": lambda config: Add(config.arithmetic, config.add_latency),
    "multiply_add": lambda config: MultiplyAdd(config.arithmetic, latencies(config)["pe"]),
    "reciprocal": lambda config: Reciprocal(config.arithmetic, config.unary_latency),
    "reciprocal_root": lambda config: ReciprocalRoot(config.arithmetic, config.unary_latency),
}
"""Parts that stages are made of, on their own."""

PAPER_GATES = {"cull": 12_900, "project": 71_600, "sort": 761_400, "raster": 88_900}
"""NAND2-equivalents of the paper's stages 0 to 3 (its table of gate counts)."""
