"""PLY scenes: the original layout of 3DGS in any property order, and PlayCanvas's compressed PLY.

Sources: Kerbl et al. 2023 (`GaussianModel.save_ply`) and PlayCanvas's "Compressed PLY" format, as
its splat-transform reads it; `gsply` decodes all of it but the SH.
"""

import os
from dataclasses import replace

import numpy as np
from plyfile import PlyData, PlyElement

from splatcore.model.formats import file, ply_marks
from splatcore.model.formats.file import file_size, input_error
from splatcore.spec.scene import Scene, sh_count

HEADER_MAX = 1 << 16  # bytes within which a header must end

SCALE_MIN = float(np.finfo(np.float32).tiny)
"""Scales below are written as this: its logarithm is finite."""

OPACITY_MARGIN = 2.0**-24
"""Opacities are written at least this far from 0 and 1: the logit is finite."""

CHUNK = 256  # Gaussians that share bounds in a compressed PLY

REST_DEGREE = {3 * (sh_count(degree) - 1): degree for degree in range(4)}
"""Number of f_rest properties → SH degree."""

SH_VALUE = (np.arange(256) + 0.5) / 32 - 4
SH_VALUE[[0, 255]] = -4, 4
"""SH coefficient of each byte of a compressed PLY: the middle of its step of 1/32 in ± 4, but the
outermost bytes, to which a writer clamps, stand for the ends (splat-transform `decompressPly`).
"""

_BOUNDS = [
    f"{side}_{name}"
    for names in ("x y z", "scale_x scale_y scale_z", "r g b")
    for side in ("min", "max")
    for name in names.split()
]
_PLAIN = "f_dc_0 f_dc_1 f_dc_2 x y z scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 opacity"
_PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def matches(start: bytes, suffix: str) -> bool:
    """True if a file's first four bytes are those of a PLY."""
    return start in (b"ply\n", b"ply\r")


def read(path: str | os.PathLike) -> Scene:
    """The scene of a PLY file: binary of either byte order or ASCII, plain or compressed."""
    start = _check_header(path)
    with file.reading(path):
        ply = PlyData.read(os.fspath(path))
    elements = {element.name: element.data for element in ply.elements}
    if "vertex" not in elements:
        raise input_error(path, "element 'vertex' is missing")
    file.check_count(len(elements["vertex"]), path)
    compressed = "chunk" in elements
    scene = _compressed(elements, path) if compressed else _plain(elements["vertex"], path)
    if not ply.text:  # plyfile itself checks the ends of lines
        rest = file_size(path) - start - sum(element.nbytes for element in elements.values())
        size = 1 if compressed else 4  # as all known writers have it
        file.check_degree(scene.sh_degree, len(scene), size, rest, path)
    comments = [text for part in (ply, *ply.elements) for text in part.comments]
    return ply_marks.of_comments(scene, comments)


def _check_header(path: str | os.PathLike) -> int:
    """The header's size in bytes; refuses one of which plyfile would allocate for, or loop over,
    more than the file can hold.
    """
    size = file_size(path)
    text = file.read_bytes(path, HEADER_MAX).decode("latin-1")
    if not text.startswith("ply"):
        raise input_error(path, "does not start with 'ply'")
    # The first line's end is the end of all of them: LF, CR LF or CR, as plyfile has it.
    newline = "\r\n" if text[3:5] == "\r\n" else text[3:4]
    header, end, _ = text.partition(f"{newline}end_header{newline}")
    if newline not in ("\n", "\r", "\r\n") or not end:
        raise input_error(path, f"header has no 'end_header' within {HEADER_MAX} bytes")
    elements: list[list] = []  # [name, count, properties]
    bytes_per_value = 1
    for words in (line.split() for line in header.split(newline)):
        if words[:2] == ["format", "ascii"]:
            bytes_per_value = 2  # a digit and a separator
        elif words[:1] == ["element"]:
            with file.reading(path, f"header: {' '.join(words)[:80]!r} has no count"):
                elements.append([words[1], int(words[2]), 0])
        elif words[:1] == ["property"] and elements:
            elements[-1][2] += 1
            if words[1:2] == ["list"]:
                raise input_error(path, f"element {elements[-1][0]!r} has list properties")
    for name, count, properties in elements:
        if properties == 0 or not 0 <= count * properties * bytes_per_value <= size + 1:
            raise input_error(
                path, f"element {name!r}: {count} × {properties} values in {size} bytes"
            )
    return len(header) + len(end)


def _columns(table: np.ndarray, names: list[str], where: object) -> np.ndarray:
    """Named properties of a structured array [N] as float64 [N, len(names)]."""
    for name in names:
        if name not in table.dtype.names:
            raise input_error(where, f"property {name!r} is missing")
    return np.stack([np.asarray(table[name], np.float64) for name in names], axis=1)


def _rest_names(table: np.ndarray, where: object) -> list[str]:
    """The names f_rest_0 … of a structured array, as many as it has, in numeric order."""
    count = sum(name.startswith("f_rest_") for name in table.dtype.names)
    if count not in REST_DEGREE:
        raise input_error(where, f"{count} properties 'f_rest_*', not 0, 9, 24 or 45")
    return [f"f_rest_{i}" for i in range(count)]


