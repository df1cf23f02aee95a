"""The coded file of a packed model: its memory image, compressed column by column.

    file header │ the model's header │ tables

`tables` lists the tables of a model; a row of a table is one or more records. A column holds one
number of these records for all rows. The codes of a column agree in their high bits and are often
close to the codes of the neighbouring columns. A column is stored as

    difference (one byte) │ for each byte of a code, the lowest first: size │ zstd frame

and a code c of row n is stored, modulo 2^width, as

    c[n] − other[n] − (c[n − 1] − other[n − 1])    other: the column `back` places before it;
                                                   0 if `back` is 0
                                                   the part in brackets only if `previous` is set

Rows of harmonics often repeat, as scene files have palettes of them. Such a table begins with one
more column, which holds a distance per row: 0 for a stored row, d for a copy of the row that is
d-th from the end of the rows stored up to there. The other columns hold the stored rows only.

A column without rows is left out. All other bytes of a model, which are padding between its parts,
are zeros: a model with other padding stays uncoded, as it could not be restored bit for bit.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from splatcore.spec import memory
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import CHUNK, CHUNK_HEADER, HEADER, chunk_count
from splatcore.spec.model_header import ModelHeader
from splatcore.spec.number import Bits, code_dtype
from splatcore.spec.packed import LAYOUT_BEATS, PackedModel
from splatcore.spec.record import Array, Record, pack_bits
from splatcore.spec.scene import batches

MAGIC = int.from_bytes(b"SPLZ", "little")
"""'SPLZ': marks a coded file."""
VERSION = 1
"""Version of the coded file's format."""

FILE_HEADER = Record("file", {"magic": Bits(32), "version": Bits(16)})
"""First record of a coded file; the model's header follows, as stored in memory."""

DIFFERENCE = Record("difference", {"back": Bits(7), "previous": Bits(1)})
"""Coding of a column: `back` and `previous`, as above."""
SIZE = Record("size", {"bytes": Bits(32)})
"""Bytes of the zstd frame that follows."""

DISTANCE = Record("distance", {"rows": Bits(32)})
"""First column of a table with repeated rows: its distance per row."""

WITH_BEATS = [number for number, layout in enumerate(LAYOUTS) if layout.beats]
"""Numbers of the layouts with beats of harmonics."""

Rows = list[np.ndarray]  # of some tables, uint8 [N, size] each

BACK_MAX = 3
"""Maximum `back`: the same coefficient of the previous channel is 1 to 3 columns away."""


