"""Writer of small glTF files for tests, independent of the reader and the writer in `model`."""

import base64
import json
import struct

import numpy as np
from scipy.spatial.transform import Rotation

from splatcore.spec.scene import Scene

KHR = "KHR_gaussian_splatting"
CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Maps the axes of PLY (right, down, front) to glTF's (left, up, front), and back."""


def odd_orders(degree: int) -> np.ndarray:
    """1 or −1 for each coefficient: −1 for an odd order m."""
    return np.array([(-1) ** m for l in range(degree + 1) for m in range(-l, l + 1)])  # noqa: E741


def attributes(scene: Scene) -> dict[str, np.ndarray]:
    """The attributes of a scene in the axes of PLY, turned to glTF's: name → [N, components]."""
    unit = Rotation.from_quat(scene.quaternion[:, [1, 2, 3, 0]])
    found = {
        "POSITION": scene.position @ HALF_TURN,
        f"{KHR}:ROTATION": (Rotation.from_matrix(HALF_TURN) * unit).as_quat(),
        f"{KHR}:SCALE": scene.scale,
        f"{KHR}:OPACITY": scene.opacity[:, None],
    }
    sh = scene.sh * odd_orders(scene.sh_degree)[:, None]
    for degree in range(scene.sh_degree + 1):
        for k in range(2 * degree + 1):
            found[f"{KHR}:SH_DEGREE_{degree}_COEF_{k}"] = sh[:, degree**2 + k]
    return found


class Builder:
    """Collects views, accessors, primitives and nodes of a file with one buffer."""

    def __init__(self):
        self.binary = b""
        self.tree = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{name: [] for name in ("nodes", "meshes", "accessors", "bufferViews")},
        }

    def view(self, data: bytes, **options) -> int:
        """Add a buffer view; return its index."""
        self.binary += bytes(-len(self.binary) % 4)
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.tree["bufferViews"].append(place | options)
        self.binary += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, form: str = "f4", **options) -> int:
        """Add an accessor with a view of its own, or in the `bufferView` given."""
        table = {"componentType": CODES[form], "count": len(values), "type": KINDS[values.shape[1]]}
        if "bufferView" not in options:
            table["bufferView"] = self.view(values.astype("<" + form).tobytes())
        self.tree["accessors"].append(table | options)
        return len(self.tree["accessors"]) - 1

    def primitive(self, scene: Scene, **changed) -> dict:
        """A primitive of a scene's float32 attributes."""
        names = {name: self.accessor(values) for name, values in attributes(scene).items()}
        return {
            "attributes": names,
            "mode": 0,
            "extensions": {KHR: {"kernel": "ellipse"}},
        } | changed

    def packed(self, spz: bytes, name: str = f"{KHR}_compression_spz_2") -> dict:
        """A primitive of an SPZ file."""
        inner = {name: {"bufferView": self.view(spz)}}
        return {"attributes": {}, "mode": 0, "extensions": {KHR: {"extensions": inner}}}

    def node(self, *primitives: dict, root: bool = True, **options) -> int:
        """Add a node, with a mesh of the primitives if there are any; return its index."""
        if primitives:
            options["mesh"] = len(self.tree["meshes"])
            self.tree["meshes"].append({"primitives": list(primitives)})
        self.tree["nodes"].append(options)
        index = len(self.tree["nodes"]) - 1
        if root:
            self.tree["scenes"][0]["nodes"].append(index)
        return index

    def glb(self) -> bytes:
        return glb_bytes(self.tree | {"buffers": [{"byteLength": len(self.binary)}]}, self.binary)

    def gltf(self, uri: str | None = None) -> bytes:
        """The JSON with the buffer at `uri`, by default in the JSON."""
        inside = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        buffer = {"byteLength": len(self.binary), "uri": uri or inside}
        return json.dumps(self.tree | {"buffers": [buffer]}).encode()


def glb_bytes(tree: object, binary: bytes, version: int = 2) -> bytes:
    """A GLB of a JSON and a buffer."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", version, 12 + len(chunks)) + chunks


def glb_of(scene: Scene, **options) -> bytes:
    """A GLB of one node with one primitive; options: of the node."""
    builder = Builder()
    builder.node(builder.primitive(scene), **options)
    return builder.glb()


def glb_parts(data: bytes) -> tuple[dict, bytes]:
    """The JSON and the buffer of a GLB, whose sizes must agree."""
    magic, version, length, size, kind = struct.unpack_from("<4sIIII", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), 0x4E4F534A) and size % 4 == 0
    rest, kind = struct.unpack_from("<II", data, 20 + size)
    assert kind == 0x004E4942 and 28 + size + rest == len(data) and rest % 4 == 0
    return json.loads(data[20 : 20 + size]), data[28 + size :]
