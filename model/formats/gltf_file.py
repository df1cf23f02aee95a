"""glTF 2.0 files: JSON, buffers, accessors and nodes. Source: Khronos, "glTF 2.0 Specification".

A GLB holds the JSON and one buffer; other buffers are base64 texts in the JSON or files next to it.
"""

import base64
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error

GLB_MAGIC = b"glTF"
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Component type of an accessor → numpy's type."""

TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
"""Type of an accessor → components per element; matrices hold no attributes of Gaussians."""

STRIDE_MAX = 252

DEPTH_MAX = 1000  # nodes below each other


@dataclass(frozen=True)
class Accessor:
    """The elements of an accessor.

    stored: [N, components], in the file's memory
    normalised: integers stand for numbers within ±1
    """

    stored: np.ndarray
    normalised: bool

    def numbers(self, rows: slice) -> np.ndarray:
        """Some rows as numbers: float32 as stored, others float64."""
        found = self.stored[rows]
        if found.dtype == np.float32:
            return found
        found = found.astype(np.float64)
        return np.maximum(found / np.iinfo(self.stored.dtype).max, -1) if self.normalised else found


@dataclass(frozen=True)
class Gltf:
    """An open glTF file."""

    path: str | os.PathLike
    tree: dict  # the JSON
    binary: memoryview | None = None  # a GLB's buffer
    notes: tuple[str, ...] = ()
    _buffers: dict[int, memoryview] = field(default_factory=dict)

    @property
    def held(self) -> int:
        """Size of the buffers read so far, in bytes."""
        return sum(map(len, self._buffers.values()))

    def item(self, kind: str, index: int) -> tuple[dict, str]:
        """Object `index` of a list of the JSON, and its location for messages."""
        items = file.field(self.tree, kind, list, self.path, [])
        where = f"{self.path}: {kind}[{index}]"
        if not 0 <= index < len(items):
            raise input_error(where, "is missing")
        return file.checked(items[index], dict, where), where

    def buffer(self, index: int) -> memoryview:
        """The bytes of a buffer, as many as it claims."""
        if index not in self._buffers:
            table, where = self.item("buffers", index)
            size = _size(table, "byteLength", where, minimum=1)
            data = self._content(table, index, where)
            if len(data) < size:
                raise input_error(where, f"holds {len(data)} of {size} bytes")
            self._buffers[index] = memoryview(data)[:size]
        return self._buffers[index]

    def _content(self, table: dict, index: int, where: str) -> bytes | memoryview:
        """The stored content of a buffer."""
        if "uri" not in table:
            if index or self.binary is None:
                raise input_error(where, "has no data")
            return self.binary
        uri = file.field(table, "uri", str, where)
        scheme, colon, rest = uri.partition(":")
        if colon and scheme.lower() == "data":
            head, _, text = rest.partition(",")
            if not head.endswith(";base64"):
                raise input_error(where, "data URI is not base64")
            with file.reading(where, "data URI is not base64"):
                return base64.b64decode(text, validate=True)
        if colon and len(scheme) > 1 and scheme.isalnum():
            raise input_error(where, f"URI scheme '{scheme[:20]}' is not supported")
        return memoryview(file.mapped(Path(self.path).parent / unquote(uri)))

    def view(self, index: int) -> tuple[memoryview, int, str]:
        """The bytes of a buffer view, its stride (0: not given), and its location for messages."""
        table, where = self.item("bufferViews", index)
        packed = [name for name in _names(table, where) if "meshopt" in name]
        if packed:
            raise input_error(where, f"{packed[0]} is not supported")
        data = self.buffer(file.field(table, "buffer", int, where))
        start = _size(table, "byteOffset", where, 0)
        size = _size(table, "byteLength", where, minimum=1)
        if start + size > len(data):
            raise input_error(where, f"ends at byte {start + size} of a buffer of {len(data)}")
        stride = _size(table, "byteStride", where, 0)
        if stride > STRIDE_MAX:
            raise input_error(where, f"'byteStride' is {stride}, not at most {STRIDE_MAX}")
        return data[start : start + size], stride, where

    def accessor(self, index: int) -> "Accessor":
        """An accessor, checked."""
        table, where = self.item("accessors", index)
        count = _size(table, "count", where, minimum=1)
        kind = file.field(table, "type", str, where)
        component = file.field(table, "componentType", int, where)
        if kind not in TYPES or component not in COMPONENTS:
            raise input_error(where, f"{kind[:20]} of component type {component} is not supported")
        if "sparse" in table:
            raise input_error(where, "'sparse' is not supported")
        data, stride, _ = self.view(file.field(table, "bufferView", int, where))
        form, columns = np.dtype(COMPONENTS[component]), TYPES[kind]
        row, start = columns * form.itemsize, _size(table, "byteOffset", where, 0)
        if stride and stride < row:
            raise input_error(where, f"elements of {row} bytes have a stride of {stride}")
        stride = stride or row
        end = start + stride * (count - 1) + row
        if end > len(data):
            raise input_error(where, f"{count} elements end at byte {end} of {len(data)}")
        strides = (stride, form.itemsize)
        stored = np.ndarray((count, columns), form, data, start, strides)
        return Accessor(stored, table.get("normalized") is True and form.kind in "iu")

    def placements(self) -> Iterator[tuple[int, np.ndarray, str]]:
        """Mesh, matrix [4, 4] into the scene and location of each node with a mesh."""
        table, where = self._scene()
        roots = file.field(table, "nodes", list, where, [])
        stack, seen = [(node, np.eye(4), 0, where) for node in reversed(roots)], set()
        while stack:
            index, above, depth, parent = stack.pop()
            index = file.checked(index, int, f"{parent}: node")
            node, where = self.item("nodes", index)
            if index in seen or depth > DEPTH_MAX:
                raise input_error(where, "is below more than one node, or too deep")
            seen.add(index)
            with np.errstate(all="ignore"):
                matrix = above @ _matrix(node, where)
            for name in _names(node, where):
                if name == "EXT_mesh_gpu_instancing":
                    raise input_error(where, f"{name} is not supported")
            if "mesh" in node:
                yield file.field(node, "mesh", int, where), matrix, where
            below = file.field(node, "children", list, where, [])
            stack += [(child, matrix, depth + 1, where) for child in reversed(below)]

    def _scene(self) -> tuple[dict, str]:
        """The scene that the file shows; without scenes one of all nodes that are no children."""
        if "scenes" in self.tree:
            return self.item("scenes", file.field(self.tree, "scene", int, self.path, 0))
        count, below = len(file.field(self.tree, "nodes", list, self.path, [])), set()
        for index in range(count):
            node, where = self.item("nodes", index)
            children = file.field(node, "children", list, where, [])
            below |= {file.checked(child, int, f"{where}: node") for child in children}
        return {
            "nodes": [node for node in range(count) if node not in below]
        }, f"{self.path}: nodes"


