"""Pairs of float codes that are likely to reveal faults of arithmetic.

Codes are assembled from fields, so they include codes that `encode` never returns (other NaNs, -0,
fractions below the smallest normal value).
"""

import numpy as np

from splatcore.spec.number import Float, code_dtype


def corners(format: Float) -> np.ndarray:
    """Codes around the ends of all ranges, with and without sign."""
    normal, end = 1 << format.fraction, 1 << (format.exponent + format.fraction)
    infinity, one = end - normal, format.bias << format.fraction
    near = np.arange(-2, 3)
    middle = np.array([normal // 2, infinity + normal // 2])
    codes = np.concatenate([near + k for k in (0, normal, 2 * normal, one, infinity, end)])
    codes = np.unique(np.clip(np.concatenate([codes, middle, middle + 1]), 0, end - 1))
    return np.concatenate([codes, codes | end]) if format.signed else codes


def fractions(format: Float, rng: np.random.Generator, count: int) -> np.ndarray:
    """Fractions of all kinds: random, ending in zeros or ones, single bits."""
    whole = (1 << format.fraction) - 1
    random = rng.integers(0, whole + 1, count)
    low = (1 << rng.integers(0, format.fraction + 1, count)) - 1
    bit = 1 << rng.integers(0, format.fraction, count)
    sorts = [random, random & ~low, random | low, bit, whole ^ bit, low, whole ^ low]
    return np.choose(rng.integers(0, len(sorts), count), sorts)


def join(format: Float, rng: np.random.Generator, exponents, fractions) -> np.ndarray:
    """Codes with random signs; exponents are clipped to the format."""
    exponents = np.clip(exponents, 0, (1 << format.exponent) - 1)
    signs = rng.integers(0, 1 + format.signed, len(fractions))
    return ((signs << format.exponent | exponents) << format.fraction) + fractions


def ties(format: Float, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Fractions of factors whose product is a tie: 1 in the first bit to round off, then zeros."""
    whole = (1 << format.fraction) - 1
    zeros_a = rng.integers(0, format.fraction + 1, count)
    zeros_b = np.clip(format.fraction + rng.integers(-1, 2, count) - zeros_a, 0, format.fraction)
    odd_a, odd_b = rng.integers(0, whole + 1, (2, count)) | 1
    return odd_a << zeros_a & whole, odd_b << zeros_b & whole


def pairs(format: Float, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Codes a and b, at least `count` of each."""
    part = -(-count // 8)
    fraction, top = format.fraction, 1 << format.exponent

    def both(exponent_a, exponent_b, fraction_a=None, fraction_b=None):
        """Pairs of codes with these exponents; fractions of all kinds by default."""
        fraction_a = fractions(format, rng, part) if fraction_a is None else fraction_a
        fraction_b = fractions(format, rng, part) if fraction_b is None else fraction_b
        codes = (
            join(format, rng, exponent_a, fraction_a),
            join(format, rng, exponent_b, fraction_b),
        )
        return codes if rng.integers(2) else codes[::-1]

    any_a, any_b = rng.integers(0, top, (2, part))
    ends = corners(format)
    cancelled = join(format, rng, any_a, fractions(format, rng, part))
    step = rng.integers(-3, 4, part) * rng.choice([0, 1, 1 << fraction], part)
    close = (cancelled ^ (format.signed << (format.width - 1))) + step
    parts = [
        both(any_a, any_b),
        # Sums: every distance with an effect; differences that lose many bits.
        both(any_a, any_a - rng.integers(0, fraction + 5, part)),
        (cancelled, np.clip(close, 0, (1 << format.width) - 1)),
        # Products: ties; around the smallest and the largest value.
        both(any_a, any_b, *ties(format, rng, part)),
        both(any_a, format.bias + rng.integers(-fraction - 3, 4, part) - any_a),
        both(any_a, format.bias + top + rng.integers(-4, 2, part) - any_a),
        # Ends of the range: subnormal values and the largest, then corners with everything.
        both(rng.integers(0, 4, part) * rng.choice([0, 1, top], part), rng.integers(0, 4, part)),
        (rng.choice(ends, part), np.where(any_b % 2, rng.choice(ends, part), cancelled)),
    ]
    a, b = (
        np.concatenate(codes).astype(code_dtype(format.width)) for codes in zip(*parts, strict=True)
    )
    order = rng.permutation(len(a))
    return a[order], b[order]


def every_pair(width: int) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of codes of `width` bits."""
    codes = np.arange(1 << width, dtype=code_dtype(width))
    return tuple(codes.ravel() for codes in np.meshgrid(codes, codes))
