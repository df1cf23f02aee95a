"""glTF files that are refused, and GLB files that we write."""

import json
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.formats import gltf
from splatcore.model.formats.gltf_write import write_glb
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.spec.colour import SH_C0
from tb.helpers.gltf_file import HALF_TURN, KHR, Builder, glb_bytes, glb_of, glb_parts, odd_orders
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_bad_scene, edited, read_written, spz_bytes, spz_codes
from tb.helpers.scenes import random_scene

WHOLE = glb_of(random_scene(4, 1), translation=[1, 2, 3])
TREE, BINARY = glb_parts(WHOLE)

PRIMITIVE = ("meshes", 0, "primitives", 0)
ATTRIBUTES = (*PRIMITIVE, "attributes")


def tree(*keys: object) -> bytes:
    """The GLB with one value of its JSON replaced by the last of `keys`, or removed (None)."""
    return glb_bytes(edited(TREE, *keys), BINARY)


def cut(size: int, kind: int = 0x4E4F534A) -> bytes:
    """A GLB with one empty chunk, which claims `size` bytes."""
    return b"glTF" + struct.pack("<IIII", 2, 20, size, kind)


def packed(data: bytes) -> bytes:
    builder = Builder()
    builder.node(builder.packed(data))
    return builder.glb()


INSTANCES, MESHOPT = {"EXT_mesh_gpu_instancing": {}}, {"EXT_meshopt_compression": {}}

SPZ = spz_bytes(4, spz_codes(4, 4, 1), 1)

