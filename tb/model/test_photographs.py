"""Photographs and points from structure from motion: reading, scaling, refusing bad files; written
COLMAP models, byte by byte against COLMAP's documentation, and read back."""

import json
import shutil
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from splatcore.model.formats.colmap import read_colmap, read_points
from splatcore.model.formats.colmap_write import landing, write_colmap
from splatcore.model.formats.photographs import held_out, read_photographs
from splatcore.spec.camera import Camera, look_at
from tb.helpers.refusal import refused
from tb.helpers.scenes import needs_scenes, scene_path

POSE = "1 0 0 0 0 0 0"


@pytest.fixture
def folder(tmp_path):
    """A COLMAP folder in text with three photographs of 8×6 pixels."""
    sparse, images = tmp_path / "sparse" / "0", tmp_path / "images"
    sparse.mkdir(parents=True)
    images.mkdir()
    (sparse / "cameras.txt").write_text("1 PINHOLE 8 6 10 10 4 3\n")
    lines = [f"{k} {POSE} 1 {name}.png\n\n" for k, name in enumerate("bca", 1)]
    (sparse / "images.txt").write_text("".join(lines))
    for k, name in enumerate("bca", 1):
        Image.fromarray(np.full((6, 8, 3), 40 * k, np.uint8)).save(images / f"{name}.png")
    return tmp_path


def test_colmap(folder):
    found = read_photographs(folder)
    assert [target.name for target in found.targets] == ["a.png", "b.png", "c.png"]
    assert [target.image[0, 0, 0] for target in found.targets] == [120, 40, 80]
    assert found.missing == () and found.notes == ()
    camera = found.targets[0].camera
    assert (camera.width, camera.height, camera.fx) == (8, 6, 10)
    assert len(read_photographs(folder / "sparse" / "0").targets) == 3


def test_scale(folder):
    board = np.indices((6, 8)).sum(0)[..., None] % 2 * np.full(3, 200)
    Image.fromarray(board.astype(np.uint8)).save(folder / "images" / "a.png")
    target = read_photographs(folder, 0.5).targets[0]
    assert target.image.shape == (3, 4, 3) and (target.image == 100).all()  # means of 2×2 pixels
    assert (target.camera.width, target.camera.fx, target.camera.cx) == (4, 5, 2)
    for scale in (0, -1, 1.5, float("nan")):
        refused("scale: ", read_photographs, folder, scale)


def test_missing_and_broken_photographs(folder):
    (folder / "images" / "b.png").unlink()
    (folder / "images" / "c.png").write_bytes(b"no image")
    found = read_photographs(folder)
    assert [target.name for target in found.targets] == ["a.png"]
    assert [path.rsplit("/")[-1] for path in found.missing] == ["b.png", "c.png"]
    assert "2 photographs are missing" in found.notes[0] and "b.png" in found.notes[0]
    (folder / "images" / "a.png").unlink()
    refused("none of its 3 photographs", read_photographs, folder)


def test_no_images(folder):
    (folder / "sparse" / "0" / "images.txt").write_text("# none\n")
    refused(r"images.txt: holds no images", read_photographs, folder)
    shutil.rmtree(folder / "images")
    refused("no folder `images`", read_photographs, folder)


def test_another_size(folder):
    """A photograph of another size scales its camera; another aspect ratio is refused."""
    Image.fromarray(np.zeros((12, 16, 3), np.uint8)).save(folder / "images" / "a.png")
    found = read_photographs(folder)
    assert (found.targets[0].camera.width, found.targets[0].camera.fx) == (16, 20)
    assert "1 photographs have another size" in found.notes[0]
    Image.fromarray(np.zeros((8, 6, 3), np.uint8)).save(folder / "images" / "a.png")
    refused(r"a.png: is 6x8, but its camera 8x6", read_photographs, folder)


def test_grey_and_transparent(folder):
    Image.fromarray(np.full((6, 8), 77, np.uint8)).save(folder / "images" / "a.png")
    clear = np.full((6, 8, 4), 200, np.uint8)
    clear[..., 3] = 0
    clear[0, 0, 3] = 255
    Image.fromarray(clear).save(folder / "images" / "b.png")
    grey, shown, _ = read_photographs(folder).targets
    assert (grey.image == 77).all()
    assert (shown.image[0, 0] == 200).all() and shown.image[1:].max() == 0