@dataclass(frozen=True)
class Table:
    """`count` rows of records stored back to back."""

    name: str
    records: tuple[Record, ...]
    count: int
    repeats: bool = False  # rows may be copies of others

    @property
    def widths(self) -> list[int]:
        """Bits of each column."""
        formats = [format for record in self.records for _, format in record.fields]
        arrays = [f if isinstance(f, Array) else Array(f, 1) for f in formats]
        return [array.format.width for array in arrays for _ in range(array.length)]

    @property
    def size(self) -> int:
        """Bytes of a row."""
        return sum(record.size for record in self.records)

    def columns(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return the codes [N] of each column, from rows uint8 [N, size]."""
        found = [np.empty(len(rows), code_dtype(width)) for width in self.widths]
        for batch in batches(len(rows)):
            columns, start = iter(found), 0
            for record in self.records:
                part = np.ascontiguousarray(rows[batch, start : start + record.size])
                for codes in record.unpack(part).values():
                    for column in codes.reshape(len(codes), -1).T:
                        next(columns)[batch] = column
                start += record.size
        return found

    def rows(self, columns: list[np.ndarray]) -> np.ndarray:
        """Invert `columns`."""
        found = np.empty((len(columns[0]), self.size), np.uint8)
        for batch in batches(len(found)):
            rest, start = (column[batch] for column in columns), 0
            for record in self.records:
                codes = {}
                for field, format in record.fields:
                    array = isinstance(format, Array)
                    taken = [next(rest) for _ in range(format.length if array else 1)]
                    codes[field] = np.stack(taken, axis=1) if array else taken[0]
                found[batch, start : start + record.size] = record.pack(codes)
                start += record.size
        return found


def chunk_table(header: ModelHeader) -> Table:
    """Return the first table, the chunk headers; they determine the other tables' rows."""
    records = (LEVEL, CHUNK_HEADER) if header.format.levels else (CHUNK_HEADER,)
    return Table("chunks", records, chunk_count(header.count))


def tables(header: ModelHeader, harmonics: np.ndarray) -> list[Table]:
    """List the tables after the chunk headers.

    header: the model's header
    harmonics: [C] layout of each chunk's harmonics, an index into `LAYOUTS`
    """
    format, of = header.format, _layout_numbers(header, harmonics)
    found = [
        Table("positions", (format.position_record,), header.count),
        Table("attributes", (format.stored_record,), header.count),
    ]
    for number in WITH_BEATS:
        records, count = tuple(LAYOUTS[number].records), int((of == number).sum())
        found.append(Table(f"harmonics{number}", records, count, repeats=True))
    return [
        *found,
        Table("colours", (memory.COLOUR_ENTRY,), format.colour_entries),
        Table("sh", (memory.SH_ENTRY,), format.sh_entries),
    ]


def _layout_numbers(header: ModelHeader, harmonics: np.ndarray) -> np.ndarray:
    """Return the layout [N] of each Gaussian's harmonics."""
    return np.repeat(harmonics, CHUNK)[: header.count]


def rows_of(model: PackedModel) -> Iterator[tuple[Table, np.ndarray]]:
    """Yield all tables of a model with their rows, uint8 [N, size]."""
    harmonics, layout = model.chunks["harmonics"], model.layout
    first, *others = (chunk_table(model), *tables(model, harmonics))
    yield first, _part(model.image, layout.chunks, first)
    positions, attributes, *others, colours, sh = others
    codes = dict(zip("xyz", model.stored().stored_positions.T, strict=True))
    yield positions, positions.records[0].pack(codes)
    yield attributes, model.stored().stored_attributes
    of = _layout_numbers(model, harmonics)
    for table, number in zip(others, WITH_BEATS, strict=True):
        beats = (
            model.first_beats(np.flatnonzero(of == number))[:, None]
            + 1
            + np.arange(LAYOUTS[number].beats)
        )
        yield table, model.attribute_beats(beats).reshape(table.count, table.size)
    yield colours, _part(model.image, layout.colours, colours)
    yield sh, _part(model.image, layout.sh, sh)


def _part(image: np.ndarray, start: int, table: Table) -> np.ndarray:
    return image[start : start + table.count * table.size].reshape(table.count, table.size)


def beats_in_all(harmonics: np.ndarray, count: int) -> int:
    """Return the beats of harmonics of a model of `count` Gaussians; harmonics: [C] of chunks."""
    beats = LAYOUT_BEATS[harmonics]
    return int(beats.sum() * CHUNK - beats[-1:].sum() * (-count % CHUNK))


def image_of(
    header: ModelHeader, harmonics: np.ndarray, parts: Iterable[Rows], books: Rows
) -> np.ndarray:
    """Build the image of a model.

    header: the model's header
    harmonics: [C] layout of each chunk's harmonics, an index into `LAYOUTS`
    parts: rows of the tables of chunks and Gaussians, uint8 [N, size] each; the parts have whole
        chunks and follow each other
    books: rows of the codebooks' tables
    Returns uint8 [bytes].
    """
    layout = header.layout_of(beats_in_all(harmonics, header.count))
    image = np.zeros(layout.end, np.uint8)
    width, place, beat = header.format.position_record["x"].width, 0, 0

    def put(start: int, data: np.ndarray):
        image[start : start + data.size] = data.reshape(-1)

    put(0, header.image[: HEADER.size])
    for chunks, positions, attributes, *others in parts:
        first, count = place // CHUNK, len(positions)
        of = np.repeat(harmonics[first : first + len(chunks)], CHUNK)[:count]
        codes = np.stack([*header.format.position_record.unpack(positions).values()], axis=1)
        put(layout.chunks + first * header.format.header_stride, chunks)
        put(layout.positions + 3 * place * width // 8, pack_bits(codes.reshape(-1), width))
        if header.format.small:
            put(layout.attributes + place * attributes.shape[1], attributes)
        else:
            rows = _with_harmonics(of, attributes, others)
            put(layout.attributes + beat * rows.shape[1], rows)
            beat += len(rows)
        place += count
    put(layout.colours, books[0])
    put(layout.sh, books[1])
    return image


def _with_harmonics(of: np.ndarray, attributes: np.ndarray, others: Rows) -> np.ndarray:
    """Return the beats [B, 16] of Gaussians with layouts `of` [N]: attributes [N, 16], each
    followed by its beats of harmonics."""
    size = 1 + LAYOUT_BEATS[of]
    first = np.cumsum(size) - size
    stored = np.empty((int(size.sum()), attributes.shape[1]), np.uint8)
    stored[first] = attributes
    for part, number in zip(others, WITH_BEATS, strict=True):
        places = first[of == number][:, None] + 1 + np.arange(LAYOUTS[number].beats)
        stored[places] = part.reshape(*places.shape, attributes.shape[1])
    return stored


def parts_of(header: ModelHeader, harmonics: np.ndarray, rows: Rows) -> Iterator[Rows]:
    """Yield the rows of all tables of chunks and Gaussians, a batch of Gaussians at a time."""
    chunks, positions, attributes, *others = rows
    used = [0] * len(others)
    for batch in batches(header.count):
        own = slice(batch.start // CHUNK, chunk_count(batch.stop))
        of = np.repeat(harmonics[own], CHUNK)[: batch.stop - batch.start]
        starts, used = (
            used,
            [n + int((of == k).sum()) for n, k in zip(used, WITH_BEATS, strict=True)],
        )
        beats = [part[a:b] for part, a, b in zip(others, starts, used, strict=True)]
        yield [chunks[own], positions[batch], attributes[batch], *beats]


def difference(
    columns: list[np.ndarray], number: int, width: int, back: int, previous: int
) -> np.ndarray:
    """Return the codes [N] of column `number` as they are stored."""
    codes, mask = columns[number], columns[number].dtype.type((1 << width) - 1)
    if back:
        codes = codes - columns[number - back]
    if previous:
        codes = np.concatenate([codes[:1], codes[1:] - codes[:-1]])
    return codes & mask


def summed(
    stored: np.ndarray, columns: list[np.ndarray], width: int, back: int, previous: int
) -> np.ndarray:
    """Invert `difference`; columns: the columns before this one."""
    dtype = code_dtype(width)
    codes = stored.astype(dtype)
    if previous:
        codes = np.cumsum(codes, dtype=dtype)
    if back:
        codes = codes + columns[-back]
    return codes & codes.dtype.type((1 << width) - 1)


def distances(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance [N] of each row, uint8 [N, size], and the rows to be stored."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1]))).reshape(-1)
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    stored = np.zeros(len(rows), bool)
    stored[first] = True
    so_far = np.cumsum(stored)
    distance = so_far - so_far[first][which.reshape(-1)] + 1
    return np.where(stored, 0, distance).astype(code_dtype(DISTANCE.width)), rows[stored]


def places(distance: np.ndarray) -> np.ndarray | None:
    """Return each row's place [N] among the stored rows; None if a distance is impossible."""
    so_far = np.cumsum(distance == 0)
    place = so_far - np.maximum(distance.astype(np.int64), 1)
    return place if (place >= 0).all() else None
