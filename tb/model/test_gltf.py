"""Gaussians in glTF: attributes, nodes, buffers, SPZ inside, and files that are refused.

Expected positions, covariances and colours come from dense algebra: matrices of nodes, scipy's
rotations and Legendre functions.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from splatcore.model.formats.gltf import read
from splatcore.model.formats.read import read_scene
from tb.helpers.gltf_file import HALF_TURN, KHR, Builder, attributes, glb_of
from tb.helpers.moved import check_moved, covariance, transform
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_bad_scene, read_written, spz_bytes, spz_codes, spz_of
from tb.helpers.scenes import random_scene

TURNED = "turned from glTF's axes, y up, by half a turn about z"


@pytest.mark.parametrize("degree", range(4))
def test_every_attribute(tmp_path, degree):
    """A file in glTF's axes gives the numbers of its PLY, float32."""
    scene = random_scene(50, degree)
    found = read_written(tmp_path / "a.glb", glb_of(scene))
    check_moved(found, scene, np.eye(3), np.zeros(3), 1e-6)
    assert np.array_equal(found.position, scene.position.astype(np.float32))
    assert np.array_equal(found.sh, scene.sh.astype(np.float32))
    sign = np.sign((found.quaternion * scene.quaternion).sum(axis=1, keepdims=True))
    assert np.abs(found.quaternion * sign - scene.quaternion).max() < 1e-7
    assert (found.name, found.notes) == (f"{tmp_path}/a.glb", (TURNED,))
    assert not found.antialiased


