"""Stage 3 in simulation: random splats, input rows, and output rows by the golden model."""

from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Cat, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from splatcore.golden.exact import encode
from splatcore.golden.raster import Entries, Raster, rasterize
from splatcore.golden.setup import prepare
from splatcore.hdl.raster.job import job_layout
from splatcore.hdl.raster.raster import Raster as Hardware
from splatcore.hdl.raster.raster import counted as counters_of
from splatcore.sim.rtl.streams import Result
from splatcore.spec import raster
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, POSITION
from splatcore.spec.group import group_grid
from splatcore.spec.memory import OPACITY
from splatcore.spec.record import Codes
from tb.helpers.parts import forward
from tb.helpers.runs import compiled, counters


class Watched(wiring.Component):
    """Stage 3 with the state of its queues: of splats, pairs and finished blocks.

    Members, in addition to those of `hdl.raster.raster.Raster`
        full, empty: one bit per queue: splats, each rasterizer's pairs, each rasterizer's finished
            blocks (full if all places are in use)
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
        finished = [part.finished.taken for part in inner.rasterizers]
        m.d.comb += [
            self.full.eq(
                Cat(
                    *(queue.level == queue.depth for queue in (inner.splats, *pairs)),
                    *(taken.all() for taken in finished),
                )
            ),
            self.empty.eq(
                Cat(
                    *(queue.level == 0 for queue in (inner.splats, *pairs)),
                    *(~taken.any() for taken in finished),
                )
            ),
        ]
        return m


def job(config: Config, size: tuple[int, int], background: tuple[int, ...]) -> int:
    """Value of the port `job` of stage 3."""
    colour = dict(zip(raster.COLOURS, background, strict=True))
    fields = {"width": int(size[0]), "height": int(size[1]), "background": colour}
    return job_layout(config).const(fields).as_bits()


def random_features(config: Config, count: int, size: tuple[int, int], seed: int) -> Codes:
    """Random splats of all shapes on and around an image: points, needles, walls, far centres."""
    rng = np.random.default_rng(seed)
    far = np.where(rng.random(count) < 0.1, rng.choice([10, 100, 1000, 1e5], count), 1.0)
    centre = rng.uniform(-0.2, 1.2, (count, 2)) * size * far[:, None]
    xx, yy = 0.3 + 4.0 ** rng.uniform(-3, 9, (2, count)) * np.maximum(far, 1)
    xy = np.sqrt((xx - 0.3) * (yy - 0.3)) * rng.choice([0, 1, -1, 0.5, 0.999], count)
    schur = xx - xy**2 / yy
    codes = rng.integers(0, 1 << rng.integers(1, OPACITY.width + 1, count))
    opacity = 2.0 ** -OPACITY.decode(codes.astype(np.uint8))
    colour = rng.choice([0, 0.3, 1, 2, 8], (count, 3)) * rng.random((count, 3))
    return encode(config, centre, 1 / schur, xy / yy, 1 / yy, opacity, colour)


def opaque_features(config: Config, count: int, size: tuple[int, int]) -> Codes:
    """Splats that cover an image; two of them are opaque."""
    features = random_features(config, count, size, 5)
    features["opacity"][:] = 0
    for name in ("across", "along"):
        features[name][:] = FACTOR.encode(np.ldexp(1e-6, FACTOR_SCALE))
    features["u"][:] = features["v"][:] = POSITION.encode(16.0)
    features["scale"][:] = 0
    return features


def prepared_codes(config: Config, features: Codes) -> Codes:
    """Codes of `prepared_record` for codes of features."""
    numbers, codes = prepare(config, features), {}
    for name, format in raster.prepared_record(config).fields:
        values = numbers[name] - (raster.SHIFT_MIN if format == raster.SHIFT else 0)
        codes[name] = (values & ((1 << format.width) - 1)).astype(np.uint64)
    return codes


def featured_rows(config: Config, features: Codes, entries: Entries) -> np.ndarray:
    """Rows of each group's splats and its end."""
    lengths = np.diff(entries.start)
    group = np.repeat(np.arange(len(lengths)), lengths)
    place = np.arange(len(entries.splat)) + group  # an end behind each group
    total = len(entries.splat) + len(lengths)
    index, mask = np.zeros((2, total), np.uint64)
    index[place], mask[place] = entries.splat, entries.mask
    end = ~np.isin(np.arange(total), place)
    splat = {
        name: codes[index].astype(np.uint64) if len(codes) else np.zeros(total, np.uint64)
        for name, codes in features.items()
    }
    return raster.featured_record(config).pack({"splat": splat, "mask": mask, "end": end})


def block_places(config: Config, rasterizer: int, groups: np.ndarray, size: tuple[int, int]):
    """Column and row [N, 2] of a rasterizer's blocks in the order of output, group after group."""
    _, columns = group_grid(config, *size)
    own = np.array(raster.owned(config, rasterizer))
    blocks = np.array([raster.nth_block(config, n) for n in range(raster.block_count(config))])
    tile, block = np.divmod(blocks, len(own))
    row, column = np.divmod(groups, columns)
    places = [
        ((first[:, None] * config.group + inner) * raster.BLOCKS + number).ravel()
        for first, inner, number in (
            (column, tile % config.group, own[block] % raster.BLOCKS),
            (row, tile // config.group, own[block] // raster.BLOCKS),
        )
    ]
    return np.stack(places, axis=1)


@dataclass(frozen=True, eq=False)
class Run:
    """A run of some groups and its comparison with the golden model's picture."""

    result: Result
    golden: Raster
    differing: int  # number of wrong blocks
    blocks: int  # number of blocks
    counters: dict[str, int]


def run_groups(
    config: Config,
    features: Codes,
    entries: Entries,
    size: tuple[int, int],
    groups: np.ndarray | None = None,
    background: tuple[int, int, int] = (0, 0, 0),
    **options,
) -> Run:
    """Run `Watched` on some groups of an image; default: all."""
    golden = rasterize(config, features, entries, size, background)
    if groups is None:
        groups = np.arange(np.prod(group_grid(config, *size)))
    places = [block_places(config, k, groups, size) for k in range(config.rasterizers)]
    row, column = np.divmod(groups.astype(np.uint64), np.uint64(group_grid(config, *size)[1]))
    result = compiled(Watched, config, samples=("live", "full", "empty")).run(
        {
            "i": featured_rows(config, features, entries.of(groups)),
            "positions": raster.position_record(config).pack({"column": column, "row": row}),
        },
        constants={
            "job": job(config, size, background),
            "clear": 0,
        },
        expected={f"o__{k}": len(found) for k, found in enumerate(places)},
        **options,
    )
    assert result.finished, result.stopped
    differing = 0
    for number, found in enumerate(places):
        codes = raster.pixels_record(config).unpack(result.outputs[f"o__{number}"])
        assert len(codes["pixels"]) == len(found)
        differing += differing_blocks(codes["pixels"], golden.pixels, found)
    counted = counters(counters_of(config), result.ports["counters"])
    return Run(result, golden, differing, sum(map(len, places)), counted)


def differing_blocks(blocks: np.ndarray, pixels: np.ndarray, places: np.ndarray) -> int:
    """Number of blocks [N, 16, 3] that differ from an image [H, W, 3] at their places [N, 2]."""
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


assert TILE % BLOCK == 0