def test_sixteen_bits_of_grey(folder):
    deep = np.full((6, 8), 30000, np.uint16)
    Image.fromarray(deep).save(folder / "images" / "a.png")
    assert (read_photographs(folder).targets[0].image == 30000 // 256).all()


def test_a_photograph_of_two_cameras(folder):
    """It counts once, so that it cannot be both trained on and held out."""
    path = folder / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text() + f"9 {POSE} 1 a.png\n\n")
    names = [target.name for target in read_photographs(folder).targets]
    assert names == ["a.png", "b.png", "c.png"]


def test_orientation_is_as_stored(folder):
    """EXIF orientation is ignored, as in COLMAP."""
    image = Image.fromarray(np.zeros((6, 8, 3), np.uint8))
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(folder / "images" / "a.png", exif=exif)
    assert read_photographs(folder).targets[0].image.shape == (6, 8, 3)


def test_transforms(tmp_path):
    matrix = np.eye(4).tolist()
    frames = [{"file_path": f"./p/{name}", "transform_matrix": matrix} for name in ("y.png", "x")]
    table = {"w": 8, "h": 6, "fl_x": 10, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(table))
    (tmp_path / "p").mkdir()
    for k, name in enumerate("xy"):
        Image.fromarray(np.full((6, 8, 3), k, np.uint8)).save(tmp_path / "p" / f"{name}.png")
    for path in (tmp_path, tmp_path / "transforms.json"):
        found = read_photographs(path)
        assert [target.image[0, 0, 0] for target in found.targets] == [0, 1]


