"""SPZ scenes, versions 1 to 4. Source: github.com/nianticlabs/spz; `gsply` decodes the sections.

gsply hardly checks its input before its compiled loops allocate and run, so header, sizes and
streams are checked here first. Axes are stated in the file, or chosen by the caller, or RUB
(`spz_axes`). splat-transform, GaussForge, gsply and spz-js store the numbers of a PLY, in RDF axes.
"""

import gzip
import os
import struct
import zlib
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import zstandard

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error
from splatcore.model.formats.spz_axes import AXES, SPZ_AXES, turned
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.scene import Scene, sh_count

SPZ_MAGIC = b"NGSP"
"""Begins a header: inside the gzip stream of version 1 to 3 (header and sections), or a file of
version 4 (one zstd stream per section)."""

DEGREE_MAX = 4  # of files; degree 4 is left out

FRACTION_MAX = 24  # largest number of fractional bits of a position, which has 24 bits

ANTIALIASED = 1
"""Flag of a scene trained with opacity compensation. Its absence means nothing: converters drop
it."""

EXTENDED = 2
"""Flag of a file with extensions: records of type, size in bytes (both uint32) and content."""

EXTENSION_MAX = 1 << 20  # bytes that may follow the sections of a gzip stream

COORDINATES = 0xADBE0003
"""Type of the extension SPZ_ADOBE_coordinate_system: the axes of the file, one uint32."""


@dataclass(frozen=True)
class Header:
    """The header, common to all versions."""

    version: int
    count: int  # Gaussians
    degree: int  # of the harmonics
    fraction: int  # fractional bits of a position
    flags: int

    @property
    def sections(self) -> list[int]:
        """Sizes of the sections in bytes, in file order."""
        position = 6 if self.version == 1 else 9  # three half floats, or 3 × 24 bit
        quaternion = 3 if self.version < 3 else 4
        sh = 3 * (sh_count(self.degree) - 1)
        return [self.count * size for size in (position, 1, 3, 3, quaternion, sh) if size]

    def __str__(self) -> str:
        return f"{self.count} Gaussians of SH degree {self.degree}"


class Content(NamedTuple):
    """The checked content of a file."""

    header: Header
    sections: list[memoryview]
    records: bytes  # of extensions
    rest: int = 0  # number of bytes that belong to none of these


def read(path: str | os.PathLike, axes: str | None = None) -> Scene:
    """Read the scene of an SPZ file, converted to the axes of PLY.

    axes: one of `AXES`, for a file that does not state its axes (default: RUB, as specified)
    Raises InputError if axes are given for a file that states its own.
    """
    data = file.read_bytes(path)
    if data.startswith(SPZ_MAGIC):
        content = _check_streams(data, path)
    elif data.startswith(file.GZIP_MAGIC):
        content = _gunzip(data, path)
    else:
        raise input_error(path, "is not an SPZ file")
    del data  # unpacked by now
    header = content.header
    stated, records = _stated_axes(header, content.records, path)
    if header.version < 4 and records:
        _check_surplus(header, len(records), path)
    if axes and stated:
        raise input_error(path, f"--axes {axes}: the file states its axes, {stated}")
    sections = [np.frombuffer(s, np.uint8).reshape(header.count, -1) for s in content.sections]

    def convert(rows: slice) -> Scene:
        some = _decode(
            replace(header, count=rows.stop - rows.start), [s[rows] for s in sections], path
        )
        return turned(some, stated or axes or SPZ_AXES)

    scene = file.in_batches(header.count, convert)
    if header.flags & ANTIALIASED:
        scene = replace(scene, antialiased=True, mark="SPZ flag")
    notes = file.surplus(content.rest + len(records))
    if header.degree > SH_DEGREE_MAX:
        notes += (f"harmonics of degree {header.degree} left out; kept up to {SH_DEGREE_MAX}",)
    if not stated:
        by = "by --axes" if axes else "the format's default; choose others by --axes"
        notes += (f"the SPZ file does not state its axes; read as {axes or SPZ_AXES}, {by}",)
    return replace(scene, notes=notes, assumed_axes="" if stated or axes else SPZ_AXES)


def _header(data: bytes, versions: range, path: str | os.PathLike) -> Header:
    """Parse and check the first 16 bytes, common to all versions."""
    if len(data) < 16 or not data.startswith(SPZ_MAGIC):
        raise input_error(path, "has no SPZ header")
    header = Header(*struct.unpack_from("<IIBBB", data, 4))
    if header.version not in versions:
        raise input_error(path, f"SPZ version {header.version} is not supported")
    if header.degree > DEGREE_MAX:
        raise input_error(path, f"SH degree {header.degree} is not supported")
    if not 1 <= header.fraction <= FRACTION_MAX:
        raise input_error(path, f"{header.fraction} fractional bits, not 1 … {FRACTION_MAX}")
    return header


def _check_size(header: Header, stored: int, path: str | os.PathLike):
    """Raise InputError if a file of `stored` bytes cannot hold its Gaussians, or memory cannot."""
    file.check_expansion(sum(header.sections), stored, path)
    file.check_count(header.count, path, header.degree)


