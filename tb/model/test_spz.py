"""SPZ scenes, versions 1 to 4: every section decoded, axes turned, malformed files refused."""

import gzip
import struct

import gsply
import numpy as np
import pytest
import zstandard

from splatcore.model.formats import spz
from splatcore.model.formats.spz import COORDINATES, EXTENDED, turned
from splatcore.spec.error import InputError
from splatcore.spec.scene import rotation_matrix
from tb.helpers.harmonics import harmonics
from tb.helpers.scene_file import check_bad_scene, check_refused, read_written, spz_bytes, spz_codes
from tb.helpers.scenes import random_scene

VERSIONS = (1, 2, 3, 4)


def read(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.spz", data)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("degree", range(4))
def test_every_section(tmp_path, version, degree):
    """Positions, opacities, colours and scales by the formulas of the format; y, z negated."""
    codes = spz_codes(version, 50, degree)
    scene = read(tmp_path, spz_bytes(version, codes, degree, fraction=10))
    position, alpha, colour, scale = (code.astype(np.int64) for code in codes[:4])
    if version == 1:
        position = codes[0].view("<f2").astype(float)
    else:
        high = codes[0].view(np.int8)[:, 2::3].astype(int)  # the top byte has the sign
        position = (position[:, ::3] + 256 * position[:, 1::3] + 65536 * high) / 2**10
    assert np.array_equal(scene.position, position * [1, -1, -1])
    assert np.abs(scene.opacity - alpha[:, 0] / 255).max() < 2e-6  # gsply keeps 1e-6 from 0 and 1
    assert np.abs(scene.sh[:, 0] - (colour / 255 - 0.5) / 0.15).max() < 1e-6
    assert np.abs(np.log(scene.scale) - (scale / 16 - 10)).max() < 1e-12
    assert (scene.sh_degree, scene.notes, scene.name) == (degree, (), f"{tmp_path}/scene.spz")


@pytest.mark.parametrize("version", VERSIONS)
def test_quaternions(tmp_path, version):
    """Rotations of known quaternions survive: packed here as the format says, from RUB axes."""
    count = 500
    quaternion = random_scene(count, 0).quaternion
    xyzw = (quaternion * [1, 1, -1, -1])[:, [1, 2, 3, 0]]
    codes = spz_codes(version, count, 0)
    if version < 3:
        xyzw *= np.where(xyzw[:, 3:] < 0, -1, 1)
        codes[4] = np.round((xyzw[:, :3] + 1) * 127.5).astype(np.uint8)
        bound = 0.2  # measured 0.143: w comes from the norm, coarse where it is small
    else:
        codes[4] = np.stack([_smallest_three(q) for q in xyzw])
        bound = 0.004  # measured 0.0027: steps of 1/(511·√2)
    scene = read(tmp_path, spz_bytes(version, codes, 0))
    error = np.abs(rotation_matrix(scene.quaternion) - rotation_matrix(quaternion))
    assert error.max() < bound


def _smallest_three(q: np.ndarray) -> np.ndarray:
    """(x, y, z, w) as 2 bits for the largest, then sign and 9 bits for each of the others."""
    largest = int(np.argmax(np.abs(q)))
    word = largest
    for i in set(range(4)) - {largest}:
        value = q[i] * np.sign(q[largest])
        word = word << 10 | (value < 0) << 9 | round(min(abs(value) * np.sqrt(2), 1) * 511)
    return np.frombuffer(struct.pack("<I", word), np.uint8)


def test_turned_scene_looks_the_same():
    """The turned coefficients give in the turned direction the colour that they gave before,
    and the turned covariance is that of the turned shape.
    """
    scene = random_scene(200, 3)
    back = turned(scene)
    turn = np.diag([1.0, -1.0, -1.0])
    direction = np.random.default_rng(5).normal(size=(200, 3))
    colour = np.einsum("nk,nkc->nc", harmonics(direction, 3), scene.sh)
    colour_back = np.einsum("nk,nkc->nc", harmonics(direction @ turn, 3), back.sh)
    assert np.abs(colour - colour_back).max() < 1e-12
    factor, factor_back = scene.gaussians().factor, turn @ back.gaussians().factor
    covariance = factor @ factor.transpose(0, 2, 1)
    assert np.abs(covariance - factor_back @ factor_back.transpose(0, 2, 1)).max() < 1e-12
    assert np.array_equal(back.position, scene.position @ turn)
    assert np.array_equal(turned(back).sh, scene.sh)


def test_trailing_extension_is_allowed(tmp_path):
    """Bytes after the sections of a gzip stream belong to extensions."""
    codes = spz_codes(3, 4, 1)
    raw = gzip.decompress(spz_bytes(3, codes, 1))
    assert len(read(tmp_path, gzip.compress(raw + b"extension"))) == 4


def _extended(version: int, axes: int) -> bytes:
    """A file with two extensions: one that no reader knows, and its axes."""
    records = struct.pack("<II3s", 0x12340001, 3, b"abc")
    records += struct.pack("<III", COORDINATES, 4, axes)
    data = spz_bytes(version, spz_codes(version, 4, 1), 1)
    data = data if version == 4 else gzip.decompress(data)
    data = data[:14] + bytes([EXTENDED]) + data[15:]
    if version < 4:
        return gzip.compress(data + records)
    return data[:16] + struct.pack("<I", 32 + len(records)) + data[20:32] + records + data[32:]


@pytest.mark.parametrize("version", VERSIONS)
def test_axes_other_than_rub_are_refused(tmp_path, version):
    """An extension may state the axes: 4 is RUB, 6 is RDF, which PLY has."""
    plain = read(tmp_path, spz_bytes(version, spz_codes(version, 4, 1), 1))
    assert np.array_equal(read(tmp_path, _extended(version, 4)).sh, plain.sh)
    message = "'coordinate system' is 6, not 4 (RUB)"
    check_bad_scene(tmp_path / "scene.spz", _extended(version, 6), message)


CODES = spz_codes(2, 4, 1)
RAW = gzip.decompress(spz_bytes(2, CODES, 1))
ZIPPED = spz_bytes(4, spz_codes(4, 4, 1), 1)
FRAME = zstandard.compress(bytes(4 * 9))


def _zipped(offset: int, layout: str, value: int, data: bytes = ZIPPED) -> bytes:
    """A version 4 file with one field replaced."""
    size = struct.calcsize(layout)
    return data[:offset] + struct.pack(layout, value) + data[offset + size :]


def _raw(offset: int, layout: str, value: int) -> bytes:
    """A version 2 file with one field of its header replaced."""
    return gzip.compress(_zipped(offset, layout, value, RAW))


def _first_stream(frame: bytes) -> bytes:
    """A version 4 file whose first stream is `frame`."""
    stored = struct.unpack_from("<Q", ZIPPED, 32)[0]
    return _zipped(32, "<Q", len(frame), ZIPPED[:128] + frame + ZIPPED[128 + stored :])


BAD = {
    "has no SPZ header": gzip.compress(b"something else entirely"),
    "has no SPZ header ": gzip.compress(RAW[:9]),
    "version 5 is not known": _raw(4, "<I", 5),
    "version 0 is not known": _raw(4, "<I", 0),
    "version 4 is not known": _raw(4, "<I", 4),
    "holds 0 Gaussians": _raw(8, "<I", 0),
    "holds 112 of the 140 bytes": _raw(8, "<I", 5),
    "holds 111 of the 112 bytes of 4 Gaussians of SH degree 1": gzip.compress(RAW[:-1]),
    "too many for": _raw(8, "<I", 2**32 - 1),
    "SH degree 4": _raw(12, "<B", 4),
    "0 fractional bits": _raw(13, "<B", 0),
    "25 fractional bits": _raw(13, "<B", 25),
    "cannot be read": gzip.compress(RAW)[:3] + b"\xff" * 20,
    "cut off or longer": gzip.compress(RAW + bytes(1 << 21)),
    "cut off or longer ": gzip.compress(RAW)[:-4],
    "incorrect data check": gzip.compress(RAW)[:-8] + bytes(8),
    "bytes follow the gzip stream": gzip.compress(RAW) * 2,
    "SPZ version 3": _zipped(4, "<I", 3),
    "holds 0 Gaussians ": _zipped(8, "<I", 0),
    "too many for ": _zipped(8, "<I", 2**32 - 1),
    "header is cut off": ZIPPED[:20],
    "has no SPZ header  ": ZIPPED[:12],
    "5 streams, not 6": _zipped(15, "<B", 5),
    "at byte 31": _zipped(16, "<I", 31),
    "at byte 100000": _zipped(16, "<I", 100_000),
    "stream 2 has 13 bytes, not 12": _zipped(32 + 2 * 16 + 8, "<Q", 13),
    "stream 0 is cut off": _zipped(32, "<Q", 2**63),
    "stream 5 is cut off": ZIPPED[:-1],
    "stream 0 is no zstd stream": _first_stream(b"no zstd" * 9),
    "stream 0 holds 1048576 bytes": _first_stream(zstandard.compress(bytes(1 << 20))),
    "cannot be read ": _first_stream(FRAME[:-1]),
    "mismatch": _first_stream(
        zstandard.ZstdCompressor(write_content_size=False).compress(bytes(35))
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    check_bad_scene(tmp_path / "scene.spz", BAD[message], message)


def test_other_file(tmp_path):
    (tmp_path / "scene.spz").write_bytes(b"hello")
    check_refused(spz.read, tmp_path / "scene.spz", "is no SPZ file")


def test_no_scratch_file_in_an_error(tmp_path, monkeypatch):
    """Version 1 goes through a file of another version, whose name is nobody's business."""

    def fail(path):
        raise ValueError(f"{path} is odd")

    monkeypatch.setattr(gsply, "read_spz", fail)
    with pytest.raises(InputError) as told:
        read(tmp_path, spz_bytes(1, spz_codes(1, 4, 1), 1))
    path = tmp_path / "scene.spz"
    assert str(told.value) == f"{path}: cannot be read ({path} is odd)"
