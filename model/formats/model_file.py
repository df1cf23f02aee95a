"""Files of packed models: coded (`spec.coded`), or plain, the bytes of memory."""

import os
from collections.abc import Callable, Iterator

import numpy as np
import zstandard

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error
from splatcore.spec import coded, memory
from splatcore.spec.coded import DIFFERENCE, DISTANCE, FILE_HEADER, SIZE, Table
from splatcore.spec.error import InputError
from splatcore.spec.memory import ALIGNMENT, CHUNK_HEADER, HEADER
from splatcore.spec.model_header import ModelHeader
from splatcore.spec.number import code_dtype
from splatcore.spec.packed import PackedModel
from splatcore.spec.record import Record
from splatcore.spec.scene import LARGE

BLOCK = 1 << 12
"""Successive rows of a sample of columns of more than `LARGE` rows."""

LEVEL, FAST_LEVEL = 16, 1
"""Levels of zstd: the first with its optimal parser (higher levels take longer but save nothing),
and one for more than `LARGE` bytes that takes a hundredth of the time, for 2 % more bytes."""


def zstd(data: bytes) -> bytes:
    """Compress bytes to a zstd frame that states the size of its content."""
    return zstandard.compress(data, LEVEL if len(data) <= LARGE else FAST_LEVEL)


def is_packed(path: str | os.PathLike) -> bool:
    """True if the file begins like a packed model, coded or plain."""
    try:
        with open(path, "rb") as found:
            return int.from_bytes(found.read(4), "little") in (memory.MAGIC, coded.MAGIC)
    except OSError:
        return False