def _gunzip(data: bytes, path: str | os.PathLike) -> Content:
    """Unpack a file of version 1 to 3, never more than its header claims."""
    with file.reading(path):
        stream = zlib.decompressobj(16 + zlib.MAX_WBITS)
        header = _header(stream.decompress(data, 16), range(1, 4), path)
        size = sum(header.sections)
        _check_size(header, len(data), path)
        payload = stream.decompress(stream.unconsumed_tail, size + EXTENSION_MAX)
    if len(payload) < size:
        raise input_error(path, f"holds {len(payload)} of the {size} bytes of {header}")
    if not stream.eof:
        raise input_error(path, "gzip stream is cut off or longer than its header says")
    if stream.unused_data:
        raise input_error(path, f"{len(stream.unused_data)} bytes follow the gzip stream")
    ends = np.cumsum([0, *header.sections]).tolist()
    sections = [memoryview(payload)[start:end] for start, end in pairwise(ends)]
    return Content(header, sections, payload[size:])


def _check_surplus(header: Header, rest: int, path: str | os.PathLike):
    """Raise InputError if `rest` bytes after the sections show that the header's count, degree or
    version is wrong, so that sections would be read at wrong places."""
    file.check_degree(header.degree, header.count, 1, rest, path)
    size = sum(header.sections)
    row = size // header.count
    if header.version == 1 or rest >= min(row, header.count):
        held = f", as many as {(size + rest) // row} Gaussians have" if rest >= row else ""
        raise input_error(
            path,
            f"holds {size + rest} bytes{held}, not the {size} of {header} in version "
            f"{header.version}",
        )


def _check_streams(data: bytes, path: str | os.PathLike) -> Content:
    """Check a file of version 4: header, table of contents and zstd streams."""
    header = _header(data, range(4, 5), path)
    _check_size(header, len(data), path)
    if len(data) < 32:
        raise input_error(path, "header is cut off")
    streams, toc = struct.unpack_from("<BI", data, 15)
    if streams != len(header.sections):
        raise input_error(path, f"{streams} streams, not {len(header.sections)} of {header}")
    start, sections = toc + 16 * streams, []
    if toc < 32 or start > len(data):
        raise input_error(path, f"table of contents at byte {toc} is outside the file")
    for index, size in enumerate(header.sections):
        stored, claimed = struct.unpack_from("<QQ", data, toc + 16 * index)
        if claimed != size:
            raise input_error(path, f"stream {index} has {claimed} bytes, not {size} of {header}")
        if start + stored > len(data):
            raise input_error(path, f"stream {index} is cut off")
        stream = memoryview(data)[start : start + stored]
        with file.reading(path, f"stream {index} is not a zstd stream"):
            content = zstandard.frame_content_size(stream)  # −1: not stated
        if content not in (-1, size):
            raise input_error(path, f"stream {index} holds {content} bytes, not {size}")
        sections.append(memoryview(_unpacked(stream, size, f"{path}: stream {index}")))
        start += stored
    return Content(header, sections, data[32:toc], len(data) - start)


def _unpacked(stream: memoryview, size: int, where: str) -> bytes:
    """The `size` bytes of a zstd stream."""
    with file.reading(where):
        found = zstandard.ZstdDecompressor().decompress(stream, max_output_size=size)
    if len(found) != size:
        raise input_error(where, f"holds {len(found)} bytes, not {size}")
    return found


def _stated_axes(
    header: Header, records: bytes, path: str | os.PathLike
) -> tuple[str | None, bytes]:
    """Axes stated by extension records (None: not stated), and the bytes that are no records.

    Other extensions do not change the Gaussians. Raises InputError for an unknown number of axes.
    """
    axes = None
    while header.flags & EXTENDED and len(records) >= 8:
        kind, size = struct.unpack_from("<II", records)
        if len(records) < 8 + size:
            break
        if kind == COORDINATES:
            number = struct.unpack_from("<I", records, 8)[0] if size >= 4 else -1
            if not 0 <= number <= len(AXES):
                fault = f"is {number}, not 0 … {len(AXES)}"
                raise input_error(path, f"extension 'coordinate system' {fault}")
            axes = AXES[number - 1] if number else None
        records = records[8 + size :]
    return axes, records


def _decode(header: Header, sections: list[np.ndarray], path: str | os.PathLike) -> Scene:
    """Decode sections [N, bytes] by gsply, from a temporary file in which those that it does not
    support are replaced: half-float positions (version 1) by zeros, harmonics of degree 4 by their
    first three degrees.
    """
    import gsply  # imports numba, which takes a third of a second

    parts, degree = list(sections), min(header.degree, SH_DEGREE_MAX)
    if header.version == 1:
        parts[0] = np.zeros((header.count, 9), np.uint8)
    if degree < header.degree:  # a coefficient's red, green and blue are together
        parts[5] = parts[5][:, : 3 * (sh_count(degree) - 1)]
    version = min(max(header.version, 2), 3)  # 1 and 2, 3 and 4 have the same rotations
    start = SPZ_MAGIC + struct.pack("<IIBBxx", version, header.count, degree, header.fraction)
    content = gzip.compress(start + b"".join(part.tobytes() for part in parts), compresslevel=0)
    with file.copied(content, ".spz", path) as copy, file.reading(path):
        data = gsply.read_spz(copy)
    position = data.means
    if header.version == 1:
        position = np.ascontiguousarray(sections[0]).view("<f2")
    higher = data.shN if data.shN is not None and data.shN.size else None
    arrays = position, data.scales, data.quats, file.sigmoid(data.opacities), data.sh0, higher
    return file.stored_scene(path, *arrays)
