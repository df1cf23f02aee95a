"""Stage 3's steps on TINY: rows of each step's streams, from the golden model."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from splatcore.golden.setup import QUADRATIC, prepare, quadratic, twice_highest
from splatcore.spec import raster
from splatcore.spec.config import TINY
from splatcore.spec.group import group_grid
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Codes, Record
from tb.stages.raster import Lists, prepared_codes

LEVELS = len(raster.mark_min(TINY))
ALL_BLOCKS = Array(Bits(raster.BLOCKS**2), LEVELS)


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
    def of(cls, lists: Lists, live: int = ~0) -> "Pairs":
        """All pairs of lists. live: mask of live tiles."""
        features = raster.featured_record(TINY).unpack(lists.featured())
        numbers = prepare(TINY, features["splat"])
        index, column, row, tile = np.array(list(_places(lists, live))).T
        end = features["end"][index] == 1
        around, near = quadratic(TINY, numbers[index], column, row)
        coefficients, far = around.view(np.int64).reshape(-1, 6), (~near).astype(np.uint64)
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
        most = highest(self.coefficients)
        bits = np.uint64(1) << np.arange(raster.BLOCKS**2, dtype=np.uint64)
        for level, least in enumerate(raster.mark_min(TINY)):
            found[:, level] = ((most >= 2 * least) & (self.far[:, None] == 0)) @ bits
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


def highest(coefficients: np.ndarray) -> np.ndarray:
    """Bounds [N, 16] on twice the E of each block's pixels, from coefficients [N, 6]."""
    return twice_highest(np.ascontiguousarray(coefficients).view(QUADRATIC)[:, 0]).astype(np.int64)


def exactly_reached(pairs: Pairs) -> Pairs:
    """Change e of each pair so that 2·E at a block is at the bound of some level, or next to it.

    e changes 2·E by even numbers, so the bound is hit exactly only if the slopes' sum is even.
    """
    rng, found = np.random.default_rng(0), pairs.coefficients.copy()
    limit = 1 << raster.EXPONENT_INTEGER + TINY.exponent_fraction
    for k, most in enumerate(highest(found)):
        least = rng.choice(raster.mark_min(TINY))
        e = found[k, 0] + (2 * least - int(rng.choice(most)) >> 1) + k % 3 - 1
        found[k, 0] = np.clip(e, -limit, limit - 1)
    return replace(pairs, coefficients=found)


def _places(lists: Lists, live: int) -> Iterator[tuple[int, int, int, int]]:
    """For each pair its row number in `featured_record`, column and row of its tile in the image,
    and its tile in the group; a group's end has the group's first tile."""
    side, start, number = TINY.group, lists.entries.start, 0
    columns = group_grid(TINY, *lists.size)[1]
    for group in lists.groups:
        row, column = divmod(int(group), columns)
        for mask in lists.entries.mask[start[group] : start[group + 1]]:
            for tile in range(side**2):
                if int(mask) & live & 1 << tile:
                    yield number, column * side + tile % side, row * side + tile // side, tile
            number += 1
        yield number, column * side, row * side, 0
        number += 1


def _ones(format, where: np.ndarray) -> np.ndarray:
    return np.where(where, np.uint64((1 << format.width) - 1), np.uint64(0))
