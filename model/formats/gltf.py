"""Gaussians in glTF 2.0: GLB and .gltf. Sources: Khronos, "KHR_gaussian_splatting" and
"KHR_gaussian_splatting_compression_spz_2" (github.com/KhronosGroup/glTF).

glTF has y up: left, up, front. The axes of PLY are half a turn about z away, so harmonics of odd
order m change their sign; PlayCanvas' splat-transform writes GLB in this way.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from splatcore.model.formats import file, spz
from splatcore.model.formats.file import input_error
from splatcore.model.formats.gltf_file import Accessor, Gltf, open_gltf
from splatcore.model.formats.placed import merged, placed
from splatcore.model.formats.spz_axes import turned
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.scene import ARRAYS, Scene, sh_count, without_zero

GLTF_AXES = "LUF"
"""The axes of glTF: left, up, front."""

EXTENSION = "KHR_gaussian_splatting"

SPZ_EXTENSIONS = (
    "KHR_gaussian_splatting_compression_spz_2",
    "KHR_gaussian_splatting_compression_spz",
)
"""Extensions inside `EXTENSION` that hold an SPZ file in a buffer view."""

REQUIRED = (EXTENSION, *SPZ_EXTENSIONS, "KHR_mesh_quantization")
"""Extensions that a file may require."""

LOOKS_ONLY = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
"""Beginnings of required extensions that do not concern Gaussians."""

VALUES = {
    "kernel": "ellipse",
    "colorSpace": "srgb_rec709_display",
    "projection": "perspective",
}
"""Properties of `EXTENSION` and the only value that we render; others are noted."""

MARK = {"SplatRenderMode": "mip"}
"""`extras` of a primitive that we write for an antialiased scene, after Brush's comment in PLY.
glTF itself has no mark."""

COPIES_MAX = 1 << 30
"""Largest accepted size, in bytes as float32, of Gaussians that a file shows beyond those that it
holds: by nodes that repeat a mesh, or by primitives that share accessors or buffer views."""

LOGARITHMS = 0.01
"""Share of negative scales from which on they are logarithms, as in drafts of the extension and in
files of splat-transform before July 2026; fewer are faulty."""


def read(path: str | os.PathLike, axes: str | None = None) -> Scene:
    """Read all Gaussians of the scene that a GLB or glTF file shows, in the axes of PLY.

    axes: of SPZ inside the file that does not state them; see `spz.read`
    """
    gltf = open_gltf(path)
    for name in file.field(gltf.tree, "extensionsRequired", list, path, []):
        name = file.checked(name, str, f"{path}: 'extensionsRequired'")
        if name not in REQUIRED and not name.startswith(LOOKS_ONLY):
            raise input_error(path, f"requires {name[:60]}, which is not supported")
    parts, others, room = [], 0, Room(gltf, axes)
    for mesh, matrix, node in gltf.placements():
        for primitive, where in _primitives(gltf, mesh):
            found = _extension(primitive, where)
            if found is None:
                others += 1
                continue
            view = _spz_view(found, where)

            def settled(part: Scene, matrix: np.ndarray = matrix, node: str = node) -> Scene:
                """Place a part in glTF's axes in the scene, in the axes of PLY."""
                return half_turn(placed(part, matrix, node), -1)

            if view is None:
                part = _plain(room, primitive, where, settled)
            else:
                part = settled(half_turn(room.unpack(view, where), 1))
            parts.append(_marked(replace(part, notes=part.notes + _values(found)), primitive))
    if not parts:
        raise input_error(path, f"holds no primitive with {EXTENSION}")
    if axes and not room.unpacked:
        raise input_error(path, f"--axes {axes}: the file holds no SPZ; the axes of glTF are known")
    scene = merged(parts)
    notes = (*gltf.notes, *scene.notes, "turned from glTF's axes, y up, by half a turn about z")
    if others:
        s = "s" * (others > 1)
        notes += (f"{others} primitive{s} without {EXTENSION} not read",)
    return replace(scene, name=os.fspath(path), notes=notes)


@dataclass
class Room:
    """The Gaussians that a file shows: hardly more than it holds are accepted."""

    gltf: Gltf
    axes: str | None  # of SPZ that does not state them
    shown: int = 0  # bytes as float32
    unpacked: dict[memoryview, Scene] = field(default_factory=dict)  # by the SPZ's bytes

    def unpack(self, view: int, where: str) -> Scene:
        """The Gaussians of an SPZ file in a buffer view, in the axes of PLY.

        The extension says that unpacking turns from the SPZ's axes to glTF's. CesiumJS 1.146 does
        not turn: `--axes luf` reads as it does.
        """
        data, _, _ = self.gltf.view(view)
        if data not in self.unpacked:
            with file.copied(data, ".spz", f"{where}: SPZ") as copy:
                self.unpacked[data] = spz.read(copy, self.axes)
        scene = self.unpacked[data]
        self.take(len(scene), scene.sh.shape[1])
        return scene

    def take(self, count: int, coefficients: int) -> None:
        """Count Gaussians before they take memory; raises InputError if too many are repeated."""
        self.shown += _bytes(count, coefficients)
        held = 4 * self.gltf.held  # integers of one byte become float32
        held += sum(_bytes(len(each), each.sh.shape[1]) for each in self.unpacked.values())
        if self.shown > held + COPIES_MAX:
            fault = f"shows {self.shown} bytes of Gaussians and holds at most {held}; repetitions"
            raise input_error(self.gltf.path, f"{fault} may add {COPIES_MAX}")


