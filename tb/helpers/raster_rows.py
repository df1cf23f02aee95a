"""Stage 3 in simulation: rows that go in and must come out, from the golden model."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from amaranth.hdl import Cat, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from splatcore.golden.raster import Entries, Raster, rasterize
from splatcore.golden.setup import prepare
from splatcore.hdl.raster.prepare import Prepare
from splatcore.hdl.raster.raster import Raster as Hardware
from splatcore.hdl.raster.raster import counted as counters_of
from splatcore.sim.rtl.streams import Result, Simulation
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import colour_format, group_grid
from splatcore.spec.raster import (
    BLOCKS,
    SHIFT,
    SHIFT_MIN,
    featured_record,
    owned,
    pixels_record,
    position_record,
    prepared_record,
)
from splatcore.spec.record import Codes
from tb.helpers.forward import counters, forward


class Watched(wiring.Component):
    """Stage 3 with its queues in view: of the splats, of each rasterizer's pairs, and of each one's
    finished blocks.

    Members, besides those of `hdl.raster.raster.Raster`
        full, empty: a bit for each queue. Finished blocks are full where no more begin to be given
        out: those on their way still find room.
    """

    def __init__(self, config: Config):
        self.inner = Hardware(config)
        queues = Out(1 + 2 * config.rasterizers)
        members = dict(self.inner.signature.members)
        super().__init__(members | {"full": queues, "empty": queues})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        forward(m, self, inner)
        pairs = [part.pairs for part in inner.rasterizers]
        finished = [(part.finished, part.blocks) for part in inner.rasterizers]
        m.d.comb += [
            self.full.eq(
                Cat(
                    *(queue.level == queue.depth for queue in (inner.splats, *pairs)),
                    *(queue.level > most for queue, most in finished),
                )
            ),
            self.empty.eq(
                Cat(queue.level == 0 for queue in (inner.splats, *pairs, *dict(finished)))
            ),
        ]
        return m


def prepared_codes(config: Config, features: Codes) -> Codes:
    """Codes of `prepared_record` for codes of features."""
    numbers, codes = prepare(config, features), {}
    for column, (name, format) in enumerate(prepared_record(config).fields):
        values = numbers[:, column] - (SHIFT_MIN if format == SHIFT else 0)
        codes[name] = (values & ((1 << format.width) - 1)).astype(np.uint64)
    return codes


def featured_rows(config: Config, features: Codes, entries: Entries) -> np.ndarray:
    """Each group's splats and its end."""
    lengths = np.diff(entries.start)
    group = np.repeat(np.arange(len(lengths)), lengths)
    place = np.arange(len(entries.splat)) + group  # an end behind each group
    total = len(entries.splat) + len(lengths)
    index, mask, end = (
        np.zeros(total, np.int64),
        np.zeros(total, np.uint64),
        np.ones(total, np.uint64),
    )
    index[place], mask[place], end[place] = entries.splat, entries.mask, 0
    splat = {
        name: codes[index].astype(np.uint64) if len(codes) else np.zeros(total, np.uint64)
        for name, codes in features.items()
    }
    return featured_record(config).pack({"splat": splat, "mask": mask, "end": end})


def place_rows(config: Config, groups: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Rows of the groups' places."""
    _, columns = group_grid(config, *size)
    row, column = (part.astype(np.uint64) for part in np.divmod(groups, columns))
    return position_record(config).pack({"column": column, "row": row})


def block_places(config: Config, rasterizer: int, groups: np.ndarray, size: tuple[int, int]):
    """Column and row [N, 2] of a rasterizer's blocks within the image, group after group."""
    _, columns = group_grid(config, *size)
    tiles = np.arange(config.group**2)
    own = np.array(owned(config, rasterizer))
    row, column = np.divmod(groups, columns)
    places = [
        np.broadcast_arrays(
            ((first[:, None] * config.group + inner[None, :]) * BLOCKS)[:, :, None] + block,
            np.zeros((len(groups), len(tiles), len(own)), int),
        )[0].ravel()
        for first, inner, block in (
            (column, tiles % config.group, own % BLOCKS),
            (row, tiles // config.group, own // BLOCKS),
        )
    ]
    found = np.stack(places, axis=1)
    return found[(found * BLOCK < np.array(size)).all(axis=1)]


@dataclass(frozen=True, eq=False)
class Run:
    """A run of some groups, and the golden model's picture."""

    result: Result
    golden: Raster
    differing: int  # blocks
    blocks: int
    counters: dict[str, int]


def run_groups(
    simulation: Simulation,
    config: Config,
    features: Codes,
    entries: Entries,
    size: tuple[int, int],
    groups: np.ndarray | None = None,
    background: tuple[int, int, int] = (0, 0, 0),
    **options,
) -> Run:
    """Run `Watched` on some groups of an image, or on all of them."""
    golden = rasterize(config, features, entries, size, background)
    if groups is None:
        groups = np.arange(np.prod(group_grid(config, *size)))
    bits = colour_format(config).width
    places = [block_places(config, k, groups, size) for k in range(config.rasterizers)]
    result = simulation.run(
        {
            "i": featured_rows(config, features, entries.of(groups)),
            "positions": place_rows(config, groups, size),
        },
        constants={
            "width": size[0],
            "height": size[1],
            "background": sum(code << k * bits for k, code in enumerate(background)),
            "clear": 0,
        },
        expected={f"o__{k}": len(found) for k, found in enumerate(places)},
        **options,
    )
    assert result.finished, result.stopped
    differing = 0
    for number, found in enumerate(places):
        codes = pixels_record(config).unpack(result.outputs[f"o__{number}"])
        assert len(codes["column"]) == len(found)
        assert (np.stack([codes["column"], codes["row"]], axis=1) == found).all()
        differing += differing_blocks(codes["pixels"], golden.pixels, found)
    counted = counters(counters_of(config), result.ports["counters"])
    return Run(result, golden, differing, sum(map(len, places)), counted)


def differing_blocks(blocks: np.ndarray, pixels: np.ndarray, places: np.ndarray) -> int:
    """The number of blocks [N, 16, 3] differ from an image [H, W, 3] at their places [N, 2]."""
    height, width = pixels.shape[:2]
    padded = np.zeros((height + BLOCK, width + BLOCK, 3), np.uint8)
    padded[:height, :width] = pixels
    step = np.arange(BLOCK)
    y = places[:, 1, None, None] * BLOCK + step[None, :, None]
    x = places[:, 0, None, None] * BLOCK + step[None, None, :]
    inside = ((y < height) & (x < width))[..., None]
    found = blocks.reshape(-1, BLOCK, BLOCK, 3)
    return int(
        ((found != padded[np.minimum(y, height), np.minimum(x, width)]) & inside)
        .any((1, 2, 3))
        .sum()
    )


@cache
def simulation(config: Config) -> Simulation:
    """Stage 3, compiled."""
    return Simulation(Watched(config), samples=("live", "full", "empty"))


@cache
def prepare_simulation(config: Config) -> Simulation:
    return Simulation(Prepare(config))


assert TILE % BLOCK == 0
