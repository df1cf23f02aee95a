"""PLY scenes: any layout, order and type reads alike; compressed PLY; malformed files."""

import os

import numpy as np
import pytest
from plyfile import PlyData

from splatcore.model.formats.ply import OPACITY_MARGIN, SCALE_MIN, read, write_ply
from splatcore.model.formats.read import read_scene
from splatcore.spec.scene import Scene
from tb.helpers import scene_file
from tb.helpers.refusal import refused
from tb.helpers.scene_file import CHUNK_BOUNDS, ply_bytes, ply_columns, read_written
from tb.helpers.scenes import GAUSSIANS, needs_scenes, random_scene, scene_path

FLOAT32_BOUND = 1e-6
"""Bound on float32's relative error in a scale or an opacity (measured: at most 7e-7)."""


def check_equal(scene: Scene, expected: Scene) -> None:
    """Compare positions, quaternions and SH exactly as float32, scale and opacity nearly."""
    for name in ("position", "quaternion", "sh"):
        stored = getattr(expected, name).astype(np.float32).astype(np.float64)
        assert np.array_equal(getattr(scene, name), stored), name
    for name in ("scale", "opacity"):
        value = getattr(expected, name)
        assert np.abs(getattr(scene, name) / value - 1).max() < FLOAT32_BOUND, name


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("form", scene_file.FORMATS)
@pytest.mark.parametrize("extra", [False, True])
def test_any_layout_reads_alike(tmp_path, degree, form, extra):
    """Shuffled, unknown and normal columns, ASCII and both byte orders: always the same scene."""
    expected = random_scene(5, degree)
    columns = ply_columns(expected)
    types = {}
    if extra:
        columns |= {name: np.full(5, 7.0) for name in ("nx", "ny", "nz", "red")}
        columns = {name: columns[name] for name in np.random.default_rng(1).permutation([*columns])}
        types = {"red": "uchar", "x": "double"}
    elements = {"camera": {"focal": np.ones(2)}} if extra else {}
    elements["vertex"] = columns
    scene = read_written(tmp_path / "scene.ply", ply_bytes(elements, form, types))
    check_equal(scene, expected)
    assert (scene.name, scene.sh_degree) == (f"{tmp_path}/scene.ply", degree)
    notes = ("columns that are not used: red", "elements that are not used: camera")
    assert scene.notes == (notes if extra else ())


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_header_line_ends(tmp_path, newline):
    expected = random_scene(3, 1)
    data = ply_bytes({"vertex": ply_columns(expected)}, newline=newline)
    check_equal(read_written(tmp_path / "scene.ply", data), expected)


@pytest.mark.parametrize("degree", range(4))
def test_written_scene_reads_back(tmp_path, degree):
    expected = random_scene(300, degree)
    write_ply(tmp_path / "scene.ply", expected)
    check_equal(read(tmp_path / "scene.ply"), expected)
    vertex = PlyData.read(str(tmp_path / "scene.ply"))["vertex"]
    rest = [f"f_rest_{i}" for i in range(3 * ((degree + 1) ** 2 - 1))]
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert [p.name for p in vertex.properties] == names


def test_written_extremes_are_finite(tmp_path):
    """Zero scales and opacities of 0 and 1 are finite in the file, as close as float32 allows."""
    scene = random_scene(2, 0)
    scene = Scene(scene.position, scene.scale * 0, scene.quaternion, np.array([0, 1]), scene.sh)
    write_ply(tmp_path / "scene.ply", scene)
    vertex = PlyData.read(str(tmp_path / "scene.ply"))["vertex"].data
    assert all(np.isfinite(vertex[name]).all() for name in vertex.dtype.names)
    back = read(tmp_path / "scene.ply")
    assert np.allclose(back.scale, SCALE_MIN, rtol=1e-5)
    assert np.abs(back.opacity - scene.opacity).max() < 1.01 * OPACITY_MARGIN


