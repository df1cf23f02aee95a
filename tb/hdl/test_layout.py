"""The hardware layout of a record against `spec.record`, bit for bit."""

import numpy as np
from amaranth.hdl import Const, unsigned
from amaranth.lib import data
from hypothesis import given, settings
from hypothesis import strategies as st

from splatcore.hdl.lib.record import layout
from splatcore.spec.number import FP24, Bits, Fixed
from splatcore.spec.record import Array, Record
from tb.helpers.formats import FORMATS, random_codes, records
from tb.helpers.streams import codes, words

repeatable = settings(deadline=None, derandomize=True, database=None)


def assert_same_layout(shape, format):
    """Check that a shape has the format's widths and offsets, at every level."""
    if isinstance(format, Record):
        assert isinstance(shape, data.StructLayout)
        assert shape.size == format.width
        assert {name: field.offset for name, field in shape} == format.offsets
        for name, field in shape:
            assert_same_layout(field.shape, format[name])
    elif isinstance(format, Array):
        assert isinstance(shape, data.ArrayLayout)
        assert (shape.size, shape.length) == (format.width, format.length)
        assert_same_layout(shape.elem_shape, format.format)
    else:
        assert shape == unsigned(format.width)


def value(constant, format, codes, index: tuple[int, ...]) -> bool:
    """Return whether a constant of the layout holds the codes of record `index`."""
    if isinstance(format, Record):
        fields = format.fields
        return all(value(constant[name], inner, codes[name], index) for name, inner in fields)
    if isinstance(format, Array):
        inner, length = format.format, format.length
        return all(value(constant[k], inner, codes, (*index, k)) for k in range(length))
    return constant == int(codes[index])


@given(record=records(FORMATS))
@repeatable
def test_widths_and_offsets(record):
    assert_same_layout(layout(record), record)


@given(record=records(FORMATS), count=st.integers(1, 3), seed=st.integers(0, 1000))
@repeatable
def test_payloads(record, count, seed):
    """A packed payload, read through the layout, gives each code; `codes` inverts `words`."""
    given = random_codes(record, (count,), np.random.default_rng(seed))
    payloads = words(record, given)
    for k, payload in enumerate(payloads):
        assert value(layout(record).from_bits(payload), record, given, (k,))
    back = record.pack(codes(record, payloads))
    np.testing.assert_array_equal(back, record.pack(given))


def test_example():
    point = Record("point", {"x": Fixed(4, 3, signed=True), "y": Bits(2)})
    pair = Record("pair", {"depth": FP24, "points": Array(point, 2)})
    shape = layout(pair)
    assert shape.size == 24 + 2 * (8 + 2)
    assert [shape["depth"].offset, shape["points"].offset] == [0, 24]
    constant = Const({"depth": 0xABCDEF, "points": [{"x": 0x81, "y": 1}, {"x": 2, "y": 3}]}, shape)
    assert constant.as_value().value == 0xABCDEF | 0x81 << 24 | 1 << 32 | 2 << 34 | 3 << 42
