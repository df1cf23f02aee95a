"""Records, packed bit fields: the data between stages and in memory.

A `Record` names its fields in order and gives each a format. The first field is in the least
significant bits, and so is element 0 of an `Array`, as in Amaranth's `lib.data`. The hardware's
layout, the testbench's words and the model's bytes all follow from the one object.

Bits are little-endian throughout: bit k of a record or stream is bit k % 8 of byte k // 8.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np

from splatcore.spec.number import Bits, Fixed, Float, checked_codes, code_dtype

Codes = dict[str, "np.ndarray | Codes"]
"""Codes of N records by field: [N] for a number; [N, length] for an `Array` of numbers, with one
more axis per further level; for a nested record again a dict, below the axes around it.
"""

WORD = 64
"""Bits of the words in which codes are assembled."""


@dataclass(frozen=True)
class Array:
    """`length` elements of one format, element 0 in the least significant bits."""

    format: "Format"
    length: int

    def __post_init__(self):
        if not isinstance(self.format, Format):
            raise TypeError(f"an array of {self.format!r}, which is not a format")
        if self.length < 1:
            raise ValueError(f"an array of {self.length} elements")

    @property
    def width(self) -> int:
        return self.format.width * self.length

    def encode(self, values):
        """Return values [N, length] (for an array of records a dict of them) as codes of that
        shape.
        """
        return self.format.encode(values)

    def decode(self, codes):
        """Return the values of codes [N, length]."""
        return self.format.decode(codes)


@dataclass(frozen=True)
class Record:
    """Named fields, the first in the least significant bits.

    fields: a dict field → format, kept as a tuple of pairs, so that records can be compared
        (order counts) and hashed

    `record[field]` is a field's format. Only nested records and arrays may be wider than 64 bits:
    no number format is.
    """

    name: str
    fields: tuple[tuple[str, "Format"], ...]

    def __post_init__(self):
        fields = self.fields.items() if isinstance(self.fields, Mapping) else self.fields
        object.__setattr__(self, "fields", tuple((field, format) for field, format in fields))
        if not self.fields:
            raise ValueError(f"{self.name}: a record without fields")
        for field, format in self.fields:
            if not field.isidentifier():
                raise ValueError(f"{self.name}: field name {field!r} is not an identifier")
            if not isinstance(format, Format):
                raise TypeError(f"{self.name}.{field}: {format!r} is not a format")
        if len(dict(self.fields)) < len(self.fields):
            raise ValueError(f"{self.name}: two fields of one name")

    def __getitem__(self, field: str) -> "Format":
        return dict(self.fields)[field]

    @property
    def width(self) -> int:
        return sum(format.width for _, format in self.fields)

    @property
    def size(self) -> int:
        """Bytes of a packed record; the bits above `width` in the last byte are zero."""
        return ceil(self.width / 8)

    @property
    def offsets(self) -> dict[str, int]:
        """Position of each field's least significant bit."""
        offsets, end = {}, 0
        for field, format in self.fields:
            offsets[field] = end
            end += format.width
        return offsets

    def offset(self, field: str) -> int:
        """Position of one field's least significant bit."""
        return self.offsets[field]

    def encode(self, values: dict) -> Codes:
        """Return real values by field as codes by field, rounded to each field's format."""
        _check_names(values, self, self.name)
        return {field: format.encode(values[field]) for field, format in self.fields}

    def decode(self, codes: Codes) -> dict:
        """Return the values of codes, by field."""
        _check_names(codes, self, self.name)
        return {field: format.decode(codes[field]) for field, format in self.fields}

    def pack(self, codes: Codes) -> np.ndarray:
        """Return codes of N records as bytes, uint8 [N, size].

        Raises ValueError, naming record and field, for a code that does not fit, for a missing or
        unknown field, and for any other shape than in `Codes`.
        """
        numbers = list(_numbers(self, codes, self.name))
        count = np.size(numbers[0].codes)
        words = np.zeros((ceil(self.width / WORD), count), np.uint64)
        for number in numbers:
            if np.shape(number.codes) != (count,):
                shape = np.shape(number.codes)
                raise ValueError(f"{number.name}: shape {shape}, but there are {count} records")
            field = checked_codes(number.codes, number.width, number.name)
            _insert(words, number.offset, number.width, field)
        return _to_bytes(words, self.size)

    def unpack(self, data: np.ndarray) -> Codes:
        """Return bytes, uint8 [N, size], as codes of N records, each in the smallest unsigned
        dtype.

        The bits above `width` in the last byte are ignored. Raises ValueError for any other shape.
        """
        if data.dtype != np.uint8 or data.ndim != 2 or data.shape[1] != self.size:
            shape = f"{data.dtype} {data.shape}"
            raise ValueError(f"{self.name}: {shape} is not uint8 [N, {self.size}]")
        return _codes(self, _from_bytes(data), 0)


Format = Bits | Fixed | Float | Array | Record
"""Formats of a field."""


