"""Packed records and bit streams against packing with Python's integers."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from splatcore.spec.number import FP16, FP24, Bits, Fixed, Float
from splatcore.spec.record import Array, Record, pack_bits, unpack_bits
from tb.helpers.formats import FORMATS, WIDTHS, random_codes, records

pytestmark = pytest.mark.filterwarnings("error", "ignore::amaranth.hdl.UnusedElaboratable")
repeatable = settings(deadline=None, derandomize=True, database=None)


def integer(format, codes, index: tuple[int, ...]) -> int:
    """Return record `index` as one integer of format.width bits (the oracle)."""
    if isinstance(format, Record):
        parts = [(inner.width, integer(inner, codes[f], index)) for f, inner in format.fields]
    elif isinstance(format, Array):
        inner = format.format
        parts = [(inner.width, integer(inner, codes, (*index, k))) for k in range(format.length)]
    else:
        return int(codes[index])
    return sum(part << sum(width for width, _ in parts[:k]) for k, (_, part) in enumerate(parts))


def assert_same(got, expected):
    """Check that two records' codes are equal, field by field, in the same order."""
    if isinstance(expected, dict):
        assert list(got) == list(expected)
        for field in expected:
            assert_same(got[field], expected[field])
    else:
        np.testing.assert_array_equal(got, expected)


@given(record=records(FORMATS), count=st.integers(0, 5), seed=st.integers(0, 1000))
@repeatable
def test_record_as_integers(record, count, seed):
    codes = random_codes(record, (count,), np.random.default_rng(seed))
    packed = record.pack(codes)
    assert packed.dtype == np.uint8 and packed.shape == (count, record.size)
    assert record.size == (record.width + 7) // 8
    for k in range(count):
        expected = integer(record, codes, (k,))
        assert packed[k].tobytes() == expected.to_bytes(record.size, "little")
    assert_same(record.unpack(packed), codes)


@given(width=WIDTHS, count=st.integers(0, 200), seed=st.integers(0, 1000))
@repeatable
def test_stream_as_integer(width, count, seed):
    codes = random_codes(Bits(width), (count,), np.random.default_rng(seed))
    packed = pack_bits(codes, width)
    stream = sum(int(code) << k * width for k, code in enumerate(codes))
    assert packed.dtype == np.uint8
    assert packed.tobytes() == stream.to_bytes((count * width + 7) // 8, "little")
    behind = np.full(3, 0xFF, np.uint8)
    for data in (packed, np.concatenate([packed, behind])):
        unpacked = unpack_bits(data, width, count)
        assert unpacked.dtype == Bits(width).encode([0]).dtype
        np.testing.assert_array_equal(unpacked, codes)


SPLAT = Record(
    "splat",
    {
        "position": Array(Fixed(11, 5, signed=True), 2),
        "depth": Float(7, 16, signed=False),
        "shape": Record("conic", {"a": FP24, "b": FP24, "c": FP16}),
        "live": Bits(1),
    },
)


def test_layout():
    """The first field, and element 0 of an array, are in the least significant bits."""
    assert SPLAT.offsets == {"position": 0, "depth": 34, "shape": 57, "live": 121}
    assert (SPLAT.width, SPLAT.size, SPLAT.offset("live")) == (122, 16, 121)
    assert SPLAT["shape"].offsets == {"a": 0, "b": 24, "c": 48}
    codes = {
        "position": np.array([[1, 0x1FFFF]]),
        "depth": np.array([3]),
        "shape": {"a": np.array([5]), "b": np.array([0]), "c": np.array([0x8001])},
        "live": np.array([1]),
    }
    word = 1 | 0x1FFFF << 17 | 3 << 34 | 5 << 57 | 0x8001 << 105 | 1 << 121
    assert SPLAT.pack(codes).tobytes() == word.to_bytes(16, "little")
    small = Record("small", {"low": Bits(3), "high": Bits(7)})
    packed = small.pack({"low": np.array([0b101, 0]), "high": np.array([0b1000001, 0])})
    assert packed.tolist() == [[0b00001_101, 0b10], [0, 0]]


def test_padding_is_zero_and_ignored():
    record = Record("r", {"a": Bits(5)})
    assert record.pack({"a": np.array([31])}).tolist() == [[31]]
    assert record.unpack(np.array([[0xE1]], np.uint8))["a"].tolist() == [1]


def test_values():
    """encode and decode apply each field's format, in arrays and nested records too."""
    values = {
        "position": np.array([[1.5, -3.02], [1e9, -1e9]]),
        "depth": np.array([2.0, -1.0]),
        "shape": {name: np.array([0.1, -7.0]) for name in "abc"},
        "live": np.array([True, False]),
    }
    codes = SPLAT.encode(values)
    assert codes["position"].tolist() == [[48, 0x20000 - 97], [0xFFFF, 0x10000]]
    assert_same(SPLAT.unpack(SPLAT.pack(codes)), codes)
    decoded = SPLAT.decode(codes)
    assert decoded["position"].tolist() == [[1.5, -97 / 32], [2048 - 1 / 32, -2048.0]]
    assert decoded["depth"].tolist() == [2.0, 0.0]
    assert decoded["shape"]["c"].tolist() == [float(np.float16(0.1)), -7.0]
    assert decoded["live"].tolist() == [1, 0]


def test_array_of_records():
    """In an array of records, the array's axis of each field follows axis N."""
    corner = Record("corner", {"x": Bits(4), "y": Array(Bits(2), 2)})
    box = Record("box", {"corner": Array(corner, 2)})
    codes = {"corner": {"x": np.array([[1, 2]]), "y": np.array([[[0, 1], [2, 3]]])}}
    packed = box.pack(codes)
    assert packed.tolist() == [[1 | 0 << 4 | 1 << 6, 2 | 2 << 4 | 3 << 6]]
    assert_same(box.unpack(packed), codes)


def test_records_are_values():
    """Records are equal by name and ordered fields, and usable as keys."""
    a, b = Bits(3), FP24
    record = Record("r", {"a": a, "b": b})
    again = Record("r", (("a", a), ("b", b)))
    assert record == again and hash(record) == hash(again)
    others = [Record("s", {"a": a, "b": b}), Record("r", {"b": b, "a": a}), Record("r", {"a": a})]
    assert len({record, *others}) == 4
    assert {SPLAT: 1}[SPLAT] == 1


ONE = np.array([1])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"live": np.array([2])}, r"splat\.live: code 2 does not fit in 1 bits"),
        ({"live": np.array([-1])}, r"splat\.live: code -1 does not fit"),
        ({"position": np.array([[1, 1 << 17]])}, r"splat\.position\[1\]: code 131072 does not fit"),
        ({"shape": {"a": ONE, "b": ONE, "c": np.array([1 << 16])}}, r"splat\.shape\.c: code 65536"),
        ({"shape": {"a": ONE, "b": ONE}}, r"splat\.shape: missing or unknown fields c"),
        ({"shape": ONE}, r"splat\.shape: ndarray instead of a dict"),
        ({"colour": ONE}, r"splat: missing or unknown fields colour"),
        ({"position": ONE}, r"splat\.position: shape \(1,\) for an array of 2"),
        ({"position": np.ones((1, 3), int)}, r"splat\.position: shape \(1, 3\) for an array of 2"),
        ({"live": np.array([1, 0])}, r"splat\.live: shape \(2,\), but there are 1 records"),
        ({"live": 1}, r"splat\.live: shape \(\), but there are 1 records"),
    ],
)
def test_odd_codes_are_refused(changed, message):
    shape = dict.fromkeys("abc", ONE)
    codes = {"position": np.array([[0, 0]]), "depth": ONE, "shape": shape, "live": ONE}
    SPLAT.pack(codes)
    with pytest.raises(ValueError, match=message):
        SPLAT.pack(codes | changed)


