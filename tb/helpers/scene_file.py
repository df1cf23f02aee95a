"""Writers of small scene files for tests, independent of the readers in `model`; refused files."""

import copy
import gzip
import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from PIL import Image

from splatcore.model.formats.read import read_scene
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene

FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {"float": "f4", "double": "f8", "uchar": "u1", "int": "i4", "uint": "u4"}

CHUNK_BOUNDS = [
    *("min_x", "min_y", "min_z", "max_x", "max_y", "max_z"),
    *("min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"),
    *("min_r", "min_g", "min_b", "max_r", "max_g", "max_b"),
]
PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def read_written(path: Path, data: bytes) -> Scene:
    """Write a file with this content and read its scene."""
    path.write_bytes(data)
    return read_scene(path)


def check_refused(read: Callable[[Path], object], path: Path | str, message: str) -> None:
    """Check that `read` refuses a file with one line: its path at the beginning, and `message`."""
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
    assert message.strip() in str(error.value)


def check_bad_scene(path: Path, data: bytes, message: str) -> None:
    """Check that a scene file with this content is refused with its path, a colon and `message`."""
    path.write_bytes(data)
    check_refused(read_scene, path, message)
    check_refused(read_scene, path, f"{path}: ")


def edited(value: object, *keys: object) -> object:
    """A copy of nested tables with one value replaced by the last of `keys`, or removed (None)."""
    value = copy.deepcopy(value)
    *path, last, new = keys
    table = value
    for key in path:
        table = table[key]
    if new is None:
        del table[last]
    else:
        table[last] = new
    return value


def ply_columns(scene: Scene) -> dict[str, np.ndarray]:
    """The columns of a 3DGS PLY of a scene: property → float32 [N]."""
    columns = dict(zip("xyz", scene.position.T, strict=True))
    groups = {"f_dc": scene.sh[:, 0], "scale": np.log(scene.scale), "rot": scene.quaternion}
    for group, values in groups.items():
        columns |= {f"{group}_{i}": values[:, i] for i in range(values.shape[1])}
    coefficients = scene.sh.shape[1] - 1
    for channel in range(3):
        for k in range(coefficients):
            columns[f"f_rest_{channel * coefficients + k}"] = scene.sh[:, 1 + k, channel]
    columns["opacity"] = np.log(scene.opacity / (1 - scene.opacity))
    return {name: column.astype(np.float32) for name, column in columns.items()}


def ply_bytes(
    elements: dict[str, dict[str, np.ndarray]],
    form: str = "binary_little_endian",
    types: dict[str, str] | None = None,
    newline: str = "\n",
    comments: tuple[str, ...] = (),
) -> bytes:
    """A PLY file of element → property → values. types: of properties, `float` by default."""
    types = types or {}
    lines, body = ["ply", f"format {form} 1.0", "comment made by a test"], b""
    lines += [f"comment {text}" for text in comments]
    for element, columns in elements.items():
        count = len(next(iter(columns.values())))
        lines.append(f"element {element} {count}")
        lines += [f"property {types.get(name, 'float')} {name}" for name in columns]
        table = np.empty(
            count, [(name, FORMATS[form] + TYPES[types.get(name, "float")]) for name in columns]
        )
        for name, column in columns.items():
            table[name] = column
        if form == "ascii":
            body += "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist()).encode()
        else:
            body += table.tobytes()
    return newline.join([*lines, "end_header", ""]).encode() + body


def compressed_ply_bytes(
    bounds: np.ndarray, packed: np.ndarray, sh: np.ndarray, names: list[str] = CHUNK_BOUNDS,
    comments: tuple[str, ...] = (),
) -> bytes:  # fmt: skip
    """A compressed PLY of bounds [C, 18], packed words [N, 4] and SH bytes [N, 0 | 9 | 24 | 45]."""
    elements = {
        "chunk": dict(zip(names, bounds.T, strict=True)),
        "vertex": dict(zip(PACKED, packed.T, strict=True)),
    }
    types = dict.fromkeys(PACKED, "uint")
    if sh.shape[1]:
        elements["sh"] = {f"f_rest_{i}": column for i, column in enumerate(sh.T)}
        types |= dict.fromkeys(elements["sh"], "uchar")
    return ply_bytes(elements, types=types, comments=comments)


