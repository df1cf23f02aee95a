"""Colours and harmonics in steps (`spec.colour`): the step of each chunk and degree, the shift by
which a Gaussian's own step is finer, and the codes."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from splatcore.spec.colour import (
    BASE,
    DEGREES,
    EXPONENT_MAX,
    EXPONENT_MIN,
    LAYOUTS,
    SHIFT_BITS,
    STEP_BITS,
    step,
)
from splatcore.spec.memory import CHUNK, chunk_count
from splatcore.spec.number import Fixed


@dataclass(frozen=True, eq=False)
class Steps:
    """Colours of N Gaussians in C chunks, in stored order."""

    exponents: list[int]  # exponent E of the steps of each degree
    harmonics: np.ndarray  # [C] each chunk's layout, an index of `LAYOUTS`
    s: np.ndarray  # [C, 4] codes of the chunk's steps, one per degree
    base: np.ndarray  # [N, 3] integer codes of degree 0
    codes: list[np.ndarray]  # per degree from 1, [N, k, 3] integer codes
    shifts: list[np.ndarray]  # per degree from 1, [N]


def no_steps(count: int, used: list[int]) -> Steps:
    """The steps of a model of `count` Gaussians that has codebooks, whose exponents are `used`."""
    exponents = used + [EXPONENT_MIN] * (DEGREES - len(used))
    chunks = np.zeros((chunk_count(count), DEGREES), np.int64)
    return Steps(exponents, chunks[:, 0], chunks, np.zeros((count, 0)), [], [])


def largest_factors(factors: list[np.ndarray]) -> np.ndarray:
    """The largest magnitude [C, degrees] in each chunk; factors: [N, k, 3] for each degree."""
    starts = np.arange(0, len(factors[0]), CHUNK)
    found = np.zeros((len(starts), len(factors)))
    for degree, factor in enumerate(factors if len(starts) else ()):
        found[:, degree] = np.maximum.reduceat(np.abs(factor).max((1, 2), initial=0), starts)
    return found


def step_exponents(largest: np.ndarray, harmonics: np.ndarray) -> list[int]:
    """Exponents E of the steps of each degree.

    largest: [C, degrees] `largest_factors` of all chunks
    harmonics: [C] layout of each chunk
    """
    exponents = [exponent_for(largest[:, 0], BASE)] + [EXPONENT_MIN] * (DEGREES - 1)
    for degree in range(1, largest.shape[1]):
        exponents[degree] = max(
            (
                exponent_for(largest[harmonics == k, degree], LAYOUTS[k].format(degree))
                for k in np.unique(harmonics)
                if degree <= LAYOUTS[k].degree
            ),
            default=EXPONENT_MIN,
        )
    return exponents


def quantise_steps(factors: list[np.ndarray], harmonics: np.ndarray, exponents: list[int]) -> Steps:
    """Quantise colours and harmonics.

    factors: [N, k, 3] for each degree, of its polynomials
    harmonics: [C] layout of each chunk
    exponents: E of the steps of each degree
    """
    count = len(factors[0])
    of = np.arange(count) // CHUNK
    s = np.zeros((len(harmonics), DEGREES), np.int64)
    base, s[:, 0], _ = quantise(factors[0], of, BASE, exponents[0], False, 1)
    codes = [np.zeros(f.shape, np.int64) for f in factors[1:]]
    shifts = [np.zeros(count, np.int64) for _ in codes]
    for degree in range(1, len(factors)):
        used = [k for k in np.unique(harmonics) if degree <= LAYOUTS[k].degree]
        for k in used:
            index = np.flatnonzero(harmonics[of] == k)
            found = quantise(
                factors[degree][index], of[index], LAYOUTS[k].format(degree), exponents[degree],
                LAYOUTS[k].halves, 1 << SHIFT_BITS,
            )  # fmt: skip
            codes[degree - 1][index], steps, shifts[degree - 1][index] = found
            s[harmonics == k, degree] = steps[harmonics[: len(steps)] == k]
    return Steps(exponents, harmonics, s, base[:, 0], codes, shifts)


def exponent_for(factors: np.ndarray, code: Fixed) -> int:
    """The smallest E with which the largest factor has a code, within E's limits."""
    least = np.ldexp(1.0, EXPONENT_MIN - 1)
    _, exponent = np.frexp(np.abs(factors).max(initial=least) / code.max)
    return int(np.clip(exponent, EXPONENT_MIN, EXPONENT_MAX))


def quantise(
    factors: np.ndarray, of: np.ndarray, code: Fixed, exponent: int, halves: bool, shifts: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Codes [N, k, 3] of factors, the step code s [C] of each chunk, and shifts [N] below `shifts`.

    of: [N] chunk of each Gaussian
    exponent: E of the steps
    halves: code k represents k + ½ steps

    Each chunk gets the s with the smallest squared error, each Gaussian its best shift.
    """
    levels = np.arange((1 << STEP_BITS) + 2 * (shifts - 1))
    flat = np.ascontiguousarray(factors.reshape(len(factors), 3 * factors.shape[1]))
    squares = _squares(flat, step(levels, exponent), code.min, code.max, halves / 2)  # [L, N]
    chunks = int(of[-1]) + 1 if len(of) else 0
    best, chosen = np.full(chunks, np.inf), np.zeros(chunks, np.int64)
    shift = np.zeros(len(factors), np.int64)
    for s in range(1 << STEP_BITS):
        own = squares[s : s + 2 * shifts : 2]
        finest = own.argmin(0)
        total = np.bincount(of, np.take_along_axis(own, finest[None], 0)[0], chunks)
        better = total < best
        best[better], chosen[better] = total[better], s
        shift = np.where(better[of], finest, shift)
    sizes = step(chosen[of] + 2 * shift, exponent)[:, None, None]
    return encoded(factors, sizes, code, halves).astype(np.int64), chosen, shift


@njit(cache=True)
def _squares(factors, sizes, low, high, half):
    """Squared errors [L, N] of factors [N, K] that are rounded with each of the steps [L]."""
    found = np.zeros((len(sizes), len(factors)))
    for n in range(len(factors)):
        for k in range(factors.shape[1]):
            for level, size in enumerate(sizes):
                steps = factors[n, k] / size
                code = np.floor(steps) if half else np.rint(steps)
                error = (min(max(code, low), high) + half) * size - factors[n, k]
                found[level, n] += error * error
    return found


def encoded(factors: np.ndarray, size: np.ndarray, code: Fixed, halves: bool) -> np.ndarray:
    """The nearest codes of factors: integers, as float64."""
    steps = np.floor(factors / size) if halves else np.rint(factors / size)
    return np.clip(steps, code.min, code.max)