def pack_bits(codes: np.ndarray, width: int) -> np.ndarray:
    """Pack codes [N] of `width` (1 … 64) bits back to back: uint8 [⌈N·width/8⌉], padded with 0."""
    codes = checked_codes(codes, Bits(width).width, "pack_bits")
    if codes.ndim != 1:
        raise ValueError(f"pack_bits: codes of shape {codes.shape}, not [N]")
    # WORD codes of any width fill whole words: a stream is an array of such groups.
    groups = ceil(len(codes) / WORD)
    padded = np.zeros(groups * WORD, codes.dtype)
    padded[: len(codes)] = codes
    words = np.zeros((width, groups), np.uint64)
    for k in range(WORD):
        _insert(words, k * width, width, padded[k::WORD])
    data = _to_bytes(words, width * WORD // 8)
    return data.reshape(-1)[: ceil(len(codes) * width / 8)]


def unpack_bits(data: np.ndarray, width: int, count: int) -> np.ndarray:
    """Return the first `count` codes of `width` bits in bytes, uint8 [M], smallest unsigned dtype.

    Later bytes, the rest of a burst, are ignored. Raises ValueError if there are too few.
    """
    size = ceil(count * Bits(width).width / 8)
    if data.dtype != np.uint8 or data.ndim != 1 or len(data) < size:
        shape = f"{data.dtype} {data.shape}"
        raise ValueError(f"unpack_bits: {shape} is not uint8 [{size}] for {count} × {width} bits")
    groups = ceil(count / WORD)
    padded = np.zeros((groups, width * WORD // 8), np.uint8)
    padded.reshape(-1)[:size] = data[:size]
    words = _from_bytes(padded)
    codes = [_extract(words, k * width, width) for k in range(WORD)]
    return np.stack(codes, axis=1).reshape(-1)[:count]


class _Number(NamedTuple):
    """One number of a record with its codes [N], at any depth of records and arrays."""

    name: str  # record.field[element].field …
    offset: int
    width: int
    codes: np.ndarray


def _numbers(format: Format, codes, name: str, offset: int = 0) -> Iterator[_Number]:
    """Yield the numbers of a format, first to last, with their share of the codes."""
    if isinstance(format, Record):
        _check_names(codes, format, name)
        offsets = format.offsets
        for field, inner in format.fields:
            yield from _numbers(inner, codes[field], f"{name}.{field}", offset + offsets[field])
    elif isinstance(format, Array):
        step = format.format.width
        for k in range(format.length):
            part = _element(codes, k, format.length, name)
            yield from _numbers(format.format, part, f"{name}[{k}]", offset + k * step)
    else:
        yield _Number(name, offset, format.width, np.asarray(codes))


def _element(codes, k: int, length: int, name: str):
    """Return the codes of element k: index k of axis 1, in every field of an array of records."""
    if isinstance(codes, Mapping):
        return {f: _element(inner, k, length, f"{name}.{f}") for f, inner in codes.items()}
    codes = np.asarray(codes)
    if codes.ndim < 2 or codes.shape[1] != length:
        raise ValueError(f"{name}: shape {codes.shape} for an array of {length} elements")
    return codes[:, k]


def _codes(format: Format, words: np.ndarray, offset: int):
    """Return the codes of a format at a bit offset of each record; the inverse of `_numbers`."""
    if isinstance(format, Record):
        offsets = format.offsets
        return {f: _codes(inner, words, offset + offsets[f]) for f, inner in format.fields}
    if isinstance(format, Array):
        starts = range(offset, offset + format.width, format.format.width)
        return _stack([_codes(format.format, words, start) for start in starts])
    return _extract(words, offset, format.width)


def _stack(elements: list):
    """Return the codes of all elements along axis 1; the inverse of `_element`."""
    if isinstance(elements[0], Mapping):
        return {f: _stack([element[f] for element in elements]) for f in elements[0]}
    return np.stack(elements, axis=1)


def _check_names(by_field, record: Record, name: str):
    """Raise ValueError unless `by_field` is a dict of exactly the record's fields."""
    if not isinstance(by_field, Mapping):
        raise ValueError(f"{name}: {type(by_field).__name__} instead of a dict of fields")
    odd = set(by_field) ^ set(dict(record.fields))
    if odd:
        raise ValueError(f"{name}: missing or unknown fields {', '.join(sorted(map(str, odd)))}")


# Words are kept as [words of one record, N], so that a field of all records is contiguous.


def _insert(words: np.ndarray, offset: int, width: int, codes: np.ndarray):
    """Write codes [N] of `width` bits into words that are still zero there."""
    word, shift = divmod(offset, WORD)
    codes = codes.astype(np.uint64)
    words[word] |= codes << shift
    if shift + width > WORD:
        words[word + 1] |= codes >> (WORD - shift)


def _extract(words: np.ndarray, offset: int, width: int) -> np.ndarray:
    """Return the codes [N] that `_insert` wrote."""
    word, shift = divmod(offset, WORD)
    codes = words[word] >> shift
    if shift + width > WORD:
        codes |= words[word + 1] << (WORD - shift)
    return (codes & ((1 << width) - 1)).astype(code_dtype(width))


def _to_bytes(words: np.ndarray, size: int) -> np.ndarray:
    """Return the lowest `size` bytes of words [W, N], least significant first on any host, [N,
    size].
    """
    data = np.ascontiguousarray(words.T, "<u8").view(np.uint8)
    return np.ascontiguousarray(data[:, :size])


def _from_bytes(data: np.ndarray) -> np.ndarray:
    """Return bytes [N, M] as words [⌈M/8⌉, N], zeros above."""
    padded = np.zeros((len(data), ceil(data.shape[1] * 8 / WORD) * 8), np.uint8)
    padded[:, : data.shape[1]] = data
    return np.ascontiguousarray(padded.view("<u8").T.astype(np.uint64))