def _plain(vertex: np.ndarray, path: str | os.PathLike) -> Scene:
    """The scene of an uncompressed `vertex` element: logarithms of scales, logits of opacities."""
    rest = _rest_names(vertex, path)
    parts = np.split(_columns(vertex, _PLAIN.split(), path), (3, 6, 9, 13), axis=1)
    constant, position, log_scale, quaternion, opacity = parts
    higher = _channel_last(_columns(vertex, rest, path)) if rest else None
    opacity = file.sigmoid(opacity[:, 0])
    scene = file.stored_scene(path, position, log_scale, quaternion, opacity, constant, higher)
    names, used = vertex.dtype.names, [*_PLAIN.split(), *rest]
    if ply_marks.FILTER in names:
        scene = ply_marks.fused(scene, _columns(vertex, [ply_marks.FILTER], path)[:, 0])
        used.append(ply_marks.FILTER)
    return replace(scene, notes=scene.notes + ply_marks.unused(names, used))


def _channel_last(rest: np.ndarray) -> np.ndarray:
    """Coefficients [N, 3·K], stored as f_rest_[channel·K + coefficient], as [N, K, 3]."""
    return rest.reshape(len(rest), 3, -1).transpose(0, 2, 1)


def _compressed(elements: dict[str, np.ndarray], path: str | os.PathLike) -> Scene:
    """The scene of a compressed PLY: its elements, checked, are rewritten in the one layout that
    gsply decodes without checks of its own.
    """
    chunk, vertex = elements["chunk"], elements["vertex"]
    chunks = -(-len(vertex) // CHUNK)
    if len(chunk) != chunks:
        raise input_error(path, f"element 'chunk' has {len(chunk)} rows, not {chunks}")
    names = _BOUNDS
    if "min_r" not in chunk.dtype.names:  # files of SuperSplat 1 have no bounds of colours
        names = _BOUNDS[:12]
    bounds = np.zeros((chunks, len(_BOUNDS)), "<f4")
    bounds[:, 15:] = 1
    bounds[:, : len(names)] = _columns(chunk, names, path)
    packed = _integers(vertex, _PACKED, np.uint32, path)
    higher = None
    if "sh" in elements:
        if len(elements["sh"]) != len(vertex):
            raise input_error(path, f"element 'sh' has {len(elements['sh'])} rows")
        names = _rest_names(elements["sh"], path)
        sh = _integers(elements["sh"], names, np.uint8, path)
        higher = _channel_last(SH_VALUE[sh])
    import gsply  # imports numba, which takes a third of a second

    with file.reading(path):
        data = gsply.decompress_from_bytes(_layout(bounds, packed))
    opacity = file.sigmoid(data.opacities)
    arrays = data.means, data.scales, data.quats, opacity, data.sh0, higher
    scene = file.stored_scene(path, *arrays)
    return replace(scene, notes=ply_marks.unused(vertex.dtype.names, _PACKED))


def _integers(table: np.ndarray, names: list[str], kind: type, where: object) -> np.ndarray:
    """Named properties of a structured array [N], all of the type `kind`, as [N, len(names)]."""
    _columns(table[:0], names, where)
    for name in names:
        if table.dtype[name].newbyteorder("=") != np.dtype(kind):
            raise input_error(where, f"property {name!r} is not {np.dtype(kind).name}")
    columns = [np.asarray(table[name], kind) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((len(table), 0), kind)


def _layout(bounds: np.ndarray, packed: np.ndarray) -> bytes:
    """The canonical compressed PLY of bounds [C, 18] and packed [N, 4]."""
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {len(bounds)}"]
    lines += [f"property float {name}" for name in _BOUNDS]
    lines += [f"element vertex {len(packed)}"] + [f"property uint {name}" for name in _PACKED]
    header = "\n".join([*lines, "end_header", ""]).encode()
    return header + bounds.tobytes() + packed.astype("<u4").tobytes()


def write_ply(path: str | os.PathLike, scene: Scene) -> None:
    """Writes the original layout of 3DGS: binary, little-endian, float32, normals of zero; the
    comment `ply_marks.COMMENT` if the scene is antialiased."""
    opacity = np.clip(scene.opacity, OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    with np.errstate(divide="ignore"):
        log_scale = np.log(np.maximum(scene.scale, SCALE_MIN))
    rest = scene.sh[:, 1:].transpose(0, 2, 1).reshape(len(scene), -1)  # channel-major
    groups = [
        ("x y z", scene.position),
        ("nx ny nz", np.zeros((len(scene), 3))),
        ("f_dc_0 f_dc_1 f_dc_2", scene.sh[:, 0]),
        (" ".join(f"f_rest_{i}" for i in range(rest.shape[1])), rest),
        ("opacity", np.log(opacity / (1 - opacity))[:, None]),
        ("scale_0 scale_1 scale_2", log_scale),
        ("rot_0 rot_1 rot_2 rot_3", scene.quaternion),
    ]
    names = " ".join(names for names, _ in groups).split()
    vertex = np.empty(len(scene), [(name, "<f4") for name in names])
    with np.errstate(over="ignore"):
        for name, column in zip(names, np.hstack([part for _, part in groups]).T, strict=True):
            vertex[name] = column
    comments = [ply_marks.COMMENT] if scene.antialiased else []
    with file.reading(path, "cannot be written"):
        element = PlyElement.describe(vertex, "vertex")
        PlyData([element], byte_order="<", comments=comments).write(os.fspath(path))
