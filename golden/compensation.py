"""Golden model of the opacity compensation: the integers of `spec.compensation`, on arrays.

Values and results are float64 [N], exact values of the arithmetic, of products or of `log_format`.
"""

import numpy as np

from splatcore.spec import compensation as spec
from splatcore.spec.config import Config

STEP = 2.0**-spec.LOG_FRACTION
"""Step of logarithms."""
CORRECTION, SUM = np.array(spec.CORRECTIONS) * STEP, np.array(spec.SUMS) * STEP
"""Tables of `spec.compensation`, as values."""


def product(config: Config, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a·b cut off to `PRODUCT_BITS` significant bits; exact in float64 before the cut."""
    mantissa, exponent = np.frexp(a * b)
    return np.ldexp(np.trunc(np.ldexp(mantissa, spec.PRODUCT_BITS)), exponent - spec.PRODUCT_BITS)


def minor(config: Config, p: np.ndarray, q: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return log2 (p − q)² − b; the lowest logarithm if the difference vanishes."""
    _, exponent = np.frexp(np.maximum(np.abs(p), np.abs(q)))
    unit = exponent - spec.PRODUCT_BITS
    difference = np.trunc(np.ldexp(p, -unit)) - np.trunc(np.ldexp(q, -unit))
    some = difference != 0
    power, cut_off = _log(np.where(some, difference, 1))
    return np.where(some, 2 * (power + unit + cut_off) - b, spec.log_format(config).min)


def log(config: Config, a: np.ndarray) -> np.ndarray:
    """Return log2 |a|; 0 counts as 2^−bias."""
    power, below = _log(np.where(a == 0, 2.0**-config.arithmetic.bias, a))
    return power + below


def _log(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the integer part and the fraction of log2 |values|, values ≠ 0."""
    mantissa, exponent = np.frexp(np.abs(values))
    below = 2 * mantissa - 1
    index = (below * (1 << spec.LOG_INDEX)).astype(np.int64)
    return exponent - 1, np.floor(below / STEP) * STEP + CORRECTION[index]


def log_sum(config: Config, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return log2 (2^a + 2^b)."""
    index = np.floor(np.abs(a - b) * (1 << spec.SUM_INDEX)).astype(np.int64)
    near = index < 1 << spec.SUM_INDEX + spec.SUM_INTEGER
    return np.maximum(a, b) + np.where(near, SUM[np.where(near, index, 0)], 0)


def fade(config: Config, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a − b in steps of opacity."""
    mantissa, exponent = np.frexp(np.minimum((a - b) / STEP * spec.FADE.step, spec.FADE.max))
    bits = config.arithmetic.fraction + 1
    return np.ldexp(np.trunc(np.ldexp(mantissa, bits)), exponent - bits)
