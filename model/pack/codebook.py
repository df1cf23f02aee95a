"""Residual vector quantisation: a vector is the sum of one entry per codebook stage.

The first stage is k-means on the vectors, each further stage k-means on the remaining errors. Two
stages of 128 entries are more accurate than one of 512, in half the memory.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from splatcore.spec.colour import EXPONENT_MAX, EXPONENT_MIN
from splatcore.spec.number import Fixed
from splatcore.spec.progress import report
from splatcore.spec.scene import LARGE

BATCH = 16384
ITERATIONS = 30

SAMPLE = 1 << 18
"""Vectors from which the codebooks of more than `LARGE` vectors are learned: 2000 per entry."""

NEAREST = 2048
"""Vectors whose nearest entries are searched at a time: the products stay in a core's cache."""


@dataclass(frozen=True, eq=False)
class Codebook:
    """Entries of all stages on one grid, and the indices of N vectors of D components."""

    exponent: int  # the grid's step is 2^exponent
    entries: list[np.ndarray]  # per stage [2^bits, D] integers, as float64
    index: list[np.ndarray]  # per stage [N]

    def decode(self) -> np.ndarray:
        """The quantised vectors [N, D]."""
        total = sum(entries[index] for entries, index in zip(self.entries, self.index, strict=True))
        return np.ldexp(total, self.exponent)

    def __getitem__(self, which: np.ndarray) -> "Codebook":
        """The same entries, with the indices of some of the vectors (mask or integers)."""
        return replace(self, index=[index[which] for index in self.index])


def quantise(
    vectors: np.ndarray,
    index_bits: tuple[int, ...],
    entry: Fixed,
    seed: int = 0,
    weight: np.ndarray | None = None,
    largest: int = EXPONENT_MAX,
) -> Codebook:
    """Quantise vectors; deterministic for a seed. Of more than `LARGE` vectors, the entries are
    learned from `SAMPLE` of them.

    vectors: [N, D]
    index_bits: index bits of each stage
    entry: integer format of the entries' components
    weight: [N] ≥ 0, weight of each vector's error (default: all equal)
    largest: upper limit of the exponent, which is the smallest at which all components fit
    """
    size = max(vectors.max(initial=0), -vectors.min(initial=0))
    exponent = int(np.clip(np.frexp(size / entry.max)[1], EXPONENT_MIN, largest))
    whole = len(vectors) <= LARGE
    if not whole:
        sample = np.random.default_rng(seed).choice(len(vectors), SAMPLE, replace=False)
        weight = None if weight is None else weight[sample]
    rest = np.ldexp(vectors if whole else vectors[sample].astype(np.float64), -exponent)
    entries, index = [], []
    for bits in index_bits:
        centres, nearest = cluster(rest, 1 << bits, seed, weight)
        entries.append(entry.round(centres))
        index.append(nearest)
        rest = rest - entries[-1][nearest]
    return Codebook(exponent, entries, index if whole else assigned(vectors, exponent, entries))


def assigned(vectors: np.ndarray, exponent: int, entries: list[np.ndarray]) -> list[np.ndarray]:
    """Indices [N] of each stage's entry that is nearest to the remaining error of vectors [N, D],
    computed in float32."""
    index = [np.empty(len(vectors), np.int32) for _ in entries]
    centres = [stage.astype(np.float32) for stage in entries]
    halves = [(stage * stage).sum(1) / 2 for stage in centres]  # |v − c|² = |v|² − 2 (v·c − |c|²/2)
    for first in range(0, len(vectors), NEAREST):
        report("Gaussians", first, len(vectors))
        rows = slice(first, first + NEAREST)
        rest = np.ldexp(vectors[rows], -exponent).astype(np.float32)
        for nearest, stage, half in zip(index, centres, halves, strict=True):
            nearest[rows] = (rest @ stage.T - half).argmax(1)
            rest -= stage[nearest[rows]]
    return index


def cluster(
    vectors: np.ndarray, count: int, seed: int, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted k-means: centres [count, D], unused ones zero, and each vector's nearest [N]."""
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
        warnings.simplefilter("ignore")  # fewer distinct clusters than requested: unused entries
        nearest = means.fit(vectors, sample_weight=weight).predict(vectors)
    return means.cluster_centers_, nearest
