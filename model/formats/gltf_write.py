"""GLB files of Gaussians, laid out as PlayCanvas' splat-transform 3.7.0 writes them.

Source: Khronos, "KHR_gaussian_splatting". Every attribute is float32, one accessor each; COLOR_0
(8 bits) is for viewers that draw points.
"""

import json
import os
import struct

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.gltf import EXTENSION, MARK, VALUES, half_turn
from splatcore.model.formats.gltf_file import BINARY_CHUNK, GLB_MAGIC, JSON_CHUNK
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.scene import Scene

ARRAY_BUFFER, UNSIGNED_BYTE, FLOAT = 34962, 5121, 5126

TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}

GLB_MAX = (1 << 32) - 1
"""Largest size of a GLB in bytes, which its header holds in 32 bits."""


def write_glb(path: str | os.PathLike, scene: Scene) -> None:
    """Write a scene as GLB with KHR_gaussian_splatting, in glTF's axes.

    Quaternions are normalised. An antialiased scene is marked in the primitive's `extras`.
    """
    file.check_count(len(scene), path)  # glTF has no empty accessors
    with np.errstate(all="ignore"):  # NaN, Inf and numbers beyond float32 are written as they are
        attributes = _attributes(half_turn(scene, 1))
    parts = [np.ascontiguousarray(values).tobytes() for values in attributes.values()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()  # each part is a multiple of four bytes
    extension = VALUES | {"sortingMethod": "cameraDistance"}
    primitive = {
        "attributes": {name: index for index, name in enumerate(attributes)},
        "mode": 0,
        "extensions": {EXTENSION: extension},
    }
    if scene.antialiased:
        primitive["extras"] = MARK
    tree = {
        "asset": {"version": "2.0", "generator": "splatcore"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part), "target": ARRAY_BUFFER}
            for start, part in zip(starts, parts, strict=False)
        ],
        "accessors": [_accessor(k, values) for k, values in enumerate(attributes.values())],
    }
    accessor = tree["accessors"][0]  # positions, whose bounds glTF demands
    accessor |= _bounds(attributes["POSITION"])
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + starts[-1]
    if size > GLB_MAX:
        raise file.input_error(path, f"{size} bytes are more than a GLB can hold, {GLB_MAX}")
    with file.reading(path, "cannot be written"), open(path, "wb") as opened:
        opened.write(GLB_MAGIC + struct.pack("<II", 2, size))
        opened.write(struct.pack("<II", len(text), JSON_CHUNK) + text)
        opened.write(struct.pack("<II", starts[-1], BINARY_CHUNK))
        opened.writelines(parts)


def _attributes(scene: Scene) -> dict[str, np.ndarray]:
    """The attributes of a scene in glTF's axes: name → [N, components]."""
    quaternion = scene.quaternion / np.linalg.norm(scene.quaternion, axis=1, keepdims=True)
    colour = np.column_stack([COLOUR_OFFSET + SH_C0 * scene.sh[:, 0], scene.opacity])
    numbers = {
        "POSITION": scene.position,
        "COLOR_0": np.rint(255 * np.clip(np.nan_to_num(colour), 0, 1)).astype(np.uint8),
        f"{EXTENSION}:ROTATION": quaternion[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": scene.scale,
        f"{EXTENSION}:OPACITY": scene.opacity[:, None],
    }
    for degree in range(scene.sh_degree + 1):
        for k in range(2 * degree + 1):
            name = f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}"
            numbers[name] = scene.sh[:, degree * degree + k]
    return {n: v if v.dtype == np.uint8 else v.astype("<f4") for n, v in numbers.items()}


def _accessor(view: int, values: np.ndarray) -> dict:
    """The accessor of an attribute that fills a buffer view."""
    whole = values.dtype == np.uint8
    table = {"bufferView": view, "byteOffset": 0, "count": len(values)}
    table |= {"componentType": UNSIGNED_BYTE if whole else FLOAT, "type": TYPES[values.shape[1]]}
    return table | ({"normalized": True} if whole else {})


def _bounds(position: np.ndarray) -> dict[str, list[float]]:
    """Smallest and largest finite position, as glTF demands."""
    finite = np.where(np.isfinite(position), position, np.nan)
    held = ~np.isnan(finite).all(axis=0)
    low, high = (f(np.where(held, finite, 0), axis=0) for f in (np.nanmin, np.nanmax))
    return {"min": low.astype(float).tolist(), "max": high.astype(float).tolist()}
