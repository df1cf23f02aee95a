"""Stage 3: splats in the lists of groups, and finished blocks of the golden model's picture."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from amaranth.hdl import Cat, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from splatcore.golden import raster as golden
from splatcore.golden.exact import encode
from splatcore.golden.raster import Entries
from splatcore.golden.setup import prepare
from splatcore.hdl.raster.job import job_layout
from splatcore.hdl.raster.raster import Raster, counted
from splatcore.sim.rtl.streams import Result
from splatcore.spec import raster
from splatcore.spec.colour import unscaled_colour_format
from splatcore.spec.config import TINY, Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, POSITION
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.memory import OPACITY
from splatcore.spec.record import Codes
from splatcore.spec.work import pixel_bytes
from tb.helpers.parts import forward
from tb.helpers.runs import Case, compiled, counters


class Watched(wiring.Component):
    """Stage 3 with the state of its queues: of splats, pairs and finished blocks.

    Members, in addition to those of `hdl.raster.raster.Raster`
        full, empty: one bit per queue: splats, each rasterizer's pairs, each rasterizer's finished
            blocks (full if all places are in use)
    """

    def __init__(self, config: Config):
        self.inner = Raster(config)
        queues = Out(1 + 2 * config.rasterizers)
        members = dict(self.inner.signature.members)
        super().__init__(members | {"full": queues, "empty": queues})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        forward(m, self, inner)
        queues = [inner.splats, *(part.pairs for part in inner.rasterizers)]
        places = [part.finished.taken for part in inner.rasterizers]
        full = [queue.level == queue.depth for queue in queues]
        m.d.comb += self.full.eq(Cat(*full, *(taken.all() for taken in places)))
        empty = [queue.level == 0 for queue in queues]
        m.d.comb += self.empty.eq(Cat(*empty, *(~taken.any() for taken in places)))
        return m


@dataclass(frozen=True, eq=False)
class Run:
    """A run of some groups, whose blocks are the golden model's.

    blocks: number of blocks that came out
    """

    result: Result
    golden: golden.Raster
    blocks: int
    counters: dict[str, int]


@dataclass(frozen=True, eq=False)
class Lists:
    """Splats in the lists of an image's groups.

    features: codes [M] of `feature_record`
    entries: of the groups' lists
    size: of the image
    background: codes of a colour
    rgba: whether pixels have alpha; then there is no background
    chosen: the groups to render, in order; default: each group once
    """

    config: Config
    features: Codes
    entries: Entries
    size: tuple[int, int]
    background: tuple[int, int, int] = (0, 0, 0)
    rgba: bool = False
    chosen: np.ndarray | None = None

    @property
    def groups(self) -> np.ndarray:
        every = np.arange(np.prod(group_grid(self.config, *self.size)))
        return every if self.chosen is None else self.chosen

    @cached_property
    def golden(self) -> golden.Raster:
        """The golden model's picture of all groups."""
        return golden.rasterize(
            self.config, self.features, self.entries, self.size, self.background, self.rgba
        )

    @property
    def constants(self) -> dict[str, int]:
        colour = dict(zip(raster.COLOURS, self.background, strict=True))
        fields = {"width": self.size[0], "height": self.size[1], "background": colour}
        fields |= {"rgba": 1} if self.rgba else {}
        return {"job": job_layout(self.config).const(fields).as_bits()}

    def positions(self) -> np.ndarray:
        """Rows of `position_record`."""
        row, column = np.divmod(self.groups, group_grid(self.config, *self.size)[1])
        codes = {"column": column.astype(np.uint64), "row": row.astype(np.uint64)}
        return raster.position_record(self.config).pack(codes)

    def featured(self) -> np.ndarray:
        """Rows of `featured_record`: each group's splats and its end."""
        entries = self.entries.of(self.groups)
        lengths = np.diff(entries.start)
        group = np.repeat(np.arange(len(lengths)), lengths)
        place = np.arange(len(entries.splat)) + group  # an end behind each group
        total = len(entries.splat) + len(lengths)
        index, mask = np.zeros((2, total), np.uint64)
        index[place], mask[place] = entries.splat, entries.mask
        end = ~np.isin(np.arange(total), place)
        splat = {
            name: codes[index].astype(np.uint64) if len(codes) else np.zeros(total, np.uint64)
            for name, codes in self.features.items()
        }
        codes = {"splat": splat, "mask": mask, "end": end}
        return raster.featured_record(self.config).pack(codes)

    def readied(self) -> np.ndarray:
        """Rows of `readied_record`."""
        codes = raster.featured_record(self.config).unpack(self.featured())
        splat = prepared_codes(self.config, codes["splat"])
        return raster.readied_record(self.config).pack(codes | {"splat": splat})

    def blocks(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A rasterizer's finished blocks, rows of `pixels_record`, and ones for bits that matter:
        pixels in the image."""
        (width, height), record = self.size, raster.pixels_record(self.config)
        side = group_pixels(self.config)
        stored, known = pixel_bytes(self.config.rgba), pixel_bytes(self.rgba)
        whole, inside = np.zeros((2, height + side, width + side, stored), np.uint8)
        whole[:height, :width, :known], inside[:height, :width, :known] = self.golden.pixels, 255
        x, y = block_places(self.config, number, self.groups, self.size).T * BLOCK
        step = np.arange(BLOCK)
        at = y[:, None, None] + step[:, None], x[:, None, None] + step
        return tuple(
            record.pack({"pixels": image[at].reshape(len(x), -1, stored)})
            for image in (whole, inside)
        )

    def case(self) -> Case:
        """The case of the whole stage."""
        blocks = {f"o__{k}": self.blocks(k) for k in range(self.config.rasterizers)}
        return Case(
            {"i": self.featured(), "positions": self.positions()},
            {name: rows for name, (rows, _) in blocks.items()},
            self.constants | {"clear": 0},
            {name: care for name, (_, care) in blocks.items()},
        )

    def run(self, **options) -> Run:
        """Run `Watched`, and compare all blocks with the golden model's."""
        part = compiled(Watched, self.config, samples=("live", "full", "empty"))
        result = self.case().check(part, **options)
        values = counters(counted(self.config), result.ports["counters"])
        return Run(result, self.golden, sum(map(len, result.outputs.values())), values)


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


def prepared_codes(config: Config, features: Codes) -> Codes:
    """Codes of `prepared_record` for codes of features."""
    numbers, codes = prepare(config, features), {}
    for name, format in raster.prepared_record(config).fields:
        values = numbers[name] - (raster.SHIFT_MIN if format == raster.SHIFT else 0)
        codes[name] = (values & ((1 << format.width) - 1)).astype(np.uint64)
    return codes


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


def mixed(config: Config, count: int, size: tuple[int, int], seed: int = 0, **options) -> Lists:
    """Splats of all shapes in random tiles, whether they reach them or not."""
    return _drawn(config, random_features(config, count, size, seed), size, seed, **options)


def extreme(config: Config, count: int, size: tuple[int, int], seed: int = 0) -> Lists:
    """Splats as thin, large, far and bright as stage 1 can output; the brightest background."""
    rng = np.random.default_rng(seed)
    centre = rng.choice([0, 16, 64, 1e3, 1e5, 1e9, -1e3, -1e9], (count, 2))
    xx, yy = rng.choice([0.3, 1, 1e3, 1e6, 1e12], (2, count))
    xy = np.sqrt((xx - 0.3) * (yy - 0.3)) * rng.choice([0, 1, -1, 0.999], count)
    schur = xx - xy**2 / yy
    opacity = 2.0 ** -OPACITY.decode(rng.choice([0, 1, 128, 255], count).astype(np.uint8))
    colour = rng.choice([0, 1, unscaled_colour_format(config).max], (count, 3))
    features = encode(config, centre, 1 / schur, xy / yy, 1 / yy, opacity, colour)
    most = (1 << raster.colours(config)["red"].width) - 1
    return _drawn(config, features, size, seed, background=(most, 0, most))


def _drawn(config: Config, features: Codes, size: tuple[int, int], seed: int, **options) -> Lists:
    rng, count = np.random.default_rng(seed), len(features["u"])
    groups = int(np.prod(group_grid(config, *size)))
    lengths = rng.multinomial(count, np.full(groups, 1 / groups))
    start = np.concatenate([[0], np.cumsum(lengths)])
    mask = rng.integers(1, 1 << config.group**2, count)
    entries = Entries(start, rng.integers(0, count, count), mask)
    return Lists(config, features, entries, size, **options)


def opaque(config: Config, size: tuple[int, int], each: int = 2, **options) -> Lists:
    """`each` splats per group that cover it; the second one ends all pixels."""
    groups = int(np.prod(group_grid(config, *size)))
    every = np.full(each * groups, (1 << config.group**2) - 1)
    splats = np.arange(each * groups)
    entries = Entries(np.arange(groups + 1) * each, splats, every)
    features = opaque_features(config, each * groups, size)
    return Lists(config, features, entries, size, **options)


def nothing(config: Config, size: tuple[int, int], **options) -> Lists:
    """Groups without splats."""
    lists, none = mixed(config, 4, size, **options), np.zeros(0, int)
    return replace(lists, entries=Entries(np.zeros(len(lists.groups) + 1, int), none, none))


def by_kind(count: int) -> dict[str, Lists]:
    """Lists on TINY for all steps, by kind of case."""
    whole, cut = (TINY.width_max, TINY.height_max), (61, 35)  # the latter ends within blocks
    return {
        "empty": nothing(TINY, cut),
        "full": mixed(TINY, count, cut, background=(100, 200, 300)),
        "saturated": extreme(TINY, count, whole),
        "opaque": opaque(TINY, cut),
    }
