"""Residual vector quantisation: a vector is the sum of one entry from each of a few codebooks.

Two stages of 128 entries come closer than one of 512 with half the memory: the first stage is
k-means on the vectors, each further one k-means on what the stages before it left over.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from splatcore.spec.colour import EXPONENT_MAX, EXPONENT_MIN
from splatcore.spec.number import Fixed

BATCH = 16384
ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Codebook:
    """Entries of all stages on one grid, and the entries chosen for N vectors of D components."""

    exponent: int  # the grid's step is 2^exponent
    entries: list[np.ndarray]  # per stage [2^bits, D] integers, as float64
    index: list[np.ndarray]  # per stage [N]

    def decode(self) -> np.ndarray:
        """The vectors [N, D] that the indices stand for."""
        total = sum(entries[index] for entries, index in zip(self.entries, self.index, strict=True))
        return np.ldexp(total, self.exponent)

    def __getitem__(self, which: np.ndarray) -> "Codebook":
        """The same entries, and those chosen for some of the vectors (mask or integers)."""
        return replace(self, index=[index[which] for index in self.index])


def quantise(
    vectors: np.ndarray,
    index_bits: tuple[int, ...],
    entry: Fixed,
    seed: int = 0,
    weight: np.ndarray | None = None,
    largest: int = EXPONENT_MAX,
) -> Codebook:
    """Quantise vectors [N, D] by stages of 2^index_bits entries of integer components `entry`.

    `weight` [N] ≥ 0 says how much a vector's error counts (all alike by default). Deterministic
    for a seed. The exponent is the smallest at which the largest component fits, `largest` at most.
    """
    _, exponent = np.frexp(np.abs(vectors).max(initial=0) / entry.max)
    exponent = int(np.clip(exponent, EXPONENT_MIN, largest))
    rest = np.ldexp(vectors, -exponent)
    entries, index = [], []
    for bits in index_bits:
        centres, nearest = cluster(rest, 1 << bits, seed, weight)
        entries.append(entry.round(centres))
        index.append(nearest)
        rest = rest - entries[-1][nearest]
    return Codebook(exponent, entries, index)


def cluster(
    vectors: np.ndarray, count: int, seed: int, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted k-means: centres [count, D] and the nearest centre [N] of each vector.

    Unused centres are zero.
    """
    centres = np.zeros((count, vectors.shape[1]))
    distinct, nearest = np.unique(vectors, axis=0, return_inverse=True)
    if len(distinct) <= count:
        centres[: len(distinct)] = distinct
        return centres, nearest.reshape(-1)
    from sklearn.cluster import MiniBatchKMeans  # takes a second

    means = MiniBatchKMeans(
        count, batch_size=BATCH, max_iter=ITERATIONS, n_init=1, reassignment_ratio=0,
        random_state=seed,
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # fewer distinct clusters than asked for: unused entries
        nearest = means.fit(vectors, sample_weight=weight).predict(vectors)
    return means.cluster_centers_, nearest
