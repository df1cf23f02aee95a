"""PLY scenes: the original layout of 3DGS in any property order, and PlayCanvas's compressed PLY.

Sources: Kerbl et al. 2023 (`GaussianModel.save_ply`) and PlayCanvas's "Compressed PLY" format, as
its splat-transform reads it; `gsply` decodes all of it but the SH.
"""

import os
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from splatcore.model.formats import file, ply_file, ply_marks
from splatcore.model.formats.file import input_error
from splatcore.model.formats.ply_file import PlyFile
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.scene import Scene, batches, sh_count

SCALE_MIN = float(np.finfo(np.float32).tiny)
"""Smallest scale that is written, so that its logarithm is finite."""

OPACITY_MARGIN = 2.0**-24
"""Smallest distance of a written opacity from 0 and 1, so that its logit is finite."""

GAUSSIANS = ("vertex", "chunk", "sh")  # elements from which a scene is read

CHUNK = 256  # Gaussians that share bounds in a compressed PLY

REST_DEGREE = {3 * (sh_count(degree) - 1): degree for degree in range(4)}
"""Number of f_rest properties → SH degree."""

SH_VALUE = ((np.arange(256) + 0.5) / 32 - 4).astype(np.float32)  # exactly
SH_VALUE[[0, 255]] = -4, 4
"""SH coefficient of each byte value of a compressed PLY: the middle of its step of 1/32 in ± 4. The
outermost values, to which writers clamp, are ± 4 (splat-transform `decompressPly`).
"""

_BOUNDS = [
    f"{side}_{name}"
    for names in ("x y z", "scale_x scale_y scale_z", "r g b")
    for side in ("min", "max")
    for name in names.split()
]
_PLACE, _SCALE = ["x", "y", "z"], ["scale_0", "scale_1", "scale_2"]
_ROTATION = ["rot_0", "rot_1", "rot_2", "rot_3"]
_PLAIN = [*_PLACE, *_SCALE, *_ROTATION, "opacity"]
_DC, _RGB = ["f_dc_0", "f_dc_1", "f_dc_2"], ["red", "green", "blue"]
FILTER = ply_marks.FILTER.lower()
_PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


def read(path: str | os.PathLike) -> Scene:
    """Read the scene of a PLY file: binary of either byte order or ASCII, plain or compressed.

    Names of properties may be in upper case. Elements with lists are skipped, unless they hold the
    Gaussians: then InputError is raised.
    """
    ply = ply_file.read(path)
    for name in GAUSSIANS:
        if name in ply.skipped:
            raise input_error(path, f"element {name!r} has list properties")
    if "vertex" not in ply.tables:
        raise input_error(path, "element 'vertex' is missing")
    tables = {name: _lower_case(table) for name, table in ply.tables.items()}
    rest = sum(name.startswith("f_rest_") for name in tables["vertex"].dtype.names)
    file.check_count(len(tables["vertex"]), path, REST_DEGREE.get(rest, 0))
    compressed = "chunk" in tables
    scene = _compressed(tables, path) if compressed else _plain(tables["vertex"], path)
    used = GAUSSIANS if compressed else GAUSSIANS[:1]
    others = [name for name, table in tables.items() if len(table) and name not in used]
    notes = ply_marks.unused((), (), others + ply.skipped) + _surplus(ply, scene, path)
    return ply_marks.of_comments(replace(scene, notes=scene.notes + notes), ply.comments)


def _lower_case(table: np.ndarray) -> np.ndarray:
    """The table with its names in lower case, unless two of them would become equal."""
    names = [name.lower() for name in table.dtype.names]
    if names == list(table.dtype.names) or len(set(names)) < len(names):
        return table
    table = table.view()
    table.dtype.names = names
    return table


def _surplus(ply: PlyFile, scene: Scene, path: str | os.PathLike) -> tuple[str, ...]:
    """A note on rows or bytes after the last element.

    Raises InputError if the surplus shows that elements were read at wrong places: if it is the SH
    of a higher degree, or if other elements come after the Gaussians.
    """
    vertex, last = ply.tables["vertex"], [*ply.tables][-1]
    row = 1 if ply.text else vertex.dtype.itemsize
    if not ply.text:
        size = 1 if "chunk" in ply.tables else 4  # as in files of all known writers
        file.check_degree(scene.sh_degree, len(scene), size, ply.rest, path)
    if ply.rest < row:
        return file.surplus(ply.rest)
    says = f"the header says {len(scene)} Gaussians, the file holds {len(scene) + ply.rest // row}"
    if last != "vertex" or ply.skipped:
        raise input_error(path, says)
    return (f"{says}: the rest is not read",)


def _check(table: np.ndarray, names: list[str], where: object, kind: type | None = None):
    """Raise InputError unless a table has the properties, all of the type `kind` if given."""
    for name in names:
        if name not in table.dtype.names:
            raise input_error(where, f"property {name!r} is missing")
    for name in names if kind else ():
        if table.dtype[name].newbyteorder("=") != np.dtype(kind):
            raise input_error(where, f"property {name!r} is not {np.dtype(kind).name}")


