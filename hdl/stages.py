"""Every stage and primitive by name: what the command line writes as Verilog and synthesises."""

from collections.abc import Callable

from amaranth.lib import wiring

from hdl.add import Add
from hdl.array import Array
from hdl.axi import Axi
from hdl.bin import Bin
from hdl.binned import Binned
from hdl.blend import Blend
from hdl.chunk import Chunk
from hdl.codebook import Codebook
from hdl.cull import Cull
from hdl.entries import Entries
from hdl.evaluate import Evaluate
from hdl.features import Features
from hdl.frame import Frame
from hdl.groups import Groups
from hdl.mark import Mark
from hdl.merge import Merge
from hdl.model import Model
from hdl.multiply import Multiply
from hdl.multiply_add import MultiplyAdd
from hdl.pixels import Pixels
from hdl.place import Place
from hdl.points import Points
from hdl.position import Position
from hdl.prepare import Prepare
from hdl.project import Project
from hdl.raster import Raster
from hdl.rasterizer import Rasterizer
from hdl.registers import Registers
from hdl.scratch import Scratch
from hdl.setup import Setup
from hdl.sort import Sort
from hdl.subsort import SubSorter
from hdl.unary import Reciprocal, ReciprocalRoot
from spec.config import Config
from spec.microprogram import projection
from spec.raster import block_count
from spec.schedule import latencies

Build = Callable[[Config], wiring.Component]

STAGES: dict[str, Build] = {
    "chunk": Chunk,
    "cull": Cull,
    "place": Place,
    "project": Project,
    "points": Points,
    "bin": Bin,
    "sort": Sort,
    "raster": Raster,
}
"""Stage 0 is chunk and cull, stage 1 place and project; points is both stages together. Stage 2 is
sort, stage 3 raster."""

CONTROL: dict[str, Build] = {
    "axi": Axi,
    "registers": Registers,
    "frame": Frame,
    "model": Model,
    "binned": Binned,
    "groups": Groups,
    "lists": Entries,
    "scratch": Scratch,
    "features": Features,
    "pixels": Pixels,
}
"""Memory access and the host's side; with points, bin, sort and raster they are all of `Top`."""

WHOLE: dict[str, tuple[Build, ...]] = {
    name: (STAGES[name],) for name in ("points", "bin", "sort", "raster")
} | {"control": tuple(CONTROL.values())}
"""What together is all of the machine."""

LARGE = ("sort", "raster")
"""Stages that take minutes to synthesise; `PRIMITIVES` has their parts."""

PRIMITIVES: dict[str, Build] = {
    "position": Position,
    "codebook": Codebook,
    "array": lambda config: Array(config, projection(config), stalls=False),
    "multiply": lambda config: Multiply(config.arithmetic, config.multiply_latency),
    "add": lambda config: Add(config.arithmetic, config.add_latency),
    "multiply_add": lambda config: MultiplyAdd(config.arithmetic, latencies(config)["pe"]),
    "reciprocal": lambda config: Reciprocal(config.arithmetic, config.unary_latency),
    "reciprocal_root": lambda config: ReciprocalRoot(config.arithmetic, config.unary_latency),
    "sub_sorter": SubSorter,
    "merge": Merge,
    "prepare": Prepare,
    "setup": Setup,
    "mark": Mark,
    "evaluate": lambda config: Evaluate(config, 0),
    "lane": lambda config: Blend(config, block_count(config), 1),
    "blend": lambda config: Blend(config, block_count(config)),
    "rasterizer": lambda config: Rasterizer(config, 0),
}
"""Parts that stages are made of, on their own."""

PAPER_GATES = {"cull": 12_900, "project": 71_600, "sort": 761_400, "raster": 88_900}
"""NAND2-equivalents of the paper's stages 0 to 3 (its table of gate counts)."""

PAPER_CONTROL, PAPER_ALL = 208_900, 1_143_800
"""Those of its control, and of all of it (as printed there: 100 more than the sum)."""

PAPER_MEMORIES = {"sort": 56, "feature": 32, "view": 12, "process": 12, "codebook": 8}
"""Kilobytes of the paper's memories; `sort` is four key and four value buffers of 4 KB each and
12 + 12 KB that they share."""
