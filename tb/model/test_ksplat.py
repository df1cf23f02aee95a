"""KSPLAT scenes: every field decoded, buckets and sections, malformed files."""

import struct

import numpy as np
import pytest

from tb.helpers.ksplat_file import (
    BLOCK,
    HALF_STEPS,
    bucket_of,
    codes,
    ksplat_bytes,
    section,
    small_ksplat,
)
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_bad_scene, read_written

C0 = 0.28209479177387814


def read(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.ksplat", data)


@pytest.mark.parametrize("level", range(3))
@pytest.mark.parametrize("degree", range(3))
def test_every_field(tmp_path, level, degree):
    """Each Gaussian by the format's formulas, one at a time: 21 in full and other buckets."""
    count = 21
    stored, centres = codes(count, degree, level), np.random.default_rng(1).normal(size=(count, 3))
    data = ksplat_bytes(level, [section(stored, degree, level, centres)], count)
    scene = read(tmp_path, data)
    assert (len(scene), scene.sh_degree, scene.notes) == (count, degree, ())
    buckets = bucket_of(count)
    assert len(set(buckets)) == 7 and buckets.count(0) == 4  # 2 full ones
    for i in range(count):
        position = stored["position"][i].astype(float)
        if level:
            step = BLOCK / 2 / HALF_STEPS
            position = (position - HALF_STEPS) * step + centres[buckets[i]].astype("<f4")
        assert np.abs(scene.position[i] - position).max() < 1e-12
        assert np.array_equal(scene.scale[i], stored["scale"][i])
        assert np.array_equal(scene.quaternion[i], stored["quaternion"][i])  # w first
        assert np.abs(0.5 + C0 * scene.sh[i, 0] - stored["colour"][i, :3] / 255).max() < 1e-12
        assert scene.opacity[i] == stored["colour"][i, 3] / 255
        values = stored["sh"][i].astype(float)
        if level == 2:
            values = -2 + values / 255 * 5
        place = 0
        for d in range(1, degree + 1):
            for channel in range(3):
                for k in range(d * d, (d + 1) ** 2):
                    assert abs(scene.sh[i, k, channel] - values[place]) < 1e-12
                    place += 1


@pytest.mark.parametrize("level", range(3))
def test_sections(tmp_path, level):
    """Gaussians of each section as in a file of its own; unused space, an empty section and other
    degrees are allowed, and harmonics that a section lacks are 0."""
    centres = np.random.default_rng(2).normal(size=(30, 3))
    given = [(9, 1, 0), (0, 0, 3), (14, 2, 5), (1, 0, 0)]
    parts = [
        section(codes(count, degree, level, count), degree, level, centres, room)
        for count, degree, room in given
    ]
    scene, start = read(tmp_path, ksplat_bytes(level, parts, 24)), 0
    assert (len(scene), scene.sh_degree) == (24, 2)
    for (count, degree, _), part in zip(given, parts, strict=True):
        if not count:
            continue
        alone, some = read(tmp_path, ksplat_bytes(level, [part], count)), scene[start:][:count]
        start += count
        for name in ("position", "scale", "quaternion", "opacity"):
            assert np.array_equal(getattr(alone, name), getattr(some, name))
        held = (degree + 1) ** 2
        assert np.array_equal(alone.sh, some.sh[:, :held]) and not some.sh[:, held:].any()


def test_ranges_that_are_not_stated(tmp_path):
    """Zeros stand for harmonics of −1.5 … 1.5 and for 32767 steps."""
    stored, centres = codes(5, 1, 2), np.zeros((9, 3))
    head, body = section(stored, 1, 2, centres)
    part = head[:24] + bytes(4) + head[28:], body
    scene = read(tmp_path, ksplat_bytes(2, [part], 5, 0, 0))
    plain = read(tmp_path, ksplat_bytes(2, [(head, body)], 5, -1.5, 1.5))
    assert np.array_equal(scene.sh, plain.sh) and np.array_equal(scene.position, plain.position)
    assert np.abs(scene.sh[:, 1:]).max() <= 1.5


def test_odd_gaussians_are_noted(tmp_path):
    stored = codes(4, 0, 0)
    stored["scale"][1, 2], stored["position"][2, 0] = -0.5, np.nan
    scene = read(tmp_path, ksplat_bytes(0, [section(stored, 0, 0, np.zeros((4, 3)))], 4) + b"abc")
    assert scene.scale[1, 2] == 0.5
    assert scene.notes == (
        "1 Gaussian with a negative scale, sign dropped",
        "3 bytes belong to no Gaussian and are not read",
        "1 Gaussian with NaN or Inf",
    )


GOOD, PLAIN = small_ksplat(2, 2), small_ksplat(0, 1)


def _at(offset: int, layout: str, value: int, data: bytes = GOOD) -> bytes:
    """A file with one number replaced."""
    return data[:offset] + struct.pack(layout, value) + data[offset + struct.calcsize(layout) :]


BAD = {
    "4095 bytes are too few for the header": GOOD[:4095],
    "KSPLAT version 0.0 is": _at(1, "B", 0),
    "KSPLAT version 1.1 is": _at(0, "B", 1),
    "compression level 3 is not": _at(20, "<H", 3),
    "holds 0 Gaussians": _at(16, "<I", 0),
    "sections hold 21 Gaussians, the header says 22": _at(16, "<I", 22),
    "16385 sections are more than 16384": _at(4, "<I", 16385),
    "headers of 16384 sections do not fit": _at(4, "<I", 16384),
    "sections hold 0 Gaussians, the header says 21": _at(4, "<I", 0),
    "section 0: 22 Gaussians exceed its room for 21": _at(4096, "<I", 22),
    "section 0: 4294967295 Gaussians of SH degree 2": _at(4100, "<I", 2**32 - 1),
    "section 0: 21 Gaussians of SH degree 2 in 4294967295": _at(4108, "<I", 2**32 - 1),
    "section 0: SH degree 3 is not": _at(4136, "<H", 3),
    "are left": GOOD[:-1],
    "claims SH degree 0 but holds degree 1": _at(4136, "<H", 0, PLAIN),
    "bytes, not 12": _at(4116, "<H", 11),
    "buckets of 4294967295 exceed its room": _at(4104, "<I", 2**32 - 1),
    "section 0: its buckets hold": _at(4104, "<I", 1),
    "section 0: has 6 buckets, not 2 full and 5 other": _at(4108, "<I", 6),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    check_bad_scene(tmp_path / "scene.ksplat", BAD[message], message)


def test_lists_of_buckets_are_bounded(tmp_path):
    """Numbers of full and other buckets that the file cannot hold."""
    for offset in (4128, 4132):
        refused("scene.ksplat: section 0: ", read, tmp_path, _at(offset, "<I", 2**32 - 1))
