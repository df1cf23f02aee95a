"""SPZ scenes, versions 1 to 4: every section decoded, axes converted, malformed files refused."""

import gzip
import struct

import gsply
import numpy as np
import pytest
import zstandard

from splatcore.model.formats import spz
from splatcore.model.formats.read import read_scene
from splatcore.model.formats.spz import COORDINATES, EXTENDED
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS, rotation_matrix
from tb.helpers.refusal import refused
from tb.helpers.scene_file import (
    check_bad_scene,
    check_refused,
    read_written,
    smallest_three,
    splat_bytes,
    spz_bytes,
    spz_codes,
)
from tb.helpers.scenes import random_scene

VERSIONS = (1, 2, 3, 4)

RUB = (
    "the SPZ file does not state its axes; read as RUB, the format's default; "
    "choose others by --axes"
)
"""The note on a file without a record of its axes."""


def read(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.spz", data)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("degree", range(4))
def test_every_section(tmp_path, version, degree):
    """Positions, opacities, colours and scales by the format's formulas, with y and z negated."""
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
    assert (scene.sh_degree, scene.name) == (degree, f"{tmp_path}/scene.spz")
    faint = int((scene.opacity < 1 / 255).sum())
    note = f"{faint} transparent Gaussians (opacity below 1/255)"
    assert scene.notes == ((RUB, note) if faint else (RUB,))


@pytest.mark.parametrize("version", VERSIONS)
def test_quaternions(tmp_path, version):
    """Rotations of known quaternions, packed here in RUB axes by the format's description."""
    count = 500
    quaternion = random_scene(count, 0).quaternion
    xyzw = (quaternion * [1, 1, -1, -1])[:, [1, 2, 3, 0]]
    codes = spz_codes(version, count, 0)
    if version < 3:
        xyzw *= np.where(xyzw[:, 3:] < 0, -1, 1)
        codes[4] = np.round((xyzw[:, :3] + 1) * 127.5).astype(np.uint8)
        bound = 0.2  # measured 0.143: w comes from the norm, coarse if it is small
    else:
        codes[4] = np.stack([smallest_three(q) for q in xyzw])
        bound = 0.004  # measured 0.0027: steps of 1/(511·√2)
    scene = read(tmp_path, spz_bytes(version, codes, 0))
    error = np.abs(rotation_matrix(scene.quaternion) - rotation_matrix(quaternion))
    assert error.max() < bound


def extended(version: int, *records: bytes) -> bytes:
    """A file of four Gaussians with extension records."""
    codes, added = spz_codes(version, 4, 1), b"".join(records)
    return spz_bytes(version, codes, 1, flags=EXTENDED, records=added)


UNKNOWN = struct.pack("<II3s", 0x12340001, 3, b"abc")
"""An extension that no reader knows."""


def record(axes: int) -> bytes:
    return struct.pack("<III", COORDINATES, 4, axes)


@pytest.mark.parametrize("version", VERSIONS)
def test_stated_axes(tmp_path, version):
    """A record states the axes, without a note; 0 and a missing record state nothing."""
    plain = read(tmp_path, spz_bytes(version, spz_codes(version, 4, 1), 1))
    for number, axes in ((4, "RUB"), (6, "RDF"), (0, ""), (None, "")):
        records = (UNKNOWN,) if number is None else (UNKNOWN, record(number))
        scene = read(tmp_path, extended(version, *records))
        turn = [1, 1, 1] if axes != "RDF" else [1, -1, -1]
        assert np.array_equal(scene.position, plain.position * turn)
        assert scene.notes == (() if axes else (RUB,))
        assert scene.assumed_axes == ("" if axes else "RUB")


@pytest.mark.parametrize("version", VERSIONS)
def test_odd_extensions(tmp_path, version):
    """Unknown axes are refused; a few bytes that form no record are noted."""
    for number in (17, 2**32 - 1):
        message = f"extension 'coordinate system' is {number}, not 0 … 16"
        check_bad_scene(tmp_path / "scene.spz", extended(version, record(number)), message)
    short = struct.pack("<II", COORDINATES, 2) + b"ab"
    check_bad_scene(tmp_path / "scene.spz", extended(version, short), "'coordinate system' is -1")
    if version > 1:
        scene = read(tmp_path, extended(version, record(6), b"abc"))
        assert scene.notes == ("3 bytes belong to no Gaussian and are not read",)


@pytest.mark.parametrize("version", VERSIONS)
def test_axes_for_a_file_that_states_none(tmp_path, version):
    path = tmp_path / "scene.spz"
    path.write_bytes(spz_bytes(version, spz_codes(version, 4, 1), 1))
    plain, other = spz.read(path), spz.read(path, "RDF")
    assert np.array_equal(other.position, plain.position * [1, -1, -1])
    assert other.notes == ("the SPZ file does not state its axes; read as RDF, by --axes",)
    assert (plain.assumed_axes, other.assumed_axes) == ("RUB", "")
    path.write_bytes(extended(version, record(4)))
    refused(r"--axes RDF: the file states its axes, RUB", spz.read, path, "RDF")


def test_axes_of_other_formats_are_refused(tmp_path):
    (tmp_path / "a.splat").write_bytes(splat_bytes(2))
    refused(
        r"a.splat: --axes RDF: only SPZ, glTF and USD files",
        read_scene,
        tmp_path / "a.splat",
        "RDF",
    )


@pytest.mark.parametrize("version", (1, 2, 3))
@pytest.mark.parametrize("claimed", (1, 3))
def test_more_gaussians_than_the_header_says(tmp_path, version, claimed):
    """A wrong count would misplace all sections: refused, with both counts in the message."""
    codes = spz_codes(version, 4, 1)
    raw = gzip.decompress(spz_bytes(version, codes, 1))
    data = raw[:8] + struct.pack("<I", claimed) + raw[12:]
    size = len(raw[16:]) // 4 * claimed
    message = f"bytes, as many as 4 Gaussians have, not the {size} of {claimed} Gaussians"
    check_bad_scene(tmp_path / "scene.spz", gzip.compress(data), message)


@pytest.mark.parametrize("held, claim", [(2, 1), (3, 1), (3, 2)])
def test_version_that_is_not_held(tmp_path, held, claim):
    """Positions of version 2, read as version 1, would be NaN: the file is refused."""
    raw = gzip.decompress(spz_bytes(held, spz_codes(held, 50, 1), 1))
    data = raw[:4] + struct.pack("<I", claim) + raw[8:]
    message = f"of 50 Gaussians of SH degree 1 in version {claim}"
    check_bad_scene(tmp_path / "scene.spz", gzip.compress(data), message)


def test_few_bytes_after_the_gaussians(tmp_path):
    raw = gzip.decompress(spz_bytes(3, spz_codes(3, 40, 1), 1))
    note = "9 bytes belong to no Gaussian and are not read"
    assert read(tmp_path, gzip.compress(raw + b"extension")).notes[:2] == (note, RUB)
    assert read(tmp_path, ZIPPED + b"extension").notes[:2] == (note, RUB)
    raw = gzip.decompress(spz_bytes(1, spz_codes(1, 40, 1), 1))
    check_bad_scene(tmp_path / "scene.spz", gzip.compress(raw + b"x"), "in version 1")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("sized", [False, True])
def test_degree_4(tmp_path, version, sized):
    """The fourth band is left out with a note; the rest is read as from a file of degree 3."""
    codes = spz_codes(version, 40, 4)
    lower = [*codes[:5], codes[5][:, :45]]  # a coefficient's three channels are together
    flags, records = EXTENDED | spz.ANTIALIASED, UNKNOWN + record(6)
    files = [
        spz_bytes(version, each, degree, 10, flags, records)
        for degree, each in ((4, codes), (3, lower))
    ]
    if version == 4 and not sized:  # streams whose frames state no size
        files[0] = spz_bytes(4, codes, 4, 10, flags, records, content_size=False)
    scene, other = (read(tmp_path, data) for data in files)
    assert (scene.sh_degree, scene.antialiased) == (3, True)
    for name in ARRAYS:
        assert np.array_equal(getattr(scene, name), getattr(other, name))
    left_out = "harmonics of degree 4 left out; kept up to 3"
    assert scene.notes == (left_out, *other.notes) and left_out not in other.notes


def test_bad_streams_of_degree_4(tmp_path):
    """Streams that are unpacked here are as bounded as those that gsply unpacks."""
    data = spz_bytes(4, spz_codes(4, 4, 4), 4)
    stored = struct.unpack_from("<Q", data, 32)[0]

    def first(frame: bytes) -> bytes:
        return _zipped(32, "<Q", len(frame), data[:128] + frame + data[128 + stored :])

    unsized = zstandard.ZstdCompressor(write_content_size=False)
    for message, stream in {
        "stream 0: cannot be read": zstandard.compress(bytes(36))[:-1],
        "stream 0: cannot be read ": unsized.compress(bytes(1 << 24)),
        "stream 0: holds 35 bytes, not 36": unsized.compress(bytes(35)),
    }.items():
        check_bad_scene(tmp_path / "scene.spz", first(stream), message)
    raw = gzip.decompress(spz_bytes(3, spz_codes(3, 4, 4), 4))
    check_bad_scene(tmp_path / "scene.spz", gzip.compress(raw[:-1]), "of SH degree 4")


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
    "version 5 is not supported": _raw(4, "<I", 5),
    "version 0 is not supported": _raw(4, "<I", 0),
    "version 4 is not supported": _raw(4, "<I", 4),
    "holds 0 Gaussians": _raw(8, "<I", 0),
    "holds 112 of the 140 bytes": _raw(8, "<I", 5),
    "holds 111 of the 112 bytes of 4 Gaussians of SH degree 1": gzip.compress(RAW[:-1]),
    "too many for": _raw(8, "<I", 2**32 - 1),
    "SH degree 5": _raw(12, "<B", 5),
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
    "stream 0 is not a zstd stream": _first_stream(b"no zstd" * 9),
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
    check_refused(spz.read, tmp_path / "scene.spz", "is not an SPZ file")


def test_no_scratch_file_in_an_error(tmp_path, monkeypatch):
    """Version 1 is converted through a scratch file, which messages must not name."""

    def fail(path):
        raise ValueError(f"{path} is odd")

    monkeypatch.setattr(gsply, "read_spz", fail)
    with pytest.raises(InputError) as error:
        read(tmp_path, spz_bytes(1, spz_codes(1, 4, 1), 1))
    path = tmp_path / "scene.spz"
    assert str(error.value) == f"{path}: cannot be read ({path} is odd)"
