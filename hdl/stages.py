"""Every stage and part by name, for Verilog output and synthesis from the command line."""

from collections.abc import Callable

from amaranth.lib import wiring

from splatcore.hdl.arithmetic.add import Add, MultiplyAdd
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.arithmetic.unary import Reciprocal, Rsqrt
from splatcore.hdl.binning.bin import Bin
from splatcore.hdl.binning.binned import Binned
from splatcore.hdl.frame import Frame
from splatcore.hdl.memory.axi import Axi
from splatcore.hdl.memory.store import Store
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.chunk import Chunk
from splatcore.hdl.points.codebook import Codebook
from splatcore.hdl.points.cull import Cull
from splatcore.hdl.points.model_reader import ModelReader
from splatcore.hdl.points.place import Place
from splatcore.hdl.points.points import Points
from splatcore.hdl.points.position import Position
from splatcore.hdl.points.project import Project
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.hdl.raster.features import Features
from splatcore.hdl.raster.groups import Groups
from splatcore.hdl.raster.list_reader import LONG_BEATS_WAITING, LONG_BURST, ListReader
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.pixels import Pixels
from splatcore.hdl.raster.prepare import Prepare
from splatcore.hdl.raster.quads import Quad
from splatcore.hdl.raster.raster import Raster
from splatcore.hdl.raster.rasterizer import Rasterizer
from splatcore.hdl.raster.setup import Setup
from splatcore.hdl.registers import Registers
from splatcore.hdl.sorting.deal import Deal
from splatcore.hdl.sorting.merge import Merge
from splatcore.hdl.sorting.sort import Sort
from splatcore.hdl.sorting.sorter import Sorter
from splatcore.spec import microprogram, raster, schedule, stages
from splatcore.spec.axi import LINE_BEATS
from splatcore.spec.config import Config

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
"""The stages of `spec.stages`, and `points`: all stages that process points, connected."""

CONTROL: dict[str, Build] = {
    "axi": Axi,
    "registers": Registers,
    "frame": Frame,
    "model": ModelReader,
    "binned": Binned,
    "groups": Groups,
    "long_lists": lambda config: ListReader(config, LONG_BEATS_WAITING, LONG_BURST),
    "lists": ListReader,
    "buckets": lambda config: Store(config, LINE_BEATS),
    "deal": Deal,
    "features": Features,
    "pixels": Pixels,
}
"""Memory access and host interface; `Top` consists of these and points, bin, sort and raster."""

WHOLE: dict[str, tuple[Build, ...]] = {
    block: (STAGES[block],) for blocks in stages.BLOCKS.values() for block in blocks
} | {"control": tuple(CONTROL.values())}
"""Blocks and control; together they are the whole machine."""

LARGE = ("sort", "raster")  # stages that take minutes to synthesise; `PRIMITIVES` has their parts

PRIMITIVES: dict[str, Build] = {
    "position": Position,
    "codebook": Codebook,
    "colour": lambda config: Project(config).colour,
    "array": lambda config: Array(config, microprogram.projection(config), stalls=False),
    "multiply": lambda config: Multiply(config.arithmetic, config.multiply_latency),
    "add": lambda config: Add(config.arithmetic, config.add_latency),
    "multiply_add": lambda config: MultiplyAdd(config.arithmetic, schedule.latencies(config)["pe"]),
    "reciprocal": lambda config: Reciprocal(config.arithmetic, config.unary_latency),
    "rsqrt": lambda config: Rsqrt(config.arithmetic, config.unary_latency),
    "sub_sorter": Sorter,
    "merge": Merge,
    "prepare": Prepare,
    "setup": Setup,
    "mark": Mark,
    "evaluate": lambda config: Evaluate(config, 0),
    "lane": lambda config: Blend(config, raster.block_count(config), 1),
    "blend": lambda config: Blend(config, raster.block_count(config)),
    "rasterizer": lambda config: Rasterizer(config, 0),
    "quad": Quad,
}
"""Parts of the stages, each on its own."""
