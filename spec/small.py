"""Small models: half a beat of attributes per Gaussian, and its expansion to a whole beat.

All six elements of L are integers m below 2^4 (with a sign below the diagonal) times one power of
two, given by the Gaussian's `exponent` e:

    element = ± m · 2^(e + UNIT)        −log2(opacity) = code · ¼

Elements that are small compared with the Gaussian's largest extent lose low bits; the Gaussian's
position is unaffected. The error of an element is at most a fifteenth of the largest element. All
of these are exact in the formats of a whole beat, so only the reader of the model differs. e above
`EXPONENT_LAST` is not used; the machine takes the sum of it and m's place modulo 32.

Of a chunk's 16-bit offsets the top 10 bits are stored, the first of them as the octant.
"""

import numpy as np

from splatcore.spec import memory
from splatcore.spec.config import Config
from splatcore.spec.record import Codes

UNIT = 1 - memory.FACTOR.bias
"""With e = 0 and m = 1 an element is the smallest normal number of `FACTOR`."""

EXPONENT_LAST = (1 << memory.FACTOR.exponent) - 1 - memory.MAGNITUDE.width
"""Largest e for which every m has a number of `FACTOR`."""

LARGEST = (1 << memory.MAGNITUDE.width) - 1
"""Largest m."""

FACTOR_MAX = np.ldexp(LARGEST + 0.5, EXPONENT_LAST + UNIT)
"""Upper bound of L's elements, in units of 2^factor_exponent."""


def position_widths(config: Config) -> tuple[int, ...]:
    """Return the widths of a stored coordinate: of whole models, then of small ones if other."""
    if config.position == "absolute":
        return (memory.ABSOLUTE.width,)
    return (memory.STORED_BITS, memory.SMALL_STORED_BITS)[: 1 + config.small_models]


def shared_exponents(lower: np.ndarray) -> np.ndarray:
    """Return the smallest e [N] with which the largest element rounds to a magnitude.

    lower: L [N, 3, 3] in units of 2^factor_exponent
    """
    _, exponent = np.frexp(np.abs(lower).max((1, 2)) / (LARGEST + 0.5))
    return np.clip(exponent - UNIT, 0, EXPONENT_LAST)


def rounded_factor(lower: np.ndarray) -> np.ndarray:
    """Return L [N, 3, 3] rounded to a small model's format, in the same units."""
    exponent = (shared_exponents(lower) + UNIT)[:, None, None]
    steps = np.clip(np.rint(np.ldexp(lower, -exponent)), -LARGEST, LARGEST)
    return np.ldexp(steps, exponent)


def factor_codes(lower: np.ndarray) -> Codes:
    """Return the fields of a small model's attributes [N] that hold a rounded L [N, 3, 3]."""
    exponent = shared_exponents(lower)
    steps = np.ldexp(lower, -(exponent + UNIT)[:, None, None]).astype(np.int64)
    codes = {"exponent": exponent}
    for name in (*memory.ON_DIAGONAL, *memory.BELOW):
        element = steps[:, int(name[1]), int(name[2])]
        codes[name] = np.abs(element) | (element < 0) << memory.MAGNITUDE.width
    return {name: values.astype(np.uint64) for name, values in codes.items()}


def expanded(codes: Codes) -> Codes:
    """Return the fields of a whole beat of attributes [N], from half-beat attributes [N]."""
    whole = {name: values for name, values in codes.items() if name not in ("exponent", "reserved")}
    exponent = codes["exponent"].astype(np.int64)
    for name in (*memory.ON_DIAGONAL, *memory.BELOW):
        sign, m = np.divmod(codes[name].astype(np.int64), LARGEST + 1)
        place = np.frexp(m)[1] - 1  # index of m's highest set bit; -1 for 0
        biased = np.where(m, exponent + place + 1, 0) & (1 << memory.FACTOR.exponent) - 1
        fraction = (m << memory.FACTOR.fraction - place) & (1 << memory.FACTOR.fraction) - 1
        code = sign << memory.FACTOR.exponent | biased
        whole[name] = (code << memory.FACTOR.fraction | fraction).astype(np.uint64)
    finer = memory.OPACITY.fraction - memory.SMALL_OPACITY.fraction
    whole["opacity"] = codes["opacity"].astype(np.uint64) << np.uint64(finer)
    return whole
