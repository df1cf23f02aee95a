"""Random formats and their codes, for property tests."""

import numpy as np
from hypothesis import strategies as st

from splatcore.spec.number import Bits, Fixed, Float
from splatcore.spec.record import Array, Record

WIDTHS = st.integers(1, 64)

NUMBERS = st.one_of(
    WIDTHS.map(Bits),
    st.builds(Fixed, st.integers(1, 31), st.integers(0, 31), st.booleans()),
    st.builds(Float, st.integers(2, 10), st.integers(1, 52), st.booleans()),
)


def records(formats: st.SearchStrategy) -> st.SearchStrategy:
    names = st.sampled_from(["position", "depth", "opacity", "x", "y"])
    return st.builds(Record, st.just("r"), st.dictionaries(names, formats, min_size=1))


FORMATS = st.recursive(
    NUMBERS,
    lambda inner: st.one_of(records(inner), st.builds(Array, inner, st.integers(1, 4))),
    max_leaves=12,
)


def random_codes(format, shape: tuple[int, ...], rng: np.random.Generator):
    """Random codes of a format in the shape for `Record.pack`, often extreme ones."""
    if isinstance(format, Record):
        return {field: random_codes(inner, shape, rng) for field, inner in format.fields}
    if isinstance(format, Array):
        return random_codes(format.format, (*shape, format.length), rng)
    ends = np.array([0, (1 << format.width) - 1], np.uint64)
    codes = rng.integers(*ends, shape, dtype=np.uint64, endpoint=True)
    return np.where(rng.random(shape) < 0.3, rng.choice(ends, shape), codes)
