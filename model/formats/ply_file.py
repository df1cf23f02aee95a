"""The container of PLY files: header, comments, and elements as tables, ASCII or binary.

Elements with lists (such as faces) are skipped; comments may hold any bytes.
Source: Greg Turk, "The PLY Polygon File Format" (1994).
"""

import gzip
import mmap
import os
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.file import file_size, input_error

HEADER_MAX = 1 << 16  # bytes within which a header must end

GUNZIP_MAX = 100
"""Largest accepted ratio of a PLY's size to that of its gzip stream; scenes reach about 2."""

FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Format in a header → byte order of numpy."""

_OLD = "char uchar short ushort int uint float double"
_NEW = "int8 uint8 int16 uint16 int32 uint32 float32 float64"
TYPES = dict(zip(f"{_OLD} {_NEW}".split(), "i1 u1 i2 u2 i4 u4 f4 f8".split() * 2, strict=True))
"""Type of a property → numpy's type, without byte order."""

LIST_COUNTS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}
"""Type of a list's count → format character of `struct`."""

COUNT = "number of "  # prefix of the field of a list's count; property names have no blanks


@dataclass
class Element:
    """An element of a header."""

    name: str
    count: int
    # Name → type, or the types of a list's count and items.
    properties: dict[str, str | tuple[str, str]] = field(default_factory=dict)

    @property
    def lists(self) -> bool:
        return any(isinstance(kind, tuple) for kind in self.properties.values())

    def row(self, order: str, lengths: Iterable[int] = ()) -> np.dtype:
        """The type of a row; `lengths`: of its lists."""
        lengths, fields = iter(lengths), []
        for name, kind in self.properties.items():
            if isinstance(kind, tuple):
                fields.append((COUNT + name, order + kind[0]))
                fields.append((name, f"V{int(kind[1][1]) * next(lengths)}"))
            else:
                fields.append((name, order + kind))
        return np.dtype(fields)


def header(
    elements: Mapping[str, tuple[int, str, Iterable[str]]], comments: Iterable[str] = ()
) -> bytes:
    """The header of a binary little-endian file without lists.

    elements: name → number of rows, type of all properties, their names
    """
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {text}" for text in comments)]
    for name, (count, kind, properties) in elements.items():
        lines += [f"element {name} {count}", *(f"property {kind} {each}" for each in properties)]
    return "\n".join([*lines, "end_header", ""]).encode()


@dataclass(frozen=True)
class PlyFile:
    """A file's content."""

    tables: dict[str, np.ndarray]  # element without lists → structured array
    skipped: list[str]  # names of elements with lists that have rows
    comments: list[str]
    text: bool  # ASCII
    rest: int  # bytes after the last row, or lines if ASCII


def read(path: str | os.PathLike) -> PlyFile:
    """Read the content of a PLY file; raises InputError that names the faulty part."""
    data = _content(path)
    size = len(data)
    header, start = _header(data, path)
    form, elements, comments = _parsed(header, path)
    for element in elements:
        smallest = max(len(element.properties) * (2 if form == "ascii" else 1), 1)
        if not element.properties or not 0 <= element.count * smallest <= size + 1:
            claim = f"{element.count} × {len(element.properties)} values do not fit in {size} bytes"
            raise input_error(path, f"element {element.name!r}: {claim}")
    rows = _text_rows if form == "ascii" else _binary_rows
    tables, rest = rows(data, path, start, elements, FORMATS[form])
    skipped = [each.name for each in elements if each.lists and each.count]
    return PlyFile(tables, skipped, comments, form == "ascii", rest)


def _content(path: str | os.PathLike) -> bytes | mmap.mmap:
    """The bytes of a file, or those of the gzip stream that it is."""
    size = file_size(path)
    with file.reading(path), open(path, "rb") as opened:
        if opened.read(len(file.GZIP_MAGIC)) != file.GZIP_MAGIC:
            return file.mapped(path)
        opened.seek(0)
        with gzip.open(opened) as stream:
            data = stream.read(GUNZIP_MAX * size + 1)
    if len(data) > GUNZIP_MAX * size:
        raise input_error(
            path, f"unpacks to more than {GUNZIP_MAX} times its size; unpack it first"
        )
    return data


def _header(data: bytes | mmap.mmap, path: str | os.PathLike) -> tuple[list[str], int]:
    """Lines of the header, decoded as Latin-1, and its size in bytes."""
    text = data[:HEADER_MAX].decode("latin-1")
    if not text.startswith("ply"):
        raise input_error(path, "does not start with 'ply'")
    # All lines end like the first one: with LF, CR LF or CR.
    newline = "\r\n" if text[3:5] == "\r\n" else text[3:4]
    header, end, _ = text.partition(f"{newline}end_header{newline}")
    if newline not in ("\n", "\r", "\r\n") or not end:
        raise input_error(path, f"header has no 'end_header' within {HEADER_MAX} bytes")
    return header.split(newline)[1:], len(header) + len(end)