BAD = {
    "GLB header is cut off": WHOLE[:14],
    "GLB version 1 is not supported": glb_bytes(TREE, BINARY, 1),
    f"holds {len(WHOLE) - 1} of the {len(WHOLE)} bytes": WHOLE[:-1],
    "chunk 0 of 4294967295 bytes is cut off": cut(2**32 - 1),
    "does not begin with a JSON chunk": cut(0, 5),
    "does not begin with a JSON chunk ": b"glTF" + struct.pack("<III", 2, 12, 0)[:8] + bytes(8),
    "JSON: is not valid JSON": cut(0),
    "JSON: is [], not an object": glb_bytes([], BINARY),
    "'asset' is missing": tree("asset", None),
    "asset: glTF version '1.0' is not supported": tree("asset", "version", "1.0"),
    "requires EXT_meshopt_compression": tree("extensionsRequired", ["EXT_meshopt_compression"]),
    "'extensionsRequired': is 5, not a string": tree("extensionsRequired", [5]),
    f"holds no primitive with {KHR}": tree(*PRIMITIVE, "extensions", None),
    f"holds no primitive with {KHR} ": tree("scenes", 0, "nodes", []),
    "scenes[3]: is missing": tree("scene", 3),
    "nodes[-1]: is missing": tree("scenes", 0, "nodes", [-1]),
    "nodes[0]: is below more than one node": tree("scenes", 0, "nodes", [0, 0]),
    "nodes[0]: is below more than one node, or": tree("nodes", 0, "children", [0]),
    "node: is 'x', not an integer": tree("nodes", 0, "children", ["x"]),
    "nodes[0]: EXT_mesh_gpu_instancing": tree("nodes", 0, "extensions", INSTANCES),
    "meshes[9]: is missing": tree("nodes", 0, "mesh", 9),
    "'primitives' is missing": tree("meshes", 0, "primitives", None),
    "'indices' of Gaussians": tree(*PRIMITIVE, "indices", 0),
    "primitives[0]: 'POSITION' is missing": tree(*ATTRIBUTES, "POSITION", None),
    f"'{KHR}:SCALE' is missing": tree(*ATTRIBUTES, f"{KHR}:SCALE", None),
    f"'{KHR}:SH_DEGREE_0_COEF_0' is missing": tree(*ATTRIBUTES, f"{KHR}:SH_DEGREE_0_COEF_0", None),
    f"'{KHR}:SH_DEGREE_1_COEF_2' is missing": tree(*ATTRIBUTES, f"{KHR}:SH_DEGREE_1_COEF_2", None),
    f"'{KHR}:SH_DEGREE_2_COEF_0' is missing": tree(*ATTRIBUTES, f"{KHR}:SH_DEGREE_3_COEF_1", 4),
    f"{KHR}:ROTATION: has 3 components, not 4": tree(*ATTRIBUTES, f"{KHR}:ROTATION", 0),
    f"{KHR}:OPACITY: has 3 elements, not 4": tree("accessors", 3, "count", 3),
    "accessors[99]: is missing": tree(*ATTRIBUTES, "POSITION", 99),
    "accessors[0]: 'count' is 0, not at least 1": tree("accessors", 0, "count", 0),
    "accessors[0]: 1099511627776 elements end at byte": tree("accessors", 0, "count", 2**40),
    "accessors[0]: 4 elements end at byte 49 of 48": tree("accessors", 0, "byteOffset", 1),
    "accessors[0]: 'byteOffset' is -4": tree("accessors", 0, "byteOffset", -4),
    "accessors[0]: MAT4 of component type 5126": tree("accessors", 0, "type", "MAT4"),
    "accessors[0]: VEC3 of component type 5124": tree("accessors", 0, "componentType", 5124),
    "accessors[0]: 'sparse' is not supported": tree("accessors", 0, "sparse", {}),
    "accessors[0]: 'bufferView' is missing": tree("accessors", 0, "bufferView", None),
    "elements of 12 bytes have a stride of 8": tree("bufferViews", 0, "byteStride", 8),
    "'byteStride' is 1000, not at most 252": tree("bufferViews", 0, "byteStride", 1000),
    f"of a buffer of {len(BINARY)}": tree("bufferViews", 0, "byteLength", 2**50),
    "EXT_meshopt_compression is not": tree("bufferViews", 0, "extensions", MESHOPT),
    "buffers[1]: is missing": tree("bufferViews", 0, "buffer", 1),
    f"holds {len(BINARY)} of 4611686018427387904 bytes": tree("buffers", 0, "byteLength", 2**62),
    "buffers[0]: data URI is not base64": tree("buffers", 0, "uri", "data:,abc"),
    "buffers[0]: data URI is not base64 ": tree("buffers", 0, "uri", "data:;base64,!"),
    "SPZ: has no SPZ header": packed(SPZ[:10]),
    "SPZ: is not an SPZ file": packed(b"nothing"),
    "SPZ: stream 5 is cut off": packed(SPZ[:-1]),
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    check_bad_scene(tmp_path / "a.glb", BAD[message], message)


def test_bad_json(tmp_path):
    for data, message in (
        (b"{", "is not valid JSON"),
        (b"[" * 100_000, "is not valid JSON"),
        (json.dumps(TREE).encode(), "buffers[0]: has no data"),
    ):
        check_bad_scene(tmp_path / "a.gltf", data, message)


def test_repetitions_are_bounded(tmp_path, monkeypatch):
    """A mesh shown by many nodes, and primitives that share data: 4 bytes of float32 are accepted
    for each stored one, and COPIES_MAX more."""
    path, builder = tmp_path / "a.glb", Builder()
    size = 4 * 14 * 2000  # of the Gaussians
    message = f"a.glb: shows {5 * size} bytes of Gaussians and holds at most {4 * size}; "
    primitive = builder.primitive(random_scene(2000, 0))
    builder.node(primitive, primitive)
    builder.node(mesh=0)
    monkeypatch.setattr(gltf, "COPIES_MAX", 0)
    assert len(read_written(path, builder.glb())) == 8000
    builder.node(primitive)
    check_bad_scene(path, builder.glb(), f"{message}repetitions may add 0")
    monkeypatch.setattr(gltf, "COPIES_MAX", size - 1)
    check_bad_scene(path, builder.glb(), message)
    monkeypatch.setattr(gltf, "COPIES_MAX", size)
    assert len(read_written(path, builder.glb())) == 10_000


def test_repetitions_of_spz_are_bounded(tmp_path, monkeypatch):
    """Views of the same bytes hold the same Gaussians."""
    builder, shown = Builder(), 4 * 14 * 4000
    data = spz_bytes(4, spz_codes(4, 4000, 0), 0)
    parts = [builder.packed(data) for _ in range(2)]
    builder.tree["bufferViews"][1]["byteOffset"] = 0
    builder.binary = builder.binary[: len(data)]
    builder.node(parts[0])
    monkeypatch.setattr(gltf, "COPIES_MAX", -4 * len(data))
    assert len(read_written(tmp_path / "a.glb", builder.glb())) == 4000
    builder.node(parts[1])
    message = f"shows {2 * shown} bytes of Gaussians and holds at most {shown + 4 * len(data)}; "
    check_bad_scene(tmp_path / "a.glb", builder.glb(), message)
    monkeypatch.setattr(gltf, "COPIES_MAX", shown)
    assert len(read_written(tmp_path / "a.glb", builder.glb())) == 8000


def test_shared_accessors_take_no_memory(tmp_path, monkeypatch):
    """45 coefficients from the bytes of the positions: refused before they are decoded."""
    builder, count = Builder(), 100_000
    primitive = builder.primitive(random_scene(1, 3))
    position = builder.accessor(np.zeros((count, 3)), "u1")
    primitive["attributes"] = dict.fromkeys(primitive["attributes"], position)
    builder.node(primitive)
    (tmp_path / "a.glb").write_bytes(builder.glb())
    monkeypatch.setattr(gltf, "COPIES_MAX", 1 << 20)
    tracemalloc.start()
    refused(f"shows {236 * count} bytes of Gaussians", read_scene, tmp_path / "a.glb")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 6e6, peak  # positions alone: 2.4 MB; all coefficients: 38 MB


def test_deep_tree(tmp_path):
    """Nodes one below the other, more than Python's stack holds."""
    builder = Builder()
    below = builder.node(builder.primitive(random_scene(2, 0)), root=False)
    for _ in range(5000):
        below = builder.node(children=[below], root=False)
    builder.tree["scenes"][0]["nodes"] = [below]
    check_bad_scene(tmp_path / "a.glb", builder.glb(), "or too deep")


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("antialiased", (False, True))
def test_written_file(tmp_path, degree, antialiased):
    """Every number of a written GLB, and that it reads like the PLY."""
    scene = replace(random_scene(33, degree), antialiased=antialiased)
    write_glb(tmp_path / "a.glb", scene)
    write_ply(tmp_path / "a.ply", scene)
    table, binary = glb_parts((tmp_path / "a.glb").read_bytes())
    values = {}
    for name, index in table["meshes"][0]["primitives"][0]["attributes"].items():
        accessor, view = table["accessors"][index], table["bufferViews"][index]
        form = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        part = binary[view["byteOffset"] :][: view["byteLength"]]
        values[name] = np.frombuffer(part, form).reshape(accessor["count"], -1)
        kinds = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
        assert accessor["type"] == kinds[values[name].shape[1]] and len(values[name]) == 33
        assert accessor.get("normalized", False) == (name == "COLOR_0")
    assert len(values) == 5 + (degree + 1) ** 2
    position = (scene.position @ HALF_TURN).astype(np.float32)
    assert np.array_equal(values["POSITION"], position)
    bounds = table["accessors"][0]
    assert bounds["min"] == position.min(axis=0).tolist()
    assert bounds["max"] == position.max(axis=0).tolist()
    colour = 255 * np.clip(0.5 + SH_C0 * scene.sh[:, 0], 0, 1)
    assert np.abs(values["COLOR_0"][:, :3] - colour).max() <= 0.5
    sh = (scene.sh * odd_orders(degree)[:, None]).astype(np.float32)
    stored = [v for n, v in values.items() if "SH_DEGREE" in n]
    assert np.array_equal(np.stack(stored, axis=1), sh)
    assert table["extensionsUsed"] == [KHR]
    found, ply = read_scene(tmp_path / "a.glb"), read_scene(tmp_path / "a.ply")
    assert np.array_equal(found.position, ply.position) and np.array_equal(found.sh, ply.sh)
    for name in ("scale", "quaternion", "opacity"):
        assert np.allclose(getattr(found, name), getattr(ply, name), rtol=1e-6, atol=3e-7), name
    assert found.antialiased == antialiased
    assert found.mark == ("glTF extras 'SplatRenderMode: mip'" if antialiased else "")


def test_odd_numbers_are_written(tmp_path):
    """NaN, Inf, zero quaternions and numbers beyond float32; the JSON stays valid."""
    scene = random_scene(6, 1)
    scene.position[:3, 0] = np.nan, np.inf, 1e39
    scene.quaternion[3] = 0
    scene.sh[4] = np.nan
    write_glb(tmp_path / "a.glb", scene)
    table, _ = glb_parts((tmp_path / "a.glb").read_bytes())
    assert np.isfinite([table["accessors"][0][side] for side in ("min", "max")]).all()
    found = read_scene(tmp_path / "a.glb")
    assert np.isnan(found.position[0, 0]) and np.isinf(found.position[1:3, 0]).all()
    assert np.abs(found.quaternion[3]).tolist() == [1, 0, 0, 0]
    assert np.isnan(found.sh[4]).all() and np.isfinite(found.sh[[0, 1, 2, 3, 5]]).all()
    refused("cannot be written", write_glb, tmp_path / "none" / "a.glb", scene)
    refused("holds 0 Gaussians", write_glb, tmp_path / "b.glb", scene[:0])