def _columns(table: np.ndarray, names: list[str], kind: type = np.float64) -> np.ndarray:
    """Properties of a structured array [N] by name, [N, len(names)], as `kind`."""
    fields, types = table.dtype.names, {table.dtype[name] for name in table.dtype.names}
    if len(types) == 1:  # ten times as fast as column by column
        flat = table.view(types.pop()).reshape(len(table), len(fields))
        return flat.take([fields.index(name) for name in names], axis=1).astype(kind, copy=False)
    found = np.empty((len(table), len(names)), kind)
    for column, name in zip(found.T, names, strict=True):
        column[:] = table[name]
    return found


def _rest_names(table: np.ndarray, where: object) -> list[str]:
    """The names f_rest_0 … that a structured array has, in numeric order."""
    count = sum(name.startswith("f_rest_") for name in table.dtype.names)
    if count not in REST_DEGREE:
        raise input_error(where, f"{count} properties 'f_rest_*', not 0, 9, 24 or 45")
    return [f"f_rest_{i}" for i in range(count)]


def _plain(vertex: np.ndarray, path: str | os.PathLike) -> Scene:
    """The scene of an uncompressed `vertex` element, with logarithms of scales and logits of
    opacities. The element is in the mapped file, and is converted batch by batch."""
    names = vertex.dtype.names
    coloured = set(_RGB) <= set(names) and "f_dc_0" not in names
    rest = [] if coloured else _rest_names(vertex, path)
    used = [*(_RGB if coloured else _DC), *_PLAIN]
    _check(vertex, used + rest, path)
    notes: tuple[str, ...] = ()
    if coloured:
        notes = ("colours are red, green, blue, without f_dc: SH degree 0",)
    types = {vertex.dtype[name].newbyteorder("=") for name in used[:3] + rest}
    kind = np.float32 if types == {np.dtype("f4")} and not coloured else np.float64

    of_sh = [*used[:3], *np.reshape(rest, (3, -1)).T.ravel()]  # by coefficient, then channel

    def convert(rows: slice) -> Scene:
        some = vertex[rows]
        sh = _columns(some, of_sh, kind).reshape(len(some), -1, 3)
        if coloured:
            sh = (_colours(vertex, sh) - COLOUR_OFFSET) / SH_C0
        position, scale, quaternion = (_columns(some, each) for each in (_PLACE, _SCALE, _ROTATION))
        opacity = file.sigmoid(_columns(some, ["opacity"])[:, 0])
        return Scene(position, np.exp(scale), quaternion, opacity, sh, os.fspath(path))

    scene = file.in_batches(len(vertex), convert)
    used += rest
    if FILTER in names:
        scene = ply_marks.fused(scene, _columns(vertex, [FILTER])[:, 0])
        used.append(FILTER)
    return replace(scene, notes=scene.notes + notes + ply_marks.unused(names, used))


