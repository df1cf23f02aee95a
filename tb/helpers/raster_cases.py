"""Cases of stage 3 and its steps: rows of each step's streams, from the golden model."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from splatcore.golden.blend import around_block, twice_highest
from splatcore.golden.exact import encode
from splatcore.golden.raster import Entries, rasterize
from splatcore.golden.setup import Quadratic, prepare, quadratic
from splatcore.spec import raster
from splatcore.spec.colour import unscaled_colour_format
from splatcore.spec.config import TINY
from splatcore.spec.convention import BLOCK
from splatcore.spec.group import group_grid
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Codes, Record
from tb.helpers.raster_rows import (
    block_places,
    featured_rows,
    job,
    opaque_features,
    prepared_codes,
    random_features,
)

LEVELS = len(raster.mark_min(TINY))
ALL_BLOCKS = Array(Bits(raster.BLOCKS**2), LEVELS)


@dataclass(frozen=True, eq=False)
class Case:
    """Splats in the lists of an image's groups, on TINY.

    features: codes [M] of `feature_record`
    entries: of the groups' lists
    size: of the image
    background: codes of a colour
    """

    features: Codes
    entries: Entries
    size: tuple[int, int]
    background: tuple[int, int, int] = (0, 0, 0)

    @property
    def groups(self) -> np.ndarray:
        return np.arange(np.prod(group_grid(TINY, *self.size)))

    @property
    def constants(self) -> dict[str, int]:
        return {"job": job(TINY, self.size, self.background)}

    def positions(self) -> np.ndarray:
        """Rows of `position_record`."""
        row, column = np.divmod(self.groups, group_grid(TINY, *self.size)[1])
        codes = {"column": column.astype(np.uint64), "row": row.astype(np.uint64)}
        return raster.position_record(TINY).pack(codes)

    def featured(self) -> np.ndarray:
        """Rows of `featured_record`."""
        return featured_rows(TINY, self.features, self.entries)

    def readied(self) -> np.ndarray:
        """Rows of `readied_record`."""
        codes = raster.featured_record(TINY).unpack(self.featured())
        splat = prepared_codes(TINY, codes["splat"])
        return raster.readied_record(TINY).pack(codes | {"splat": splat})

    def blocks(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A rasterizer's finished blocks, rows of `pixels_record`, and ones for bits that matter:
        pixels in the image."""
        golden = rasterize(TINY, self.features, self.entries, self.size, self.background)
        (width, height), record = self.size, raster.pixels_record(TINY)
        whole, inside = np.zeros((2, height + 64, width + 64, 3), np.uint8)
        whole[:height, :width], inside[:height, :width] = golden.pixels, 255
        x, y = block_places(TINY, number, self.groups, self.size).T * BLOCK
        step = np.arange(BLOCK)
        at = y[:, None, None] + step[:, None], x[:, None, None] + step
        return tuple(
            record.pack({"pixels": image[at].reshape(len(x), -1, 3)}) for image in (whole, inside)
        )


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of splats and tiles, and ends of groups, in order, in stage 3's records.

    pairs: codes [N] of `pair_record`
    end: [N] whether it is a group's end
    far: [N] whether the splat is too far away
    coefficients: [N, 6] of E around the tile
    """

    pairs: Codes
    end: np.ndarray
    far: np.ndarray
    coefficients: np.ndarray

    @classmethod
    def of(cls, case: Case, live: int = ~0) -> "Pairs":
        """All pairs of a case. live: mask of live tiles."""
        features = raster.featured_record(TINY).unpack(case.featured())
        numbers = prepare(TINY, features["splat"])
        index, column, row, tile = np.array(list(_places(case, live))).T
        end = features["end"][index] == 1
        coefficients, far = np.zeros((len(index), 6), np.int64), np.zeros(len(index), np.uint64)
        for k, (splat, x, y) in enumerate(zip(index, column, row, strict=True)):
            coefficients[k], near = quadratic(numbers[splat], x, y, TINY.exponent_fraction)
            far[k] = not near
        splats = prepared_codes(TINY, features["splat"])
        pairs = {"splat": {name: codes[index] for name, codes in splats.items()}}
        places = {"column": column, "row": row, "tile": tile, "end": end}
        pairs |= {name: codes.astype(np.uint64) for name, codes in places.items()}
        return cls(pairs, end, far, coefficients)

    def pair_rows(self) -> np.ndarray:
        """Rows of `pair_record`."""
        return raster.pair_record(TINY).pack(self.pairs)

    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of `around_record`, and ones for bits that matter: E unless the splat is too far
        away; only `end` at a group's end."""
        record = raster.around_record(TINY)
        codes = self._carried() | {"far": self.far}
        ones = {
            name: {inner: _ones(part, ~self.end & (self.far == 0)) for inner, part in format.fields}
            if isinstance(format, Record)
            else _ones(format, ~self.end | (name == "end"))
            for name, format in record.fields
        }
        return record.pack(codes), record.pack(ones)

    def marked(self) -> np.ndarray:
        """Rows of `marked_record` with all blocks of a tile."""
        codes = self._carried() | {"blocks": self.blocks()}
        return raster.marked_record(TINY, ALL_BLOCKS).pack(codes)

    def owned(self, number: int) -> np.ndarray:
        """Rows of the pairs that have blocks of a rasterizer, with these blocks only."""
        own = raster.owned(TINY, number)
        blocks = self.blocks()
        mine = sum(((blocks >> block) & 1) << k for k, block in enumerate(own))
        record = raster.marked_record(TINY, Array(Bits(len(own)), LEVELS))
        rows = record.pack(self._carried() | {"blocks": mine})
        return rows[self.end | (mine[:, 0] != 0)]

    def blocks(self) -> np.ndarray:
        """Blocks of the tile that reach each level [N, levels], one bit per block."""
        found = np.zeros((len(self.end), LEVELS), np.uint64)
        for k, coefficients in enumerate(self.coefficients):
            if self.far[k]:
                continue
            for block in range(raster.BLOCKS**2):
                q, p = (raster.STEPS[place] for place in divmod(block, raster.BLOCKS))
                most = twice_highest(around_block(Quadratic(*coefficients), p, q))
                for level, least in enumerate(raster.mark_min(TINY)):
                    found[k, level] |= np.uint64(int(most >= 2 * least) << block)
        return found

    def _carried(self) -> Codes:
        names = (name for name, _ in raster.quadratic_record(TINY).fields)
        found = dict(zip(names, self.coefficients.T, strict=True))
        codes = {
            name: (found[name] & ((1 << format.width) - 1)).astype(np.uint64)
            for name, format in raster.quadratic_record(TINY).fields
        }
        colours = {name: self.pairs["splat"][name] for name in raster.COLOURS}
        return {"quadratic": codes, "tile": self.pairs["tile"], "end": self.pairs["end"]} | colours