def in_ply(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear part and shift of a matrix in glTF's axes, in the axes of PLY."""
    return HALF_TURN @ matrix[:3, :3] @ HALF_TURN, HALF_TURN @ matrix[:3, 3]


@pytest.mark.parametrize("degree", (0, 2, 3))
@pytest.mark.parametrize("mirror", (False, True))
def test_nodes(tmp_path, degree, mirror):
    """Transforms of nested nodes, as matrices or in parts, act on all of a Gaussian."""
    scene, builder = random_scene(40, degree), Builder()
    outer, inner = transform(1, 2.5, mirror), transform(2, 0.4)
    leaf = builder.node(builder.primitive(scene), root=False, matrix=inner.T.ravel().tolist())
    turn = Rotation.from_matrix(outer[:3, :3] / np.cbrt(np.linalg.det(outer[:3, :3])))
    parts = {
        "translation": outer[:3, 3].tolist(),
        "rotation": turn.as_quat().tolist(),
        "scale": [-2.5 if mirror else 2.5] * 3,
    }
    builder.node(root=True, children=[leaf], **parts)
    found = read_written(tmp_path / "a.glb", builder.glb())
    check_moved(found, scene, *in_ply(outer @ inner))


def test_zero_quaternion_of_a_turned_node(tmp_path):
    """A zero quaternion is the identity before the node's rotation, not after it."""
    scene = random_scene(5, 1)
    whole = replace(scene, quaternion=np.tile([1.0, 0, 0, 0], (5, 1)))
    builder = Builder()
    primitive = builder.primitive(whole)
    start = builder.tree["bufferViews"][1]["byteOffset"]
    zeros = builder.binary[:start] + bytes(80) + builder.binary[start + 80 :]
    builder.binary = zeros
    matrix = transform(4, 1)
    builder.node(primitive, matrix=matrix.T.ravel().tolist())
    found = read_written(tmp_path / "a.glb", builder.glb())
    linear, shift = in_ply(matrix)
    assert np.abs(found.position - (scene.position @ linear.T + shift)).max() < 1e-6
    wanted = linear @ HALF_TURN * whole.scale[:, None, :]  # stored as identity in glTF's axes
    assert np.abs(covariance(found) - wanted @ wanted.transpose(0, 2, 1)).max() < 1e-6


UNEVEN = {
    "nodes[0]: transform with a scale that is not uniform (1 × 2 × 1)": {"scale": [1, 2, 1]},
    "nodes[0]: transform with shear": {
        "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    },
    "nodes[0]: transform has a scale of 0": {"scale": [0, 0, 0]},
    "nodes[0]: transform is not affine": {
        "matrix": [1, 0, 0, 1, *[0, 1, 0, 0, 0, 0, 1, 0] + [0] * 3, 1]
    },
    "nodes[0]: 'rotation' is a quaternion of norm 0": {"rotation": [0, 0, 0, 0]},
    "nodes[0]: 'scale': has 2 entries, not 3": {"scale": [1, 1]},
    "transform has numbers beyond float64": {"scale": [1e308] * 3, "translation": [1, 1, 1]},
}


@pytest.mark.parametrize("message", UNEVEN)
def test_transforms_that_gaussians_cannot_follow(tmp_path, message):
    builder = Builder()
    leaf = builder.node(builder.primitive(random_scene(3, 0)), root=False, **UNEVEN[message])
    builder.node(children=[leaf], scale=[1e300 if "float64" in message else 1] * 3)
    check_bad_scene(tmp_path / "a.glb", builder.glb(), message)


def test_nearly_uniform_scale(tmp_path):
    """Rounded numbers of a matrix are no shear."""
    matrix = np.round(transform(3, 2), 5)
    scene = random_scene(20, 1)
    found = read_written(tmp_path / "a.glb", glb_of(scene, matrix=matrix.T.ravel().tolist()))
    check_moved(found, scene, *in_ply(matrix), 1e-4)


def test_several_primitives_and_nodes(tmp_path):
    """Primitives of different degrees and a mesh shown twice become one scene, in file order."""
    first, second = random_scene(30, 0, seed=1), random_scene(20, 2, seed=2)
    builder = Builder()
    mesh = {"attributes": {"POSITION": 0}}
    builder.node(builder.primitive(first), mesh, builder.primitive(second))
    builder.node(mesh=0, translation=[1, 2, 3])
    found = read_written(tmp_path / "a.glb", builder.glb())
    assert (len(found), found.sh_degree) == (100, 2)
    shifted = replace(second, position=second.position + HALF_TURN @ [1, 2, 3])
    for start, scene in ((0, first), (30, second), (80, shifted)):
        part = found[start : start + len(scene)].with_sh_degree(scene.sh_degree)
        check_moved(part, scene, np.eye(3), np.zeros(3), 1e-6)
    assert not found.sh[:30, 1:].any()
    assert found.notes == (TURNED, f"2 primitives without {KHR} not read")


def test_scene_shown(tmp_path):
    """Only nodes of the shown scene count; without scenes all do."""
    builder = Builder()
    builder.node(builder.primitive(random_scene(3, 0)))
    builder.node(builder.primitive(random_scene(4, 0)), root=False)
    assert len(read_written(tmp_path / "a.glb", builder.glb())) == 3
    builder.tree["scenes"].append({"nodes": [1]})
    builder.tree["scene"] = 1
    assert len(read_written(tmp_path / "a.glb", builder.glb())) == 4
    builder.node(children=[0], root=False)
    del builder.tree["scenes"]
    assert len(read_written(tmp_path / "a.glb", builder.glb())) == 7


@pytest.mark.parametrize("form", ("i1", "u1", "i2", "u2", "f4"))
def test_normalised_integers(tmp_path, form):
    """Normalised integers become numbers within ±1; the smallest signed one is −1, too."""
    rng, whole = np.random.default_rng(0), form != "f4"
    builder = Builder()
    primitive = builder.primitive(random_scene(60, 0))
    most = np.iinfo(form).max if whole else 1
    low = -most - 1 if form[0] == "i" else 0
    codes = rng.integers(low, most, (60, 4), endpoint=True) if whole else rng.uniform(size=(60, 4))
    codes[0] = low
    values = np.maximum(codes / most, -1).astype(np.float32 if form == "f4" else np.float64)
    names = primitive["attributes"]
    names[f"{KHR}:ROTATION"] = builder.accessor(codes, form, normalized=True)
    names[f"{KHR}:OPACITY"] = builder.accessor(np.abs(codes[:, :1]) % most, form, normalized=True)
    builder.node(primitive)
    found = read_written(tmp_path / "a.glb", builder.glb())
    w, x, y, z = values[:, [3, 0, 1, 2]].T
    still = ~values.any(axis=1)
    w = np.where(still, 1, w)
    back = np.stack([z, y, -x, -w], axis=1)  # half a turn about z
    assert np.array_equal(found.quaternion, back)
    wanted = (np.abs(codes[:, 0]) % most / most).astype(values.dtype)
    assert np.abs(found.opacity - wanted).max() < 1e-7


def test_interleaved(tmp_path):
    """Attributes that share a view, with a stride and offsets."""
    scene, builder = random_scene(20, 0), Builder()
    values = attributes(scene)
    rows = np.concatenate([*values.values()], axis=1).astype("<f4")
    view, start, names = builder.view(rows.tobytes(), byteStride=4 * rows.shape[1]), 0, {}
    for name, part in values.items():
        names[name] = builder.accessor(part, bufferView=view, byteOffset=4 * start)
        start += part.shape[1]
    builder.node({"attributes": names, "extensions": {KHR: {}}})
    check_moved(read_written(tmp_path / "a.glb", builder.glb()), scene, np.eye(3), np.zeros(3))


def test_buffers_outside(tmp_path):
    """A .gltf with its buffer in a file next to it, or inside the JSON, equals the GLB."""
    builder = Builder()
    builder.node(builder.primitive(random_scene(9, 1)))
    plain = read_written(tmp_path / "a.glb", builder.glb())
    (tmp_path / "with space.bin").write_bytes(builder.binary + b"more")
    for uri in ("with%20space.bin", None):
        found = read_written(tmp_path / "a.gltf", builder.gltf(uri))
        for name in ("position", "scale", "quaternion", "opacity", "sh"):
            assert np.array_equal(getattr(found, name), getattr(plain, name))
    (tmp_path / "b.gltf").write_bytes(builder.gltf("none.bin"))
    refused("none.bin: No such file", read_scene, tmp_path / "b.gltf")
    (tmp_path / "b.gltf").write_bytes(builder.gltf("https://example.com/a.bin"))
    refused("URI scheme 'https' is not supported", read_scene, tmp_path / "b.gltf")


@pytest.mark.parametrize("name", ("_spz_2", "_spz"))
def test_spz_inside(tmp_path, name):
    """An SPZ file in a primitive gives the scene of that file, moved by the node."""
    data = spz_of(random_scene(25, 2), 6)
    (tmp_path / "a.spz").write_bytes(data)
    alone = read_scene(tmp_path / "a.spz")
    for matrix in (np.eye(4), transform(7, 3)):
        builder = Builder()
        packed = builder.packed(data, f"{KHR}_compression{name}")
        builder.node(packed, matrix=matrix.T.ravel().tolist())
        found = read_written(tmp_path / "a.glb", builder.glb())
        check_moved(found, alone, *in_ply(matrix))
    assert found.notes == (TURNED,)
    refused("--axes RDF: the file states its axes, RDF", read_scene, tmp_path / "a.glb", "RDF")


def test_axes_and_mark_of_spz_inside(tmp_path):
    codes = spz_codes(3, 8, 1)
    builder = Builder()
    builder.node(builder.packed(spz_bytes(3, codes, 1, flags=1)))
    (tmp_path / "a.glb").write_bytes(builder.glb())
    (tmp_path / "a.spz").write_bytes(spz_bytes(3, codes, 1, flags=1))
    for axes in (None, "LUF"):
        found, alone = (read_scene(tmp_path / name, axes) for name in ("a.glb", "a.spz"))
        assert np.array_equal(found.position, alone.position)
        assert np.abs(covariance(found) - covariance(alone)).max() < 1e-12 * alone.scale.max() ** 2
        assert (found.antialiased, found.mark) == (True, "SPZ flag")
        assert found.notes[0] == alone.notes[0] and found.assumed_axes == alone.assumed_axes
    (tmp_path / "b.glb").write_bytes(glb_of(random_scene(2, 0)))
    refused("b.glb: --axes LUF: the file holds no SPZ", read, tmp_path / "b.glb", "LUF")


def changed(name: str, values: np.ndarray, **extension) -> bytes:
    """A GLB of 200 Gaussians with other values of one attribute."""
    builder = Builder()
    primitive = builder.primitive(random_scene(200, 0))
    primitive["attributes"][f"{KHR}:{name}"] = builder.accessor(values)
    primitive["extensions"][KHR] |= extension
    builder.node(primitive)
    return builder.glb()


def test_odd_values(tmp_path):
    """Scales of drafts are logarithms; faulty numbers are mended and counted."""
    path, logarithm = tmp_path / "a.glb", np.random.default_rng(0).normal(-3, 2, (200, 3))
    found = read_written(path, changed("SCALE", logarithm))
    assert np.allclose(found.scale, np.exp(logarithm.astype("f4").astype(float)), rtol=1e-12)
    assert found.notes[0].startswith("scales below 0: read as logarithms")
    scale = np.abs(logarithm)
    scale[3, 1] *= -1
    found = read_written(path, changed("SCALE", scale))
    assert np.array_equal(found.scale, np.abs(scale.astype(np.float32)))
    assert found.notes[0] == "1 Gaussian with a negative scale, sign dropped"
    opacity = np.linspace(-0.25, 1, 200)[:, None]
    found = read_written(path, changed("OPACITY", opacity))
    assert found.opacity.min() == 0 and found.notes[0] == "40 opacities outside 0 … 1, clipped"
    linear = {"colorSpace": "lin_rec709_display", "kernel": "ellipse"}
    found = read_written(path, changed("OPACITY", np.abs(opacity), **linear))
    note = "colorSpace 'lin_rec709_display' is rendered as 'srgb_rec709_display'"
    assert found.notes[0] == note
    found = read_written(path, changed("SH_DEGREE_4_COEF_0", scale))
    assert found.notes[0] == "harmonics of degree 4 are not used"
    found = read_written(path, glb_of(random_scene(2, 0)) + b"more")
    assert found.notes[0] == "4 bytes belong to no Gaussian and are not read"