def _bytes(count: int, coefficients: int) -> int:
    """Size of Gaussians as float32."""
    return 4 * count * (11 + 3 * coefficients)


def half_turn(scene: Scene, sign: int) -> Scene:
    """Turn a scene about z: from the axes of PLY to glTF's (sign 1), or back (−1).

    Quaternions are multiplied by that of the half turn and so come back with their own signs.
    """
    turn = turned(scene, GLTF_AXES)
    w, x, y, z = without_zero(scene.quaternion).T
    return replace(turn, quaternion=sign * np.stack([-z, -y, x, w], axis=1))


def _primitives(gltf: Gltf, mesh: int) -> Iterator[tuple[dict, str]]:
    """The primitives of a mesh, and their locations for messages."""
    table, where = gltf.item("meshes", mesh)
    for index, primitive in enumerate(file.field(table, "primitives", list, where)):
        place = f"{where}.primitives[{index}]"
        yield file.checked(primitive, dict, place), place


def _extension(primitive: dict, where: str) -> dict | None:
    """The content of `EXTENSION`, if the primitive has it."""
    table = file.field(primitive, "extensions", dict, where, {})
    return file.field(table, EXTENSION, dict, where) if EXTENSION in table else None


def _spz_view(extension: dict, where: str) -> int | None:
    """The buffer view with an SPZ file, if the Gaussians are compressed."""
    inner = file.field(extension, "extensions", dict, where, {})
    for name in SPZ_EXTENSIONS:
        if name in inner:
            place = f"{where}: {name}"
            return file.field(file.field(inner, name, dict, where), "bufferView", int, place)
    return None


def _plain(room: Room, primitive: dict, where: str, settled: Callable[[Scene], Scene]) -> Scene:
    """The Gaussians of a primitive's accessors.

    settled: places a batch of them, as stored, in the scene
    """
    attributes = file.field(primitive, "attributes", dict, where)
    if "indices" in primitive:
        raise input_error(where, "'indices' of Gaussians are not supported")

    def values(name: str, columns: int, count: int | None = None) -> Accessor:
        name = name if name == "POSITION" else f"{EXTENSION}:{name}"
        place = f"{where}: {name}"
        found = room.gltf.accessor(file.field(attributes, name, int, where))
        held, per = found.stored.shape
        if per != columns:
            raise input_error(place, f"has {per} components, not {columns}")
        if count not in (None, held):
            raise input_error(place, f"has {held} elements, not {count}")
        return found

    position = values("POSITION", 3)
    count = len(position.stored)
    stated = [d for d in range(1, SH_DEGREE_MAX + 1) if _prefix(d, attributes)]
    room.take(count, sh_count(max(stated, default=0)))
    quaternion, scale = values("ROTATION", 4, count), values("SCALE", 3, count)
    opacity = values("OPACITY", 1, count)
    logarithms = (scale.stored < 0).any(axis=1).sum() > LOGARITHMS * count
    coefficients = [
        values(f"SH_DEGREE_{degree}_COEF_{k}", 3, count)
        for degree in range(max(stated, default=0) + 1)
        for k in range(2 * degree + 1)
    ]

    def convert(rows: slice) -> Scene:
        size = scale.numbers(rows).astype(np.float64)
        sh = np.stack([each.numbers(rows) for each in coefficients], axis=1)
        turn = quaternion.numbers(rows)[:, [3, 0, 1, 2]]
        arrays = np.exp(size) if logarithms else size, turn, opacity.numbers(rows)[:, 0], sh
        return settled(Scene(position.numbers(rows), *arrays, os.fspath(room.gltf.path)))

    notes: tuple[str, ...] = ()
    if logarithms:
        notes = ("scales below 0: read as logarithms, as drafts of glTF had them",)
    if _prefix(SH_DEGREE_MAX + 1, attributes):
        notes += (f"harmonics of degree {SH_DEGREE_MAX + 1} are not used",)
    whole = file.in_batches(count, convert)
    arrays = (getattr(whole, name) for name in ARRAYS)
    return file.linear_scene(room.gltf.path, *arrays, notes)


def _prefix(degree: int, attributes: dict) -> bool:
    """Whether a primitive has harmonics of this degree."""
    return any(name.startswith(f"{EXTENSION}:SH_DEGREE_{degree}_COEF_") for name in attributes)


def _values(extension: dict) -> tuple[str, ...]:
    """Notes on properties that we do not render as stated."""
    return tuple(
        f"{name} {str(extension[name])[:40]!r} is rendered as {value!r}"
        for name, value in VALUES.items()
        if extension.get(name, value) != value
    )


def _marked(scene: Scene, primitive: dict) -> Scene:
    """The scene with our own mark of an antialiased one, if the primitive has it."""
    extras = primitive.get("extras")
    if isinstance(extras, dict) and MARK.items() <= extras.items():
        return replace(scene, antialiased=True, mark="glTF extras 'SplatRenderMode: mip'")
    return scene