def open_gltf(path: str | os.PathLike) -> Gltf:
    """Open a GLB or a glTF's JSON, without its buffers."""
    data = memoryview(file.mapped(path))
    if data[:4] != GLB_MAGIC:
        return _checked(Gltf(path, file.checked(file.parse_json(bytes(data), path), dict, path)))
    if len(data) < 20:
        raise input_error(path, "GLB header is cut off")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise input_error(path, f"GLB version {version} is not supported")
    if length > len(data):
        raise input_error(path, f"holds {len(data)} of the {length} bytes of its GLB header")
    chunks, start = [], 12
    while start + 8 <= length and len(chunks) < 2:
        size, kind = struct.unpack_from("<II", data, start)
        start += 8
        if start + size > length:
            raise input_error(path, f"chunk {len(chunks)} of {size} bytes is cut off")
        chunks.append((kind, data[start : start + size]))
        start += size
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise input_error(path, "GLB does not begin with a JSON chunk")
    tree = file.checked(
        file.parse_json(bytes(chunks[0][1]), f"{path}: JSON"), dict, f"{path}: JSON"
    )
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else None
    return _checked(Gltf(path, tree, binary, file.surplus(len(data) - length)))


def _checked(gltf: Gltf) -> Gltf:
    """The file, if it is of glTF version 2."""
    where = f"{gltf.path}: asset"
    asset = file.field(gltf.tree, "asset", dict, gltf.path)
    version = file.field(asset, "version", str, where)
    if version.split(".")[0] != "2":
        raise input_error(where, f"glTF version '{version[:20]}' is not supported")
    return gltf


def _size(table: dict, name: str, where: str, default: int | None = None, minimum: int = 0) -> int:
    """A count, size or offset: an integer of at least `minimum`."""
    value = file.field(table, name, int, where, default)
    if value < minimum:
        raise input_error(where, f"{name!r} is {value}, not at least {minimum}")
    return value


def _names(table: dict, where: str) -> list[str]:
    """The names of an object's extensions."""
    return list(file.field(table, "extensions", dict, where, {}))


def _matrix(node: dict, where: str) -> np.ndarray:
    """The transform of a node, [4, 4]: its matrix, by column, or translation·rotation·scale."""
    if "matrix" in node:
        return file.array_field(node, "matrix", (16,), where).reshape(4, 4).T

    def part(name: str, *default: float) -> np.ndarray:
        return file.array_field({name: list(default)} | node, name, (len(default),), where)

    turn, matrix = part("rotation", 0, 0, 0, 1), np.eye(4)
    norm = np.linalg.norm(turn)
    if not 0 < norm < np.inf:
        raise input_error(where, f"'rotation' is a quaternion of norm {norm:g}")
    x, y, z, w = turn / norm
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2 * (w * cross + cross @ cross)
    matrix[:3, :3] = rotation * part("scale", 1, 1, 1)
    matrix[:3, 3] = part("translation", 0, 0, 0)
    return matrix
