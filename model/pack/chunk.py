"""Positions on the model's grid: Morton order, chunks of 256, octants, offsets; and back.

The bits are defined in `spec.memory`; this file computes them. Floaters share chunks of their own
at the model's end (`model.pack.floaters`).
"""

from dataclasses import dataclass

import numpy as np

from splatcore.model.pack.floaters import bound_exponent
from splatcore.spec import memory

GRID_BITS = memory.ORIGIN_BITS - 2
"""Bits of a coordinate's magnitude on the grid: sums of two coordinates keep clear of the sign."""

NO_FLOATERS = np.zeros(0, np.int64)

MORTON_BITS = 21  # bits of each axis that one 64-bit Morton code interleaves


@dataclass(frozen=True, eq=False)
class Chunks:
    """Positions [N, 3] as they are stored, in the order in which they are stored."""

    order: np.ndarray  # [N] index of the Gaussian that is stored in each place
    padding: np.ndarray  # [N] bool: a copy that only fills the last chunk before the floaters
    exponent: int  # the grid's step is 2^exponent scene units
    origin: np.ndarray  # [C, 3] int64, grid steps
    shift: np.ndarray  # [C, 3]
    octant_end: np.ndarray  # [C, 7] Gaussians of the chunk up to that octant
    extent: np.ndarray  # [C, 3] largest offset >> EXTENT_SHIFT
    bits: int  # of an offset that are stored, without its top one
    stored: np.ndarray  # [N, 3] these bits


def chunk_positions(
    position: np.ndarray, bits: int = memory.STORED_BITS, floaters: np.ndarray = NO_FLOATERS
) -> Chunks:
    """Cut finite positions [N, 3] (scene units) into chunks, storing `bits` of each offset.

    floaters: indices [F], in the order in which they are stored behind all others.
    """
    near = np.delete(np.arange(len(position)), floaters)
    exponent = max(bound_exponent(position) - GRID_BITS, -memory.EXPONENT_MAX)
    grid = np.rint(np.ldexp(position, -exponent)).astype(np.int64)  # [N, 3]
    order = near[morton_order(grid[near])]
    filling = order[:0]
    if len(floaters):  # the last chunk holds the last 256 that are near, some of them again
        filling = np.resize(order[-memory.CHUNK :], -len(order) % memory.CHUNK)
    padding = np.repeat([False, True, False], [len(order), len(filling), len(floaters)])
    order = np.concatenate([order, filling, floaters])
    grid = grid[order]

    of = np.arange(len(grid)) // memory.CHUNK  # [N] the chunk of each place
    starts = np.arange(memory.chunk_count(len(grid))) * memory.CHUNK
    origin = np.minimum.reduceat(grid, starts, axis=0) if len(starts) else grid
    highest = np.maximum.reduceat(grid, starts, axis=0) if len(starts) else grid
    zeros = memory.STORED_BITS - bits  # low bits of an offset that are not stored
    step = np.maximum(smallest_shift(highest - origin, bits + 1), zeros)  # of what is, as a shift
    offset = (grid - origin[of] + half(step)[of]) >> step[of]

    octant = (offset >> bits) @ np.array([1, 2, 4])  # [N]
    within = np.argsort(of * memory.OCTANTS + octant, kind="stable")
    counts = np.bincount(of * memory.OCTANTS + octant, minlength=len(starts) * memory.OCTANTS)
    octant_end = np.cumsum(counts.reshape(-1, memory.OCTANTS), axis=1)[:, :-1]
    extent = (highest - origin + half(step)) >> step << zeros >> memory.EXTENT_SHIFT
    stored = offset[within] & ((1 << bits) - 1)
    order, padding = order[within], padding[within]
    return Chunks(order, padding, exponent, origin, step - zeros, octant_end, extent, bits, stored)


def half(shift: np.ndarray) -> np.ndarray:
    """Half a step of offsets shifted by `shift`: added before the shift it rounds to nearest."""
    return np.left_shift(1, shift) >> 1


def smallest_shift(span: np.ndarray, bits: int) -> np.ndarray:
    """Smallest shift for which offsets up to `span` (int64 ≥ 0), rounded, fit so many bits."""
    _, length = np.frexp(span.astype(np.float64))  # bit length; spans are below 2^53
    shift = np.maximum(length - bits, 0).astype(np.int64)
    return shift + ((span + half(shift)) >> shift >> bits)


def morton_order(grid: np.ndarray) -> np.ndarray:
    """Order [N] of integer points [N, 3] along the Morton (Z) curve; equal points keep theirs."""
    corner = grid.min(axis=0, initial=1 << memory.ORIGIN_BITS)  # the initial value is for no points
    point = (grid - corner).astype(np.uint64)
    high = interleave(point >> (memory.ORIGIN_BITS - MORTON_BITS))
    low = interleave(point & ((1 << (memory.ORIGIN_BITS - MORTON_BITS)) - 1))
    return np.lexsort((low, high))


def interleave(point: np.ndarray) -> np.ndarray:
    """Morton codes [N] of points [N, 3] of 21 bits: bit k of axis a goes to bit 3·k + a.

    The bits are spread by halving blocks (Morton 1966; the magic masks of 3D codes).
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