def test_odd_gaussians_are_noted(tmp_path):
    """NaN, Inf and quaternions without direction are read, and counted in notes."""
    columns = ply_columns(random_scene(6, 0))
    columns["x"][0], columns["scale_1"][1], columns["f_dc_2"][1] = np.nan, np.inf, np.nan
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        columns[name][3] = 0
        columns[name][4] *= 1e6
    scene = read_written(tmp_path / "scene.ply", ply_bytes({"vertex": columns}))
    assert scene.notes == (
        "2 Gaussians with NaN or Inf",
        "1 quaternion of norm 0",
        "1 quaternion of a norm outside 0.001 … 1000",
    )


def _compressed(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(count)
    bounds = np.sort(rng.uniform(-1, 1, (-(-count // 256), 3, 2, 3)), axis=2).astype(np.float32)
    packed = rng.integers(0, 2**32, (count, 4), np.uint32)
    return bounds.reshape(-1, 18), packed


def _unpacked(word: np.ndarray, widths: tuple[int, ...]) -> np.ndarray:
    """Bit fields of words [N], from the top bit down, each in [0, 1]: [N, fields]."""
    low, fields = 32, []
    for width in widths:
        low -= width
        fields.append((word >> low & (2**width - 1)) / (2**width - 1))
    return np.stack(fields, axis=1)


@pytest.mark.parametrize("coloured", [True, False])
def test_compressed(tmp_path, coloured):
    """PlayCanvas's format against its description; old files have no bounds of colours."""
    count = 600
    bounds, packed = _compressed(count)
    sh = np.zeros((count, 0), np.uint8)
    names = CHUNK_BOUNDS if coloured else CHUNK_BOUNDS[:12]
    data = scene_file.compressed_ply_bytes(bounds[:, : len(names)], packed, sh, names)
    scene = read_written(tmp_path / "scene.ply", data)

    low, high = np.repeat(bounds.reshape(-1, 3, 2, 3), 256, axis=0)[:count].transpose(2, 1, 0, 3)
    widths = [(11, 10, 11), (2, 10, 10, 10), (11, 10, 11), (8,) * 4]
    words = zip(packed.T, widths, strict=True)
    position, quaternion, log_scale, colour = (_unpacked(*word) for word in words)
    assert np.abs(scene.position - (low + (high - low) * position)[0]).max() < 1e-6
    assert np.abs(np.log(scene.scale) - low[1] - (high - low)[1] * log_scale).max() < 1e-6
    rgb = colour[:, :3] * (high - low)[2] + low[2] if coloured else colour[:, :3]
    assert np.abs(0.5 + 0.28209479 * scene.sh[:, 0] - rgb).max() < 1e-6
    # gsply keeps the logit within ± 10.
    assert np.abs(scene.opacity - colour[:, 3]).max() < 5e-5
    largest = np.round(quaternion[:, 0] * 3).astype(int)
    rest = scene.quaternion[np.arange(4) != largest[:, None]].reshape(-1, 3)
    assert np.abs(rest - (quaternion[:, 1:] - 0.5) * np.sqrt(2)).max() < 1e-6


PLAIN = ply_columns(random_scene(4, 1))


def _without(*names: str) -> bytes:
    return ply_bytes({"vertex": {k: v for k, v in PLAIN.items() if k not in names}})


def _header(count: object, properties: str = "property float x\n", form: str = "ascii") -> bytes:
    return f"ply\nformat {form} 1.0\nelement vertex {count}\n{properties}end_header\n".encode()


def _packed(names=CHUNK_BOUNDS, chunks: int = 1, sh: int = 9, rows: int = 10) -> bytes:
    bounds, packed = _compressed(10)
    bounds, harmonics = np.repeat(bounds, chunks, axis=0), np.zeros((rows, sh), np.uint8)
    return scene_file.compressed_ply_bytes(bounds, packed, harmonics, names)


BAD = {
    "is empty": b"",
    "no 'end_header'": b"ply\nformat ascii 1.0\n",
    "unknown line 'nonsense'": b"ply\nformat ascii 1.0\nnonsense\nend_header\n",
    "unknown line 'format ebcdic 1.0'": _header(1, form="ebcdic"),
    "version '2.0' is not 1.0": b"ply\nformat ascii 2.0\nend_header\n",
    "element 'vertex' is missing": b"ply\nformat ascii 1.0\nend_header\n",
    "has no count": _header("many"),
    "-1 × 1 values": _header(-1),
    "1099511627776 × 1 values": _header(2**40),
    "1000000000000 × 0 values": _header(10**12, properties=""),
    "holds 0 Gaussians": _header(0),
    "1 of 3 rows": _header(3) + b"1\n",
    "3 of 4 rows": ply_bytes({"vertex": PLAIN})[:-1],
    "element 'vertex': holds a value that is not a number": _header(1) + b"one\n",
    "row 0 has 2 values, not 1": _header(1) + b"1 2\n",
    "has list properties": _header(1, "property list uchar int x\n") + b"0\n",
    "two properties are called 'x'": _header(1, "property float x\n" * 2) + b"1 2\n",
    "property 'rot_3' is missing": _without("rot_3"),
    "property 'f_dc_0' is missing": _without("f_dc_0"),
    "property 'opacity' is missing": _without("opacity"),
    "property 'z' is missing": _without("z"),
    "8 properties 'f_rest_*'": _without("f_rest_4"),
    "property 'f_rest_4' is missing": _without("f_rest_4").replace(
        b"property float x\n", b"property float f_rest_9\nproperty float x\n"
    )
    + bytes(16),
    "property 'max_b' is missing": _packed([*CHUNK_BOUNDS[:-1], "blue"]),
    "'chunk' has 2 rows, not 1": _packed(chunks=2),
    "'sh' has 9 rows, not 10": _packed(rows=9),
    "element 'sh': has 9 of 10 rows": _packed()[:-1],
    "12 properties 'f_rest_*'": _packed(sh=12),
    "'packed_scale' is not uint32": _packed().replace(b"uint packed_s", b"float packed_s"),
    "'f_rest_3' is not uint8": _packed().replace(b"uchar f_rest_3", b"char f_rest_3"),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    scene_file.check_bad_scene(tmp_path / "bad.ply", BAD[message], message)


def test_bad_path(tmp_path):
    """A missing file, a folder, a pipe, an impossible name and an unknown format are refused."""
    (tmp_path / "text.ply").write_text("hello")
    os.mkfifo(tmp_path / "pipe.ply")
    for name, message in [
        ("none.ply", "No such file"),
        ("", "is a directory"),
        ("pipe.ply", "is not a regular file"),
        ("a\0b", "null"),
        ("text.ply", "is not a PLY, SPZ, glTF, USD, SOG, .*.splat file"),
    ]:
        refused(message, read_scene, f"{tmp_path}/{name}")
    refused(r"cannot be written", write_ply, tmp_path / "none" / "scene.ply", random_scene(1, 0))


AXES = (
    "the SPZ file does not state its axes; read as RUB, the format's default; "
    "choose others by --axes",
)
FAINT = "transparent Gaussians (opacity below 1/255)"
NOTES = {
    "flowers.spz": (*AXES, f"758 {FAINT}"),
    "playbot.spz": AXES,
    "kitchen.spz": AXES,
    "guitar.compressed.ply": (f"550 {FAINT}",),
    "st-peter.sog": (f"2083 {FAINT}",),
}
MARKS = {"kitchen.spz": (True, "SPZ flag")}  # marks of the real files


@needs_scenes
@pytest.mark.parametrize("name", GAUSSIANS)
def test_real_file(name):
    """Every real file has the count, degree, notes and mark recorded here."""
    scene = read_scene(scene_path(name))
    assert (len(scene), scene.sh_degree) == GAUSSIANS[name]
    assert scene.notes == NOTES.get(name, ()) and scene.name == str(scene_path(name))
    assert (scene.antialiased, scene.mark) == MARKS.get(name, (False, ""))
    assert np.abs(np.linalg.norm(scene.quaternion, axis=1) - 1).max() < 0.01
    assert scene.opacity.min() >= 0 and scene.opacity.max() <= 1 and scene.scale.min() > 0