def compressed_ply(count: int, degree: int = 0, comments: tuple[str, ...] = ()) -> bytes:
    """A compressed PLY of random Gaussians, whose higher harmonics have bytes of 0."""
    rng = np.random.default_rng(0)
    bounds = rng.normal(size=(-(-count // 256), 18)).astype(np.float32)
    packed = rng.integers(0, 1 << 32, (count, 4), np.uint32)
    sh = np.zeros((count, 3 * ((degree + 1) ** 2 - 1)), np.uint8)
    return compressed_ply_bytes(bounds, packed, sh, comments=comments)


def spz_codes(version: int, count: int, degree: int, seed: int = 0) -> list[np.ndarray]:
    """Random bytes for the sections of an SPZ file: positions, alphas, colours, scales,
    quaternions, SH; [N, bytes per Gaussian] each.
    """
    rng = np.random.default_rng(seed)
    position, quaternion = 6 if version == 1 else 9, 3 if version < 3 else 4
    sizes = (position, 1, 3, 3, quaternion, 3 * ((degree + 1) ** 2 - 1))
    codes = [rng.integers(0, 256, (count, size), np.uint8) for size in sizes]
    if version == 1:
        codes[0] = rng.normal(size=(count, 3)).astype("<f2").view(np.uint8)
    return codes


def spz_bytes(
    version: int, codes: list[np.ndarray], degree: int, fraction: int = 12, flags: int = 0,
    records: bytes = b"", content_size: bool = True,
) -> bytes:  # fmt: skip
    """An SPZ file of the sections of `spz_codes`; records: of extensions; content_size: whether
    streams of version 4 state their sizes."""
    sections = [code.tobytes() for code in codes if code.size]
    head = struct.pack("<4sIIBB", b"NGSP", version, len(codes[0]), degree, fraction)
    if version < 4:
        return gzip.compress(head + bytes([flags, 0]) + b"".join(sections) + records, mtime=0)
    packer = zstandard.ZstdCompressor(write_content_size=content_size)
    streams = [packer.compress(section) for section in sections]
    toc = [struct.pack("<QQ", *map(len, pair)) for pair in zip(streams, sections, strict=True)]
    head += struct.pack("<BBI12x", flags, len(streams), 32 + len(records))
    return head + records + b"".join(toc) + b"".join(streams)


def smallest_three(q: np.ndarray) -> np.ndarray:
    """A quaternion (x, y, z, w) of SPZ 3 and 4: 2 bits for the largest, then sign and 9 bits for
    each of the others."""
    largest = int(np.argmax(np.abs(q)))
    word = largest
    for i in set(range(4)) - {largest}:
        value = q[i] * np.sign(q[largest])
        word = word << 10 | (value < 0) << 9 | round(min(abs(value) * np.sqrt(2), 1) * 511)
    return np.frombuffer(struct.pack("<I", word), np.uint8)


def spz_of(scene: Scene, number: int | None = None) -> bytes:
    """An SPZ file, version 4, of a scene. number: code of its axes in an extension record."""
    codes = spz_codes(4, len(scene), scene.sh_degree)
    fixed = np.rint(scene.position * 2**12).astype(np.int64) & 0xFFFFFF
    codes[0] = np.stack([fixed >> 8 * k & 255 for k in range(3)], 2).astype(np.uint8)
    codes[0] = codes[0].reshape(len(scene), 9)
    codes[1] = np.rint(scene.opacity * 255).astype(np.uint8)[:, None]
    codes[2] = np.clip(np.rint((scene.sh[:, 0] * 0.15 + 0.5) * 255), 0, 255).astype(np.uint8)
    codes[3] = np.clip(np.rint((np.log(scene.scale) + 10) * 16), 0, 255).astype(np.uint8)
    unit = scene.quaternion / np.linalg.norm(scene.quaternion, axis=1, keepdims=True)
    codes[4] = np.stack([smallest_three(q) for q in unit[:, [1, 2, 3, 0]]])
    rest = np.clip(np.rint(scene.sh[:, 1:] * 128 + 128), 0, 255).astype(np.uint8)
    codes[5] = rest.reshape(len(scene), -1)
    record = struct.pack("<III", 0xADBE0003, 4, number) if number else b""
    return spz_bytes(4, codes, scene.sh_degree, flags=2 if number else 0, records=record)


def splat_bytes(count: int, seed: int = 0) -> bytes:
    """A .splat file of random Gaussians."""
    rng = np.random.default_rng(seed)
    data = b""
    for _ in range(count):
        numbers = [rng.normal(size=3).astype("<f4"), rng.uniform(0, 1, 3).astype("<f4")]
        data += b"".join(map(np.ndarray.tobytes, [*numbers, rng.integers(0, 256, 8, np.uint8)]))
    return data


def image_bytes(pixels: np.ndarray, form: str = "WEBP") -> bytes:
    """A lossless image of pixels [height, width, 3 | 4], exact also where alpha is 0."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, form, **({"lossless": True, "exact": True}))
    return file.getvalue()


def sog_codes(count: int, degree: int, width: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random images of a SOG file, uint8 [height, width, 4]; centroids [2, 64·K, 3]."""
    rng = np.random.default_rng(seed)
    shape = (-(-count // width), width, 4)
    names = ["means_l", "means_u", "quats", "scales", "sh0"]
    images = {name: rng.integers(0, 256, shape, np.uint8) for name in names}
    images["quats"][..., 3] = rng.integers(252, 256, shape[:2])
    if degree:
        coefficients = (degree + 1) ** 2 - 1
        images["shN_centroids"] = rng.integers(0, 256, (2, 64 * coefficients, 3), np.uint8)
        labels = rng.integers(0, 100, shape[:2])
        images["shN_labels"] = np.stack([labels, labels >> 8, 0 * labels], 2).astype(np.uint8)
    return images


def sog_meta(version: int, count: int, degree: int, seed: int = 0) -> dict:
    """A meta.json for `sog_codes`."""
    rng = np.random.default_rng(seed)

    def book(low: float, high: float, channels: int) -> dict:
        if version == 2:
            return {"codebook": rng.uniform(low, high, 256).tolist()}
        if not channels:
            return {"mins": low, "maxs": high, "quantization": 8}
        lowest = (low * rng.uniform(0.5, 1, channels)).tolist()
        return {"shape": [count, channels], "mins": lowest, "maxs": [high] * channels}

    bounds = {"mins": [-1.0, -2.0, 0.5], "maxs": [1.0, 2.5, 0.5]}
    meta = {
        "means": bounds | {"files": ["means_l.webp", "means_u.webp"]},
        "scales": book(-9, -1, 3) | {"files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": book(-2, 2, 4) | {"files": ["sh0.webp"]},
    }
    if version == 2:
        meta |= {"version": 2, "count": count}
    else:
        meta["means"]["shape"] = [count, 3]
    if degree:
        meta["shN"] = book(-1, 1, 0) | {"files": ["shN_centroids.webp", "shN_labels.webp"]}
        meta["shN"] |= {"bands": degree, "count": 100} if version == 2 else {}
    return meta


def sog_bytes(meta: object, images: dict[str, np.ndarray | bytes]) -> bytes:
    """A SOG file. images: pixels, or bytes of an image file."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("meta.json", meta if isinstance(meta, str) else json.dumps(meta))
        for name, image in images.items():
            data = image if isinstance(image, bytes) else image_bytes(image)
            archive.writestr(f"{name}.webp", data)
    return file.getvalue()