def read_model(path: str | os.PathLike) -> PackedModel:
    """Read a packed model, coded or plain; raises InputError that names the file and the field."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    if int.from_bytes(data[:4].tobytes(), "little") == coded.MAGIC:
        return PackedModel(decode(data.tobytes(), str(path)), str(path))
    return PackedModel(data, str(path))


def file_bytes(model: PackedModel, plain: bool = False) -> bytes:
    """The content of a model's file: coded if that is smaller, or with `plain` the bytes of
    memory."""
    if plain:
        return model.image.tobytes()
    data = encode(model)
    sound = len(data) < len(model.image) <= file.EXPANSION_MAX * len(data)
    if sound and np.array_equal(decode(data, model.name), model.image):
        return data
    return model.image.tobytes()


def encode(
    model: PackedModel,
    compress: Callable[[bytes], bytes] = zstd,
    differences: bool = True,
    repeats: bool = True,
) -> bytes:
    """Encode a model as a coded file.

    The other parameters serve to measure the gain of each technique:
    compress: compressor of a byte column; only zstd can be read back
    differences: store differences between columns or rows
    repeats: store repeated rows as references
    """
    head = {"magic": coded.MAGIC, "version": coded.VERSION}
    parts = [_packed(FILE_HEADER, head), model.image[: HEADER.size].tobytes()]
    for table, rows in coded.rows_of(model):
        if table.repeats:
            distance, kept = coded.distances(rows)
            if not repeats:
                distance, kept = np.zeros_like(distance), rows
            parts += _column([distance], 0, DISTANCE.width, compress, False)
            rows = kept
        columns = table.columns(rows)
        for number, width in enumerate(table.widths):
            parts += _column(columns, number, width, compress, differences)
    return b"".join(parts)


def _packed(record: Record, values: dict[str, int]) -> bytes:
    """Bytes of one record of integers."""
    return record.pack({name: np.array([value]) for name, value in values.items()}).tobytes()


def _column(
    columns: list[np.ndarray], number: int, width: int, compress, differences: bool
) -> Iterator[bytes]:
    """Yield the bytes of a column, coded with the difference of the lowest entropy (`differences`),
    or without one."""
    if not len(columns[number]):
        return
    back, previous = _choice(columns[: number + 1], width) if differences else (0, 0)
    stored = coded.difference(columns, number, width, back, previous)
    yield _packed(DIFFERENCE, {"back": back, "previous": previous})
    for part in _byte_columns(stored, width):
        frame = compress(part.tobytes())
        yield _packed(SIZE, {"bytes": len(frame)}) + frame


def _choice(columns: list[np.ndarray], width: int) -> tuple[int, int]:
    """`back` and `previous` of the difference of the last column with the lowest entropy."""
    columns = [_sample(column) for column in columns[-coded.BACK_MAX - 1 :]]
    number, best = len(columns) - 1, (np.inf, 0, 0)
    for back in range(number + 1):
        if columns[number - back].dtype == columns[number].dtype:
            for previous in range(2):
                stored = coded.difference(columns, number, width, back, previous)
                entropy = sum(map(_entropy, _byte_columns(stored, width)))
                best = min(best, (entropy, back, previous))
    return best[1:]


def _sample(column: np.ndarray) -> np.ndarray:
    """A column, or blocks from all over it if it is long."""
    if len(column) <= LARGE:
        return column
    blocks = column[: len(column) // BLOCK * BLOCK].reshape(-1, BLOCK)
    return blocks[:: len(column) // LARGE + 1].reshape(-1)


def _byte_columns(codes: np.ndarray, width: int) -> Iterator[np.ndarray]:
    """The byte columns of codes [N], lowest byte first."""
    return ((codes >> codes.dtype.type(8 * k)).astype(np.uint8) for k in range(-(-width // 8)))


def _entropy(part: np.ndarray) -> float:
    """Size in bits of bytes [N] under ideal entropy coding."""
    count = np.bincount(part)
    count = count[count > 0]
    return float(-(count * np.log2(count / len(part))).sum())


def decode(data: bytes, name: str) -> np.ndarray:
    """Decode a coded file to the image in memory; raises InputError naming file and field.

    All sizes are checked before memory is allocated: against the size of the file, then against the
    header. The model's own checksum finds other damage.
    """
    begin = FILE_HEADER.size + HEADER.size
    if len(data) < begin:
        raise input_error(name, f"header is cut off: {len(data)} bytes, not {begin}")
    array = np.frombuffer(data, np.uint8)
    head = FILE_HEADER.unpack(array[: FILE_HEADER.size].reshape(1, -1))
    if head["version"][0] != coded.VERSION:
        raise input_error(name, f"file version {head['version'][0]} is not {coded.VERSION}")
    header = ModelHeader(array[FILE_HEADER.size : begin], name)
    end = header.value("end") * ALIGNMENT
    file.check_expansion(end, len(data), f"{name}: end")
    if header.layout_of(0).end > end:
        raise input_error(name, f"count {header.count} needs more bytes than end, {end}")
    reader = _Reader(data, begin, name)
    first = reader.rows(coded.chunk_table(header))
    headers = np.ascontiguousarray(first[:, -CHUNK_HEADER.size :])
    harmonics = CHUNK_HEADER.unpack(headers)["harmonics"]
    others = coded.tables(header, harmonics)
    beats = sum(table.count * len(table.records) for table in others if table.repeats)
    if header.layout_of(beats).end != end:
        raise input_error(name, f"end {end} does not match {beats} beats of harmonics")
    rows = [first, *(reader.rows(table) for table in others)]
    if reader.at != len(data):
        raise input_error(name, f"{len(data) - reader.at} bytes follow the last column")
    parts = coded.parts_of(header, harmonics, rows[:-2])
    return coded.image_of(header, harmonics, parts, rows[-2:])


class _Reader:
    """Reads the tables of a coded file, one after the other."""

    def __init__(self, data: bytes, at: int, name: str):
        self.data, self.at, self.name = data, at, name
        self.decompressor = zstandard.ZstdDecompressor()

    def rows(self, table: Table) -> np.ndarray:
        """Read the rows of the next table."""
        count, place = table.count, None
        if table.repeats and count:
            distance = self.column([], DISTANCE.width, count, f"{table.name} distance")
            place = coded.places(distance)
            if place is None:
                raise input_error(self.name, f"{table.name} distance: points before the first row")
            count = int((distance == 0).sum())
        columns: list[np.ndarray] = []
        for number, width in enumerate(table.widths):
            where = f"{table.name} column {number}"
            columns.append(self.column(columns, width, count, where))
        rows = table.rows(columns)
        return rows if place is None else rows[place]

    def column(self, columns: list[np.ndarray], width: int, count: int, where: str) -> np.ndarray:
        """Read the next column of a table, after `columns`."""
        dtype = code_dtype(width)
        codes = np.zeros(count, dtype)
        if not count:
            return codes
        about = DIFFERENCE.unpack(self.record(DIFFERENCE, where))
        back, previous = int(about["back"][0]), int(about["previous"][0])
        if back > len(columns) or (back and columns[-back].dtype != dtype):
            raise input_error(self.name, f"{where}: refers to a wrong column, {back} before it")
        for k in range(-(-width // 8)):
            codes |= self.part(count, f"{where} byte {k}").astype(dtype) << dtype.type(8 * k)
        return coded.summed(codes, columns, width, back, previous)

    def record(self, record: Record, where: str) -> np.ndarray:
        """Read the bytes of one record."""
        return np.frombuffer(self.take(record.size, where), np.uint8).reshape(1, -1)

    def part(self, count: int, where: str) -> np.ndarray:
        """Decode the next zstd frame, which must hold `count` bytes."""
        size = int(SIZE.unpack(self.record(SIZE, where))["bytes"][0])
        frame = self.take(size, where)
        with file.reading(f"{self.name}: {where}", "is not a zstd frame"):
            found = zstandard.frame_content_size(frame)
            if found != count:
                raise input_error(self.name, f"{where}: claims {found} bytes, not {count}")
            data = self.decompressor.decompress(frame, allow_extra_data=False)
        return np.frombuffer(data, np.uint8)

    def take(self, size: int, where: str) -> bytes:
        """Read the next `size` bytes."""
        if size > len(self.data) - self.at:
            left = len(self.data) - self.at
            raise input_error(self.name, f"{where}: needs {size} bytes, only {left} are left")
        self.at += size
        return self.data[self.at - size : self.at]