def test_real_codes_are_refused():
    with pytest.raises(TypeError, match=r"r\.a: codes are integers"):
        Record("r", {"a": Bits(3)}).pack({"a": np.array([1.0])})


def test_odd_bytes_are_refused():
    for data in (np.zeros((1, 15), np.uint8), np.zeros(16, np.uint8), np.zeros((1, 16), np.int8)):
        with pytest.raises(ValueError, match="splat"):
            SPLAT.unpack(data)
    for data in (np.zeros(5, np.uint8), np.zeros((1, 6), np.uint8), np.zeros(6, np.uint16)):
        with pytest.raises(ValueError, match="1 × 45 bits"):
            unpack_bits(data, 45, 1)
    with pytest.raises(ValueError, match="does not fit in 45 bits"):
        pack_bits(np.array([1 << 45]), 45)
    with pytest.raises(ValueError, match="shape"):
        pack_bits(np.array([[1]]), 45)


def test_impossible_records_are_refused():
    for fields in ({}, {"a b": Bits(1)}, (("a", Bits(1)), ("a", Bits(2)))):
        with pytest.raises(ValueError, match="r"):
            Record("r", fields)
    with pytest.raises(TypeError, match=r"r\.a"):
        Record("r", {"a": 8})
    with pytest.raises(TypeError):
        Array(8, 2)
    for length in (0, -1):
        with pytest.raises(ValueError):
            Array(Bits(8), length)
    for width in (0, 65):
        with pytest.raises(ValueError):
            pack_bits(np.zeros(1, np.uint8), width)
        with pytest.raises(ValueError):
            Record("r", {"a": Bits(width)})


def test_half_a_million_records():
    """Ten fields, 128 bits: 500,000 records pack, and unpack, in less than a second each."""
    widths = (7, 13, 16, 24, 1, 24, 11, 16, 9, 7)
    record = Record("r", {f"f{k}": Bits(width) for k, width in enumerate(widths)})
    codes = random_codes(record, (500_000,), np.random.default_rng(1))
    start = time.process_time()
    packed = record.pack(codes)
    middle = time.process_time()
    unpacked = record.unpack(packed)
    assert middle - start < 1 and time.process_time() - middle < 1
    assert_same(unpacked, codes)