def _colours(vertex: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Colours [N, 3], 1 for white, from values of red, green, blue: integers up to the largest of
    their type, or floats, which are returned unchanged."""
    whole = [np.iinfo(t).max if (t := vertex.dtype[n]).kind in "iu" else 1 for n in _RGB]
    return values / np.array(whole, np.float64)


def _channel_last(rest: np.ndarray) -> np.ndarray:
    """Convert coefficients [N, 3·K], stored as f_rest_[channel·K + coefficient], to [N, K, 3]."""
    return rest.reshape(len(rest), 3, -1).transpose(0, 2, 1)


def _compressed(elements: dict[str, np.ndarray], path: str | os.PathLike) -> Scene:
    """The scene of a compressed PLY. Its elements are checked and rewritten in the one layout that
    gsply decodes, because gsply checks nothing.
    """
    chunk, vertex = elements["chunk"], elements["vertex"]
    chunks = -(-len(vertex) // CHUNK)
    if len(chunk) != chunks:
        raise input_error(path, f"element 'chunk' has {len(chunk)} rows, not {chunks}")
    names = _BOUNDS  # files of SuperSplat 1 have no bounds of colours
    names = names if "min_r" in chunk.dtype.names else names[:12]
    _check(chunk, names, path)
    _check(vertex, _PACKED, path, np.uint32)
    sh, rest = elements.get("sh"), []
    if sh is not None:
        if len(sh) != len(vertex):
            raise input_error(path, f"element 'sh' has {len(sh)} rows, not {len(vertex)}")
        rest = _rest_names(sh, path)
        _check(sh, rest, path, np.uint8)

    def convert(rows: slice) -> Scene:  # of whole chunks
        bounds = np.zeros((-(-(rows.stop - rows.start) // CHUNK), len(_BOUNDS)), "<f4")
        bounds[:, 15:] = 1
        some = chunk[rows.start // CHUNK :][: len(bounds)]
        bounds[:, : len(names)] = _columns(some, names)
        data = _unpacked(bounds, _columns(vertex[rows], _PACKED, np.uint32), path)
        codes = _columns(sh[rows], rest, np.uint8) if rest else None
        higher = _channel_last(SH_VALUE[codes]) if rest else None
        opacity = file.sigmoid(data.opacities)
        arrays = data.means, data.scales, data.quats, opacity, data.sh0, higher
        return file.stored_scene(path, *arrays)

    scene = file.in_batches(len(vertex), convert)
    return replace(scene, notes=ply_marks.unused(vertex.dtype.names, _PACKED))


def _unpacked(bounds: np.ndarray, packed: np.ndarray, path: str | os.PathLike):
    """Decode chunks by gsply: bounds [C, 18] and codes [N, 4], in the one layout that it reads."""
    import gsply  # imports numba, which takes a third of a second

    elements = {"chunk": (len(bounds), "float", _BOUNDS), "vertex": (len(packed), "uint", _PACKED)}
    layout = ply_file.header(elements) + bounds.tobytes() + packed.astype("<u4").tobytes()
    with file.reading(path):
        return gsply.decompress_from_bytes(layout)


def header(count: int, degree: int, comments: Iterable[str] = ()) -> tuple[bytes, int]:
    """The header of a PLY of the original 3DGS, and the number of its float32 columns."""
    rest = [f"f_rest_{k}" for k in range(3 * (sh_count(degree) - 1))]
    names = [*_PLACE, "nx", "ny", "nz", *_DC, *rest, "opacity", *_SCALE, *_ROTATION]
    return ply_file.header({"vertex": (count, "float", names)}, comments), len(names)


def write_ply(path: str | os.PathLike, scene: Scene) -> None:
    """Write a scene in the original layout of 3DGS: binary, little-endian, float32, zero normals.

    An antialiased scene gets the comment `ply_marks.COMMENT`.
    """
    start, _ = header(len(scene), scene.sh_degree, [ply_marks.COMMENT] * scene.antialiased)
    with file.reading(path, "cannot be written"), open(path, "wb") as opened:
        opened.write(start)
        for rows in batches(len(scene)):
            opened.write(_rows(scene[rows]))


def _rows(scene: Scene) -> np.ndarray:
    """The rows of a PLY's table, float32 [N, columns]."""
    log_scale, logit = _stored(scene)
    rest = scene.sh[:, 1:].transpose(0, 2, 1).reshape(len(scene), -1)  # channel-major
    normals, logit = np.zeros((len(scene), 3)), logit[:, None]
    parts = scene.position, normals, scene.sh[:, 0], rest, logit, log_scale, scene.quaternion
    with np.errstate(over="ignore"):
        return np.hstack(parts).astype("<f4")


def _stored(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The finite logarithms [N, 3] of a scene's scales, and logits [N] of its opacities."""
    opacity = np.clip(scene.opacity, OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    return log_scales(scene), np.log(opacity / (1 - opacity))


def log_scales(scene: Scene) -> np.ndarray:
    """The logarithms [N, 3] of a scene's scales, of at least `SCALE_MIN`."""
    return np.log(np.maximum(scene.scale, SCALE_MIN))


def write_compressed_ply(path: str | os.PathLike, scene: Scene) -> None:
    """Write a scene of finite numbers as a compressed PLY, in its order.

    256 neighbours share bounds, so the error grows with the distance between them. An antialiased
    scene gets the comment `ply_marks.COMMENT`, as in splat-transform's files.
    """
    import gsply  # imports numba, which takes a third of a second

    log_scale, logit = _stored(scene)
    span = np.ptp(scene.position, axis=0).max()
    if span > np.finfo(np.float32).max:
        raise input_error(path, f"positions {span:g} apart are too far for a compressed PLY")
    arrays = scene.position, log_scale, scene.quaternion, logit, scene.sh[:, 0]
    with file.reading(path, "cannot be written"):
        arrays = (np.ascontiguousarray(each, np.float32) for each in arrays)
        _, bounds, packed, _ = gsply.compress_to_arrays(*arrays)
    higher = np.asarray(scene.sh[:, 1:], np.float64)
    rest = higher.transpose(0, 2, 1).reshape(len(scene), -1)  # channel-major
    elements = {
        "chunk": (len(bounds), "float", _BOUNDS),
        "vertex": (len(packed), "uint", _PACKED),
    }
    if rest.size:
        elements["sh"] = (len(rest), "uchar", [f"f_rest_{k}" for k in range(rest.shape[1])])
    start = ply_file.header(elements, [ply_marks.COMMENT] * scene.antialiased)
    with file.reading(path, "cannot be written"), open(path, "wb") as opened:
        opened.write(start + bounds.astype("<f4").tobytes() + packed.astype("<u4").tobytes())
        opened.write(np.clip(np.floor((rest + 4) * 32), 0, 255).astype(np.uint8).tobytes())