def test_a_camera_without_a_photograph(tmp_path):
    frame = {"transform_matrix": np.eye(4).tolist()}
    table = {"w": 8, "h": 6, "fl_x": 10, "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(table))
    refused(r"transforms.json: a camera names no photograph", read_photographs, tmp_path)


def test_held_out():
    refused("every: 0 is below 1", held_out, [], 0)
    learn, aside = held_out(list(range(14)), 7)
    assert aside == (0, 7) and learn == (1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13)


def points(*rows, count=None) -> bytes:
    data = struct.pack("<Q", len(rows) if count is None else count)
    for x, y, z, colour in rows:
        data += struct.pack("<Q3d3BdQ", 1, x, y, z, *colour, 0.5, 2) + bytes(16)
    return data


def test_points(folder):
    sparse = folder / "sparse" / "0"
    refused(r"has no points3D.bin or points3D.txt", read_points, folder)
    (sparse / "points3D.txt").write_text("# comment\n7 1 2 3 10 20 30 0.5 1 2\n8 4 5 6 0 0 255 1\n")
    position, colour = read_points(folder)
    assert np.array_equal(position, [[1, 2, 3], [4, 5, 6]])
    assert np.array_equal(colour, [[10, 20, 30], [0, 0, 255]]) and colour.dtype == np.uint8
    (sparse / "points3D.bin").write_bytes(points((1, 2, 3, (1, 2, 3)), (4, 5, 6, (9, 8, 7))))
    position, colour = read_points(folder)
    assert np.array_equal(position, [[1, 2, 3], [4, 5, 6]]) and colour[1, 2] == 7


def test_broken_points(folder):
    path = folder / "sparse" / "0" / "points3D.bin"
    for data, message in (
        (points(), "holds no points"),
        (points((1, 2, float("nan"), (0, 0, 0))), "point 0 is not finite"),
        (points((1, 2, 3, (0, 0, 0)), count=2), "is cut off"),
        (points((1, 2, 3, (0, 0, 0)))[:-5], "point 0: its 2 images"),
        (b"12", "is cut off"),
    ):
        path.write_bytes(data)
        refused(rf"points3D.bin: {message}", read_points, folder)
    path.unlink()
    text = path.with_suffix(".txt")
    for line in ("1 2 3\n", "1 a 2 3 0 0 0 1\n", "1 1 2 3 0 0 256 1\n"):
        text.write_text(line)
        refused(r"points3D.txt: point 0: line is malformed", read_points, folder)


@needs_scenes
def test_banana():
    found = read_photographs(scene_path("banana"), 0.5)
    learn, aside = held_out(found.targets)
    assert [target.name for target in aside] == ["DSC_0423.JPG", "DSC_0431.JPG"]
    assert len(learn) == 12
    assert found.targets[0].image.shape == (332, 500, 3)
    position, colour = read_points(scene_path("banana"))
    assert position.shape == colour.shape == (5964, 3)


TURN = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # (w, x, y, z) = (½, ½, ½, ½)
FIRST = Camera(8, 6, 10.0, 11.0, 4.0, 3.0, TURN, [0.5, 0, 1])
SECOND = Camera(8, 6, 10.0, 11.0, 4.0, 3.0, np.eye(3), [0, 0, 2])
OTHER = replace(SECOND, width=9, cx=4.5)
POINTS = np.array([[1.0, 3, 3], [0, 0, 1]]), np.array([[1, 2, 3], [255, 0, 9]], np.uint8)


def test_the_documented_layout(tmp_path):
    """The bytes follow "Binary File Format" in COLMAP's "Output Format", little-endian."""
    images = [(FIRST, "a.png"), (OTHER, "b/c.png"), (SECOND, "d.png")]
    write_colmap(tmp_path, images, POINTS, [np.array([0, 1]), np.array([1]), np.array([], int)])
    cameras = struct.pack("<Q", 2)
    cameras += struct.pack("<IiQQ4d", 1, 1, 8, 6, 10, 11, 4, 3)
    cameras += struct.pack("<IiQQ4d", 2, 1, 9, 6, 10, 11, 4.5, 3)
    assert (tmp_path / "cameras.bin").read_bytes() == cameras
    written = struct.pack("<Q", 3)
    written += struct.pack("<I7dI", 1, 0.5, 0.5, 0.5, 0.5, 0.5, 0, 1, 1) + b"a.png\0"
    written += struct.pack("<QddQddQ", 2, 12.75, 5.75, 1, 19.0, 3.0, 2)
    written += struct.pack("<I7dI", 2, 1, 0, 0, 0, 0, 0, 2, 2) + b"b/c.png\0"
    written += struct.pack("<QddQ", 1, 4.5, 3, 2)
    written += struct.pack("<I7dI", 3, 1, 0, 0, 0, 0, 0, 2, 1) + b"d.png\0" + struct.pack("<Q", 0)
    assert (tmp_path / "images.bin").read_bytes() == written
    points = struct.pack("<Q", 2)
    points += struct.pack("<Q3d3BdQ", 1, 1, 3, 3, 1, 2, 3, 0, 1) + struct.pack("<2I", 1, 0)
    points += struct.pack("<Q3d3BdQ", 2, 0, 0, 1, 255, 0, 9, 0, 2) + struct.pack("<4I", 1, 1, 2, 0)
    assert (tmp_path / "points3D.bin").read_bytes() == points


def test_our_reader(tmp_path):
    """Reading back gives equal intrinsics and translations, and rotations within 1e-15."""
    rng = np.random.default_rng(0)
    turns = Rotation.random(50, rng=rng).as_matrix()
    cameras = [
        Camera(*rng.integers(1, 9, 2), *rng.uniform(1, 9, 4), turn, rng.normal(size=3))
        for turn in turns
    ]
    write_colmap(tmp_path, [(camera, f"{k}.png") for k, camera in enumerate(cameras)], POINTS)
    for (found, name), (number, camera) in zip(
        read_colmap(tmp_path), enumerate(cameras), strict=True
    ):
        assert name == f"{number}.png"
        for field in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(found, field) == getattr(camera, field)
        assert np.array_equal(found.translation, camera.translation)
        assert np.abs(found.rotation - camera.rotation).max() < 1e-15
    for found, wanted in zip(read_points(tmp_path), POINTS, strict=True):
        assert np.array_equal(found, wanted) and found.dtype == wanted.dtype


def test_a_matrix_that_is_nearly_a_rotation(tmp_path):
    """Observations match the rotation in the file, not the inexact matrix that was given."""
    rough = replace(FIRST, rotation=np.array([[1, 1e-4, 0], [0, 1, 0], [0, 0, 1.0001]]))
    write_colmap(tmp_path, [(rough, "a")], POINTS, [np.array([0, 1])])
    ((camera, _),) = read_colmap(tmp_path)
    assert np.abs(camera.rotation @ camera.rotation.T - np.eye(3)).max() < 1e-15
    data = (tmp_path / "images.bin").read_bytes()[-48:]
    found = [struct.unpack_from("<dd", data, start) for start in (0, 24)]
    assert np.abs(found - landing(camera, POINTS[0])).max() < 1e-12
    assert np.abs(found - landing(rough, POINTS[0])).max() > 1e-4


def test_where_points_land():
    """The centre of the picture, and the centre of its first pixel, which COLMAP calls (½, ½)."""
    camera = look_at(np.array([1.0, -2, -5]), np.array([1.0, -2, 0]), 8, 6, 10.0)
    place = landing(camera, np.array([[1.0, -2, 0], [1 - 3.5 * 0.5, -2 - 2.5 * 0.5, 0]]))
    assert place == pytest.approx(np.array([[4, 3], [0.5, 0.5]]))