def exactly_reached(pairs: Pairs) -> Pairs:
    """Change e of each pair so that 2·E at a block is at the bound of some level, or next to it.

    e changes 2·E by even numbers, so the bound is hit exactly only if the slopes' sum is even.
    """
    rng, found = np.random.default_rng(0), pairs.coefficients.copy()
    limit = 1 << raster.EXPONENT_INTEGER + TINY.exponent_fraction
    for k, coefficients in enumerate(found):
        p, q = rng.choice(raster.STEPS, 2)
        most = twice_highest(around_block(Quadratic(*coefficients), p, q))
        least = rng.choice(raster.mark_min(TINY))
        e = coefficients[0] + (2 * least - most >> 1) + k % 3 - 1
        found[k, 0] = np.clip(e, -limit, limit - 1)
    return replace(pairs, coefficients=found)


def _places(case: Case, live: int) -> Iterator[tuple[int, int, int, int]]:
    """For each pair its row number in `featured_record`, column and row of its tile in the image,
    and its tile in the group; a group's end has the group's first tile."""
    side, start, number = TINY.group, case.entries.start, 0
    columns = group_grid(TINY, *case.size)[1]
    for group in case.groups:
        row, column = divmod(int(group), columns)
        for mask in case.entries.mask[start[group] : start[group + 1]]:
            for tile in range(side**2):
                if int(mask) & live & 1 << tile:
                    yield number, column * side + tile % side, row * side + tile // side, tile
            number += 1
        yield number, column * side, row * side, 0
        number += 1


def _ones(format, where: np.ndarray) -> np.ndarray:
    return np.where(where, np.uint64((1 << format.width) - 1), np.uint64(0))


def mixed(count: int, size: tuple[int, int], seed: int = 0, **options) -> Case:
    """Splats of all shapes in random tiles, whether they reach them or not."""
    return _drawn(random_features(TINY, count, size, seed), size, seed, **options)


def extreme(count: int, size: tuple[int, int], seed: int = 0) -> Case:
    """Splats as thin, large, far and bright as stage 1 can output; the brightest background."""
    rng = np.random.default_rng(seed)
    centre = rng.choice([0, 16, 64, 1e3, 1e5, 1e9, -1e3, -1e9], (count, 2))
    xx, yy = rng.choice([0.3, 1, 1e3, 1e6, 1e12], (2, count))
    xy = np.sqrt((xx - 0.3) * (yy - 0.3)) * rng.choice([0, 1, -1, 0.999], count)
    schur = xx - xy**2 / yy
    opacity = 2.0 ** -OPACITY.decode(rng.choice([0, 1, 128, 255], count).astype(np.uint8))
    colour = rng.choice([0, 1, unscaled_colour_format(TINY).max], (count, 3))
    features = encode(TINY, centre, 1 / schur, xy / yy, 1 / yy, opacity, colour)
    most = (1 << raster.colours(TINY)["red"].width) - 1
    return _drawn(features, size, seed, background=(most, 0, most))


def opaque(size: tuple[int, int]) -> Case:
    """Two splats per group that cover it; the second one ends all pixels."""
    groups = int(np.prod(group_grid(TINY, *size)))
    every = np.full(2 * groups, (1 << TINY.group**2) - 1)
    entries = Entries(np.arange(groups + 1) * 2, np.tile([0, 1], groups), every)
    return Case(opaque_features(TINY, 2, size), entries, size)


def nothing(size: tuple[int, int]) -> Case:
    """Groups without splats."""
    case = mixed(1, size)
    none = np.zeros(0, int)
    return Case(case.features, Entries(np.zeros(len(case.groups) + 1, int), none, none), size)


def _drawn(features: Codes, size: tuple[int, int], seed: int, **options) -> Case:
    rng, count = np.random.default_rng(seed), len(features["u"])
    groups = int(np.prod(group_grid(TINY, *size)))
    lengths = rng.multinomial(count, np.full(groups, 1 / groups))
    mask = rng.integers(1, 1 << TINY.group**2, count)
    start = np.concatenate([[0], np.cumsum(lengths)])
    entries = Entries(start, rng.integers(0, count, count), mask)
    return Case(features, entries, size, **options)


def by_kind(count: int) -> dict[str, Case]:
    """The cases for all steps."""
    whole, cut = (TINY.width_max, TINY.height_max), (61, 35)  # the latter ends within blocks
    return {
        "empty": nothing(cut),
        "full": mixed(count, cut, background=(100, 200, 300)),
        "saturated": extreme(count, whole),
        "opaque": opaque(cut),
    }