def _parsed(lines: list[str], path: str | os.PathLike) -> tuple[str, list[Element], list[str]]:
    """Parse a header: format, elements and comments."""
    form, elements, comments = "", [], []
    for line in lines:
        word, *words = line.split() or [""]
        if word in ("comment", "obj_info"):
            text = line.strip()[len(word) :].strip()
            comments.append(text.encode("latin-1").decode("utf-8", "replace"))
        elif word == "format" and len(words) == 2 and words[0] in FORMATS and not form:
            if words[1] != "1.0":
                raise input_error(path, f"header: version {words[1]!r} is not 1.0")
            form = words[0]
        elif word == "element":
            with file.reading(path, f"header: {line[:80]!r} has no count"):
                elements.append(Element(words[0], int(words[1])))
        elif word == "property" and elements:
            _add_property(elements[-1], words, path)
        else:
            raise input_error(path, f"header: unknown line {line[:80]!r}")
    names = [element.name for element in elements]
    if not form:
        raise input_error(path, "header: 'format' is missing")
    if len(set(names)) < len(names):
        raise input_error(path, "header: two elements have the same name")
    return form, elements, comments


def _add_property(element: Element, words: list[str], path: str | os.PathLike):
    """Add the property declared by the words after `property`."""
    *kinds, name = words or [""]
    where, is_list = f"header: element {element.name!r}", kinds[:1] == ["list"]
    types = tuple(TYPES.get(kind) for kind in kinds[is_list:])
    known = len(types) == 1 + is_list and None not in types
    if not known or (is_list and types[0] not in LIST_COUNTS):
        raise input_error(path, f"{where}: unknown property {' '.join(words)[:80]!r}")
    if name in element.properties:
        raise input_error(path, f"{where}: two properties are called {name!r}")
    element.properties[name] = types if is_list else types[0]


def _binary_rows(
    data: bytes | mmap.mmap,
    path: str | os.PathLike,
    start: int,
    elements: list[Element],
    order: str,
) -> tuple[dict[str, np.ndarray], int]:
    """Read the tables of a binary file; also returns the number of bytes left."""
    tables = {}
    for element in elements:
        if element.lists and element.count:
            start = _behind_lists(data, start, element, order, path)
        if element.lists:
            continue
        row = element.row(order)
        end = start + element.count * row.itemsize
        if end > len(data):
            held = (len(data) - start) // row.itemsize
            raise input_error(path, f"element {element.name!r}: has {held} of {element.count} rows")
        tables[element.name] = np.frombuffer(data, row, element.count, start)
        start = end
    return tables, len(data) - start


def _behind_lists(
    data: bytes | mmap.mmap, start: int, element: Element, order: str, path: str | os.PathLike
) -> int:
    """Find the offset of the first byte after an element with lists."""
    where, end = f"element {element.name!r}: lists", start
    with file.reading(path, f"{where} are cut off"):
        lengths, end = _row_end(data, start, element, order)
        row = element.row(order, lengths)
        last = start + element.count * row.itemsize
        if last <= len(data):  # all lists may be as long as the first row's, as with triangles
            table = np.frombuffer(data, row, element.count, start)
            counts = [name for name in row.names if name.startswith(COUNT)]
            if all((table[n] == k).all() for n, k in zip(counts, lengths, strict=True)):
                return last
        for _ in range(element.count - 1):
            _, end = _row_end(data, end, element, order)
    if end > len(data):
        raise input_error(path, f"{where} are cut off")
    return end


def _row_end(
    data: bytes | mmap.mmap, start: int, element: Element, order: str
) -> tuple[list[int], int]:
    """Lengths of the lists of the row at an offset, and the offset of its end."""
    lengths = []
    for kind in element.properties.values():
        if isinstance(kind, tuple):
            count = struct.Struct(order + LIST_COUNTS[kind[0]])
            (length,) = count.unpack_from(data, start)
            if length < 0:
                raise ValueError(f"a list of {length} items")
            lengths.append(length)
            start += count.size + length * int(kind[1][1])
        else:
            start += int(kind[1])
    return lengths, start


def _text_rows(
    data: bytes | mmap.mmap,
    path: str | os.PathLike,
    start: int,
    elements: list[Element],
    order: str,
) -> tuple[dict[str, np.ndarray], int]:
    """Read the tables of an ASCII file; also returns the number of lines left. Empty lines are
    ignored."""
    lines = [line for line in data[start:].splitlines() if line.strip()]
    tables, begin = {}, 0
    for element in elements:
        rows = lines[begin : begin + element.count]
        begin += element.count
        where = f"element {element.name!r}"
        if len(rows) < element.count:
            raise input_error(path, f"{where}: has {len(rows)} of {element.count} rows")
        if not element.lists:
            tables[element.name] = _text_table(rows, element, f"{path}: {where}")
    return tables, max(len(lines) - begin, 0)


def _text_table(rows: list[bytes], element: Element, where: str) -> np.ndarray:
    """Parse the table of an element from its lines."""
    words, table = [row.split() for row in rows], np.empty(len(rows), element.row("="))
    for number, row in enumerate(words):
        if len(row) != len(element.properties):
            fault = f"row {number} has {len(row)} values, not {len(element.properties)}"
            raise input_error(where, fault)
    if not rows:
        return table
    with file.reading(where, "holds a value that is not a number"):
        values = np.array(words).astype(np.float64)
    for name, column in zip(element.properties, values.T, strict=True):
        kind = table.dtype[name]
        low, high = (0, 0) if kind.kind == "f" else (np.iinfo(kind).min, np.iinfo(kind).max)
        if kind.kind != "f" and not ((column >= low) & (column <= high)).all():
            raise input_error(where, f"property {name!r} is not in {low} … {high}")
        with np.errstate(over="ignore"):
            table[name] = column
    return table
