"""Opacity compensation of antialiased models: units, number formats and tables.

Scenes trained with antialiasing (Mip-Splatting, gsplat's "antialiased") multiply each splat's
opacity by f = √(det Σ / det(Σ + blur·I)), Σ its 2D covariance before the blur: the splat loses in
opacity what the blur adds in area. With M of the projection (Σ = M·Mᵀ / z²) and, by Lagrange's
identity, det(M·Mᵀ) = |minors of M|²:

    f² = D / (D + T + B)   D = |minors|² / B,  T = sum_xx + sum_yy = trace(M·Mᵀ),  B = blur·z²

D spans hundreds of powers of two but is needed to 1 % only, so sums are computed from logarithms to
base 2 (`log_format`). Only the minors are differences, of numbers that nearly cancel if a flake is
seen edge-on: their products keep `PRODUCT_BITS` significant bits, more than M has. Each step takes
one item per cycle (`COMPENSATION` has their order):

    product(a, b)       a·b cut off (towards 0) to `PRODUCT_BITS` significant bits, exponents exact
    minor(p, q, b)      log2 (p − q)² − b of two products: both are cut off to multiples of
                        2^(e + 1 − PRODUCT_BITS), 2^e ≤ the larger of |p|, |q| < 2^(e+1);
                        the lowest logarithm if they are then equal
    log(a)              log2 |a| of a float; 0 counts as 2^−bias
    log_sum(a, b)       log2 (2^a + 2^b) = max + `SUMS`[⌊|a − b| · 2^SUM_INDEX⌋]
    fade(a, b)          a − b ≥ 0 as −log2 f in steps of `spec.memory.OPACITY`, at most `FADE.max`,
                        cut off to a float

The logarithm of a number m · 2^e, 1 ≤ m < 2, with m − 1 cut off to `LOG_FRACTION` bits, is
e + (m − 1) + CORRECTIONS[the upper `LOG_INDEX` bits of m − 1].

**Error.** |f − exact| < 0.004 for splats of 0.001 to 1,000 pixels, most of it by the table of sums;
the attenuation is rounded to `OPACITY` afterwards, once. If a flake is seen edge-on, M's own
rounding decides its minors: f is off by up to about |M| · 2^−15, |M| in pixels.
"""

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Fixed

COMPENSATION = """
# opacity of antialiased models, times √(D / (D + more)) with D = det(M·Mᵀ) / (blur·z²) and more =
# trace(M·Mᵀ) + blur·z², all as log2. det(M·Mᵀ) is the sum of the squares of M's minors
depth_squared = z * z
blur_here = depth_squared * blur
log_blur = log(blur_here)
left0 = product(mx1, my2)
right0 = product(mx2, my1)
minor0 = minor(left0, right0, log_blur)
left1 = product(mx2, my0)
right1 = product(mx0, my2)
minor1 = minor(left1, right1, log_blur)
left2 = product(mx0, my1)
right2 = product(mx1, my0)
minor2 = minor(left2, right2, log_blur)
minors = log_sum(minor0, minor1)
determinant = log_sum(minors, minor2)
log_xx = log(sum_xx)
log_yy = log(sum_yy)
log_trace = log_sum(log_xx, log_yy)
more = log_sum(log_trace, log_blur)
blurred = log_sum(determinant, more)
fade = fade(blurred, determinant)
attenuation = fade * antialiased + stored_attenuation
"""
"""Program lines between covariance and opacity (`spec.programs`)."""

MODEL_CONSTANTS = ("antialiased",)
"""Constants of the programs that come from the model's header, 0 or 1."""

ATTENUATIONS = ("attenuation", "stored_attenuation")
"""Names of the field with the stored opacity: the second in programs that compensate it."""

LOG_FRACTION = 9
"""Fraction bits of logarithms."""

PRODUCT_BITS = 21
"""Significant bits of a product."""

LOG_INDEX, SUM_INDEX = 7, 5
"""Bits of m − 1 that index `CORRECTIONS`, and fraction bits of |a − b| that index `SUMS`."""

SUM_INTEGER = 3
"""Integer bits of |a − b| that index `SUMS`; for larger differences the sum is the larger one."""

FADE = Fixed(9, LOG_FRACTION + 1 - OPACITY.fraction)
"""fade before it is cut off to a float, in exact steps of opacity; 256 steps hide any splat."""


def _codes(values: np.ndarray) -> tuple[int, ...]:
    """Return values in steps of logarithms, rounded to nearest."""
    return tuple(int(code) for code in np.rint(values * 2.0**LOG_FRACTION))


def _middles(bits: int, count: int) -> np.ndarray:
    """Return the middles of the first `count` intervals of 2^−bits."""
    return (np.arange(count) + 0.5) / (1 << bits)


_BELOW = _middles(LOG_INDEX, 1 << LOG_INDEX)
CORRECTIONS = _codes(np.log2(1 + _BELOW) - _BELOW)
"""log2 m − (m − 1) at the middle of each interval of m, in steps of logarithms."""

SUMS = _codes(np.log2(1 + np.exp2(-_middles(SUM_INDEX, 1 << SUM_INDEX + SUM_INTEGER))))
"""log2 (1 + 2^−d) at the middle of each interval of d, in steps of logarithms."""


def log_format(config: Config) -> Fixed:
    """Logarithms to base 2.

    Floats are up to 2^(2^(n − 1)), n their exponent bits, so D is within 2^(± 5 · 2^(n − 1)).
    """
    return Fixed(config.arithmetic.exponent + 2, LOG_FRACTION, signed=True)


def product_exponents(config: Config) -> range:
    """Exponents of products: sums of two floats' exponents, and one more for m ≥ 2."""
    format = config.arithmetic
    most = (1 << format.exponent) - 1 - format.bias
    return range(2 * (1 - format.bias), 2 * most + 2)
