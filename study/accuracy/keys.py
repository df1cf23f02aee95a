"""Narrower depth keys: ways to make keys, and entries in their order."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.golden.raster import Entries
from splatcore.golden.reference import Splats
from splatcore.spec.config import DEFAULT

FRACTIONS = (10, 12, 14, 16, 18, 20)  # fraction bits of depths whose full codes are the keys
REBASED = (15, 18)  # bits of keys relative to the nearest entry of each group
WINDOWED = 16  # fraction bits of the depth codes that relative keys are taken from
FRAME_BITS = 15  # bits of keys relative to the nearest splat of the frame

Keys = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(depths of all splats [M], the entries' splats [N], their groups [N]) → keys of entries [N]."""


def depth_codes(depth: np.ndarray, fraction: int = WINDOWED) -> np.ndarray:
    """Encode depths as floats with `fraction` fraction bits; codes rise with depth."""
    return replace(DEFAULT.depth, fraction=fraction).encode(depth).astype(np.int64)


def window(codes: np.ndarray, part: np.ndarray, bits: int) -> np.ndarray:
    """Codes [N] minus the minimum of their part, shifted right until the part fits `bits` bits.

    part: [N] sorted, number of the part that each code belongs to
    """
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    counts = np.diff(starts, append=len(codes))
    steps = codes - np.repeat(np.minimum.reduceat(codes, starts), counts)
    _, length = np.frexp(np.maximum.reduceat(steps, starts))  # of the largest, in bits
    return steps >> np.repeat(np.maximum(length.astype(np.int64) - bits, 0), counts)


def whole(fraction: int) -> Keys:
    """Keys that are full codes with `fraction` fraction bits."""
    return lambda depth, splat, group: depth_codes(depth, fraction)[splat]


def rebased(bits: int) -> Keys:
    """Keys of `bits` bits relative to the nearest entry of each group."""
    return lambda depth, splat, group: window(depth_codes(depth)[splat], group, bits)


def of_the_frame(bits: int) -> Keys:
    """Keys of `bits` bits relative to the nearest splat of the frame."""
    return lambda depth, splat, group: window(depth_codes(depth), np.zeros_like(depth), bits)[splat]


EXACT_ORDER = "exact depth"

WAYS: dict[str, Keys] = (
    {EXACT_ORDER: lambda depth, splat, group: depth[splat]}
    | {f"{fraction} fraction bits": whole(fraction) for fraction in FRACTIONS}
    | {f"{bits} bits, by group": rebased(bits) for bits in REBASED}
    | {f"{FRAME_BITS} bits, by frame": of_the_frame(FRAME_BITS)}
)
"""Ways to make keys, by name."""


def reordered(keys: Keys, splats: Splats, entries: Entries) -> tuple[Entries, float]:
    """Sort entries by keys; return them and the share of neighbours that changed places.

    Entries with equal keys stay in the order of their Gaussians, in which they reach the sorter.
    """
    group = np.repeat(np.arange(len(entries.start) - 1), np.diff(entries.start))
    splat = entries.splat.astype(np.int64)
    key = keys(splats.depth, splat, group)
    order = np.lexsort((splats.index[splat], key, group))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    changed = (place[1:] < place[:-1]).sum()  # never across groups, which stay in order
    share = float(changed / max((group[1:] == group[:-1]).sum(), 1))
    return Entries(entries.start, entries.splat[order], entries.mask[order]), share
