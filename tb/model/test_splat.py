""".splat scenes: 32 bytes per Gaussian, known by their extension."""

import struct

import numpy as np
import pytest

from splatcore.model.formats.read import read_scene
from tb.helpers.refusal import refused
from tb.helpers.scene_file import ply_bytes, ply_columns, read_written, splat_bytes
from tb.helpers.scenes import random_scene


def read(tmp_path, data: bytes):
    return read_written(tmp_path / "scene.splat", data)


def test_one_record(tmp_path):
    """Every field of one Gaussian, in the order of the format."""
    record = struct.pack("<6f8B", 1, -2, 3, 0.5, 0.25, 0.125, 255, 0, 51, 204, 0, 128, 160, 255)
    scene = read(tmp_path, record)
    assert scene.position.tolist() == [[1, -2, 3]]
    assert scene.scale.tolist() == [[0.5, 0.25, 0.125]]
    assert scene.quaternion.tolist() == [[-1, 0, 0.25, 127 / 128]]
    assert scene.opacity.tolist() == [204 / 255]
    colour = 0.5 + 0.28209479177387814 * scene.sh[0, 0]
    assert np.abs(colour - [1, 0, 0.2]).max() < 1e-12
    assert (scene.sh_degree, scene.notes) == (0, ())


def test_many_records(tmp_path):
    """Each Gaussian reads as it does alone."""
    data = splat_bytes(20)
    scene = read(tmp_path, data)
    assert len(scene) == 20
    for index in range(20):
        alone = read(tmp_path, data[32 * index : 32 * index + 32])
        for name in ("position", "scale", "quaternion", "opacity", "sh"):
            assert np.array_equal(getattr(alone, name)[0], getattr(scene, name)[index])


def test_odd_gaussians_are_noted(tmp_path):
    """NaN is kept, a scale's sign is dropped, a quaternion of bytes 128 is zero."""
    grey = struct.pack("<8B", 128, 128, 128, 128, 128, 128, 128, 128)
    odd = (0, 0, 0, 1, -2, 3), (np.nan, 0, 0, 1, 2, 3)
    scene = read(tmp_path, b"".join(struct.pack("<6f", *numbers) + grey for numbers in odd))
    assert scene.scale.tolist() == [[1, 2, 3]] * 2
    assert scene.notes == (
        "1 Gaussian with a negative scale, sign dropped",
        "1 Gaussian with NaN or Inf",
        "1 quaternion of norm 0",
    )


def test_content_goes_before_extension(tmp_path):
    """A PLY is read as PLY whatever its name; a .splat is known by its extension alone."""
    scene = read(tmp_path, ply_bytes({"vertex": ply_columns(random_scene(3, 1))}))
    assert scene.sh_degree == 1
    (tmp_path / "scene.bin").write_bytes(splat_bytes(2))
    refused(r"is not a PLY, SPZ, SOG or \.splat file", read_scene, tmp_path / "scene.bin")


@pytest.mark.parametrize(
    ("size", "message"), [(0, "is empty"), (31, "31 bytes are not a multiple"), (33, "33 bytes")]
)
def test_bad_size(tmp_path, size, message):
    refused(f"scene.splat: {message}", read, tmp_path, splat_bytes(2)[:size])
