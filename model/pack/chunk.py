"""Positions on the model's grid: Morton order, chunks of 256, octants, offsets.

This file computes the fields that `spec.memory` defines. Floaters have chunks of their own at the
model's end (`model.pack.floaters`).
"""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.model.pack.floaters import bound_exponent
from splatcore.spec import memory
from splatcore.spec.scene import batches
from splatcore.spec.threads import in_threads

GRID_BITS = memory.ORIGIN_BITS - 2
"""Bits of a coordinate's magnitude on the grid: a sum of two coordinates does not overflow."""

NO_FLOATERS = np.zeros(0, np.int64)

PER_CHUNK = ("origin", "shift", "octant_end", "extent")
"""Fields of `Chunks` with one row per chunk."""

MORTON_BITS = 21  # bits per axis in one 64-bit Morton code


@dataclass(frozen=True, eq=False)
class Chunks:
    """Positions of N Gaussians in C chunks, in stored order."""

    order: np.ndarray  # [N] index of the Gaussian that is stored in each place
    padding: np.ndarray  # [N] bool: a copy that only fills the last chunk before the floaters
    exponent: int  # the grid's step is 2^exponent scene units
    origin: np.ndarray  # [C, 3] int64, grid steps
    shift: np.ndarray  # [C, 3] offsets are in units of 2^shift grid steps
    octant_end: np.ndarray  # [C, 7] number of the chunk's Gaussians up to that octant's end
    extent: np.ndarray  # [C, 3] largest offset >> EXTENT_SHIFT
    bits: int  # stored bits of an offset, without the top bit, which the octant holds
    stored: np.ndarray  # [N, 3] uint16, these bits

    def __getitem__(self, rows: slice) -> "Chunks":
        """The chunks of some Gaussians, whole chunks."""
        of = slice(rows.start // memory.CHUNK, memory.chunk_count(rows.stop))
        by_chunk = {name: getattr(self, name)[of] for name in PER_CHUNK}
        by_place = {name: getattr(self, name)[rows] for name in ("order", "padding", "stored")}
        return replace(self, **by_chunk, **by_place)


def chunk_positions(
    position: np.ndarray, bits: int = memory.STORED_BITS, floaters: np.ndarray = NO_FLOATERS
) -> Chunks:
    """Divide Gaussians into chunks.

    position: [N, 3] finite, scene units
    bits: stored bits of each offset
    floaters: [F] indices of the floaters, in the order in which they are stored after all others
    """
    count = len(position)
    exponent = max(bound_exponent(position) - GRID_BITS, -memory.EXPONENT_MAX)
    grid = np.empty((count, 3), np.int64)
    for rows in batches(count):
        grid[rows] = np.rint(np.ldexp(position[rows], -exponent))
    near = np.delete(np.arange(count), floaters) if len(floaters) else slice(None)
    order = morton_order(grid[near])
    order = near[order] if len(floaters) else order
    filling = order[:0]
    if len(floaters):  # fill the last chunk before the floaters with copies of its Gaussians
        filling = np.resize(order[-memory.CHUNK :], -len(order) % memory.CHUNK)
    padding = np.repeat([False, True, False], [len(order), len(filling), len(floaters)])
    order = np.concatenate([order, filling, floaters]) if len(floaters) else order

    count, chunks = len(order), memory.chunk_count(len(order))
    origin, step, extent = (np.zeros((chunks, 3), np.int64) for _ in range(3))
    octant_end = np.zeros((chunks, memory.OCTANTS - 1), np.int64)
    stored = np.zeros((count, 3), np.uint16)
    found = in_threads(lambda rows: divided(grid[order[rows]], bits), count)
    for rows, batch in zip(batches(count), found, strict=True):
        own = slice(rows.start // memory.CHUNK, memory.chunk_count(rows.stop))
        within, stored[rows], origin[own], step[own], octant_end[own], extent[own] = batch
        order[rows], padding[rows] = order[rows][within], padding[rows][within]
    return Chunks(order, padding, exponent, origin, step, octant_end, extent, bits, stored)


def divided(grid: np.ndarray, bits: int) -> tuple[np.ndarray, ...]:
    """Divide a batch of points [N, 3] on the grid, whole chunks, into octants.

    Returns the order [N] within the chunks, and the stored bits, origins, shifts, ends of octants
    and extents as in `Chunks`.
    """
    of = np.arange(len(grid)) // memory.CHUNK  # [N] chunk of each place
    starts = np.arange(0, len(grid), memory.CHUNK)
    origin = np.minimum.reduceat(grid, starts, axis=0)
    highest = np.maximum.reduceat(grid, starts, axis=0)
    zeros = memory.STORED_BITS - bits  # low bits of an offset that are not stored
    step = np.maximum(smallest_shift(highest - origin, bits + 1), zeros)  # of stored bits, as shift
    offset = (grid - origin[of] + half(step)[of]) >> step[of]

    octant = of * memory.OCTANTS + (offset >> bits) @ np.array([1, 2, 4])  # [N]
    within = np.argsort(octant, kind="stable")
    counts = np.bincount(octant, minlength=len(starts) * memory.OCTANTS)
    octant_end = np.cumsum(counts.reshape(-1, memory.OCTANTS), axis=1)[:, :-1]
    extent = (highest - origin + half(step)) >> step << zeros >> memory.EXTENT_SHIFT
    stored = offset[within] & ((1 << bits) - 1)
    return within, stored, origin, step - zeros, octant_end, extent


def half(shift: np.ndarray) -> np.ndarray:
    """Half a step of offsets shifted by `shift`: adding it before the shift rounds to nearest."""
    return np.left_shift(1, shift) >> 1


def smallest_shift(span: np.ndarray, bits: int) -> np.ndarray:
    """Smallest shift with which offsets up to `span` (int64 ≥ 0), rounded, fit in `bits` bits."""
    _, length = np.frexp(span.astype(np.float64))  # bit length; spans are below 2^53
    shift = np.maximum(length - bits, 0).astype(np.int64)
    return shift + ((span + half(shift)) >> shift >> bits)


def morton_order(grid: np.ndarray) -> np.ndarray:
    """Order [N] of integer points [N, 3] along the Morton (Z) curve; stable for equal points."""
    corner = grid.min(axis=0, initial=1 << memory.ORIGIN_BITS)  # initial value: if no points
    high, low = np.empty((2, len(grid)), np.uint64)
    below = memory.ORIGIN_BITS - MORTON_BITS

    def spread(rows: slice):
        point = (grid[rows] - corner).astype(np.uint64)
        high[rows], low[rows] = interleave(point >> below), interleave(point & ((1 << below) - 1))

    for _ in in_threads(spread, len(grid)):
        pass
    order = np.argsort(high, kind="stable")
    high = high[order]
    tied = np.zeros(len(grid), bool)  # high codes equal to a neighbour's: the low ones decide
    tied[1:] = high[1:] == high[:-1]
    tied[:-1] |= tied[1:]
    some = order[tied]
    order[tied] = some[np.lexsort((low[some], high[tied]))]
    return order


def interleave(point: np.ndarray) -> np.ndarray:
    """Morton codes [N] of points [N, 3] of 21 bits: bit k of axis a becomes bit 3·k + a.

    Bits are spread by halving blocks, with the usual masks of 3D Morton codes.
    """
    code = point.astype(np.uint64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        code = (code | code << shift) & mask
    return code[:, 0] | code[:, 1] << 1 | code[:, 2] << 2
