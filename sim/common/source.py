"""Scenes, models and cameras: the arguments SCENE, --camera, --size and --engine, the folder of
scenes, and views of a scene by the cameras beside its file."""

import os
import re
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from splatcore.model.cameras.view import sensible_view
from splatcore.model.formats.camera_file import read_camera, read_cameras, split_id
from splatcore.model.formats.model_file import is_packed, read_model
from splatcore.model.formats.read import check_axes, find_format, read_scene
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.common import notes
from splatcore.sim.common.reading import ANTIALIASED, AS_STATED, Reading
from splatcore.sim.common.size import pictured, shape_of
from splatcore.sim.common.unseen import axes_note, near_note
from splatcore.spec.binning import fits, groups_max
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

ENGINES = ("reference", "golden", "rtl")
"""Float64 reference, bit-accurate golden model, simulated hardware."""

VIEW_SIZE = (1920, 1080)  # pixels of a view that no camera file defines

VARIABLE, FOLDER = "SPLATCORE_SCENES", "../shared/scenes"
"""The environment's variable that names the folder of scenes, and the folder without it."""

SUFFIXES = (".ply", ".spz", ".splat", ".sog")  # files of that folder that are scenes

CAMERAS, IN_FOLDER = ".cameras.json", "cameras.json"
"""Ends of the files of cameras beside scene files; the one in a folder that is a scene."""


@dataclass(frozen=True, eq=False)
class Source:
    """A scene file, a packed model or a generated scene; exactly one of the first two is set.

    reading: the options it was read with, which the scene has already. notes: lines on what is odd
    in it, and in what cameras see of it.
    """

    name: str
    scene: Scene | None = None
    model: PackedModel | None = None
    camera: Camera | None = None  # a generated scene's own, the first of a folder's
    packed: dict = field(default_factory=dict)  # for `sim.packing`
    reading: Reading = AS_STATED
    notes: list[str] = field(default_factory=list)

    def note(self, line: str):
        """Add a note, and print it once."""
        if line and line not in self.notes:
            self.notes.append(line)
            notes.tell(f"{self.name}: {line}")

    def seen_by(self, *cameras: Camera):
        """Note cameras that show little, as if the file's axes were others, and what only a smaller
        near plane shows."""
        if self.scene:
            self.note(axes_note(self.scene, cameras))
        self.note(near_note(self, cameras))

    @property
    def unpacked(self) -> Scene:
        """The scene; InputError for a packed model."""
        if self.scene is None:
            raise InputError(f"{self.name}: is a packed model already, not a scene")
        return self.scene

    @cached_property
    def gaussians(self) -> Gaussians:
        """The Gaussians that a renderer draws."""
        return (self.model if self.scene is None else self.scene).gaussians()

    @property
    def stated(self) -> dict[str, bool | str | list[str] | float]:
        """Whether opacities are compensated, what says so, notes, and the near plane, as `--json`
        writes them."""
        if self.scene is None:
            antialiased, by = self.model.antialiased, "model's header"
        else:
            antialiased, by = self.scene.antialiased, self.scene.mark or "not stated"
        found = {"antialiased": antialiased, "antialiased_by": by, "notes": list(self.notes)}
        return found | {"near": self.reading.near_plane}


def open_source(text: str, reading: Reading = AS_STATED) -> Source:
    """The scene or model that a file (or the name of a generated scene) holds; its notes are told.

    InputError for options of `reading` that do not go with it.
    """
    if text in GENERATORS and not os.path.exists(text):
        check_source(text, reading)
        source = Source(text, scene=generate(text), camera=generated_camera(text))
    elif os.path.isdir(text):
        beside = camera_beside(text)
        scene = read_scene(text, reading.axes)
        source = Source(text, scene, camera=read_camera(beside) if beside else None)
    elif is_packed(text):
        reading.check_unpacked(text)
        source = Source(text, model=read_model(text))
    else:
        source = Source(text, scene=read_scene(text, reading.axes))
    for line in source.scene.notes if source.scene else ():
        source.note(line)
    if (mark := reading.antialiased) is None:
        return replace(source, reading=reading)
    scene = replace(source.scene, antialiased=mark, mark=ANTIALIASED[mark])
    return replace(source, scene=scene, reading=reading)


def check_source(text: str, reading: Reading = AS_STATED):
    """InputError for what `open_source` cannot open; the file's end is not looked at."""
    if text in GENERATORS and not os.path.exists(text):
        if reading.axes:
            raise InputError(f"--axes {reading.axes}: {text} is generated, in axes of its own")
    elif os.path.isdir(text) or not is_packed(text):
        find_format(text)
        check_axes(text, reading.axes)
    else:
        reading.check_unpacked(text)


def open_camera(text: str | None, size: str | None, source: Source) -> Camera:
    """The camera of `own_camera`, with the pixels of its picture."""
    camera = own_camera(text, size, source)
    return pictured([camera], size, split_id(text)[0] if text else source.name)[0]


def own_camera(text: str | None, size: str | None, source: Source) -> Camera:
    """The camera of FILE[:ID], else the scene's own, both of any size, else a sensible view."""
    shape = shape_of(size)
    if text:
        camera = read_camera(text, shape)
    else:
        camera = source.camera or sensible_view(source.gaussians, *(shape or VIEW_SIZE))
    return source.reading.seen([camera])[0]


def open_cameras(
    camera: str | None, cameras: str | None, size: str | None, source: Source
) -> list[Camera]:
    """The camera of --camera, else those of --cameras as `open_path` has them; resized."""
    check_one(camera, cameras)
    if cameras:
        found = source.reading.seen(open_path(cameras, size, source.name))
    else:
        found = [open_camera(camera, size, source)]
    source.seen_by(*found)
    return found


def check_one(camera: str | None, cameras: str | None):
    """InputError if both options are given."""
    if camera and cameras:
        raise InputError("--camera and --cameras: one of them, not both")


def open_path(cameras: str, size: str | None, scene: str) -> list[Camera]:
    """All cameras of FILE, those of FILE:ID,ID,…, or those of ID,ID,… in the file beside a scene;
    resized."""
    (path, ids), shape = split_id(cameras), shape_of(size)
    if os.path.exists(path):
        found = read_cameras(path, _ids(ids) if ids else None, shape)
    elif path := camera_beside(scene):
        try:
            found = read_cameras(path, _ids(cameras), shape)
        except InputError as error:
            raise InputError(f"--cameras {cameras}: no such file; {error}") from None
    else:
        raise InputError(f"--cameras {cameras}: no such file; {scene} has none of cameras beside")
    return pictured(found, size, path)


def _ids(text: str) -> list[str]:
    return [one.strip() for one in text.split(",")]


def check_fits(config: Config, width: int, height: int):
    """InputError for a picture that is too large for a machine."""
    if not fits(config, width, height):
        side = TILE * config.group
        most = f"{groups_max(config)} squares of {side}x{side}"
        raise InputError(
            f"picture of {width}x{height}: preset {config.name} renders up to {config.width_max}x"
            f"{config.height_max}, or {most} of any shape, {config.side_max} a side (see --size)"
        )


def check_known(option: str, known: Collection[str], *names: str):
    """InputError for the first of an option's names that is not known."""
    for name in names:
        if name not in known:
            raise InputError(f"{option} '{name}': unknown (there are {', '.join(known)})")


def scene_folder() -> Path:
    """The folder of scenes; it need not be there."""
    return Path(os.environ.get(VARIABLE, FOLDER))


def scene_files(folder: Path | None = None) -> list[Path]:
    """The scenes of a folder, of the usual one without; InputError if there is no such folder."""
    folder = scene_folder() if folder is None else folder
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; name a SCENE or set {VARIABLE}")
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def camera_beside(source: str | Path) -> str | None:
    """The file of cameras of a scene file: the longest NAME.cameras.json whose NAME begins its.

    NAME ends where the file's own does or before a character that is no letter and no digit:
    leica-sofort.cameras.json goes with leica-sofort-top8192.ply. Of a folder as INRIA's training
    leaves it: cameras.json in it.
    """
    source = Path(source)
    if source.is_dir():
        return str(source / IN_FOLDER) if (source / IN_FOLDER).is_file() else None
    if source.suffix.lower() not in SUFFIXES:
        return None
    for end in range(len(source.name), 0, -1):
        path = source.with_name(source.name[:end] + CAMERAS)
        if re.match(r"\W|_", source.name[end:]) and path.is_file():
            return str(path)
    return None


@dataclass(frozen=True)
class View:
    """A scene seen by one of its cameras.

    scene: a file or the name of a generated scene. camera: an ID in the file of cameras beside it;
    "": the first one there, else a sensible view. size: WxH; None: the camera's own. file: cameras
    as --camera takes them, instead of those beside. quality: how the scene is packed; None: as
    small as is good enough. reading: how the scene is read.
    """

    scene: str
    camera: str = ""
    size: str | None = None
    file: str | None = None
    quality: str | None = None
    reading: Reading = AS_STATED

    @property
    def name(self) -> str:
        """Stands for all that decides on the picture but the size: results are kept by it."""
        name = Path(self.scene).name + (f":{self.camera}" if self.camera else "")
        words = name, self.quality, *self.reading.options
        return " ".join(word for word in words if word)

    @cached_property
    def camera_text(self) -> str | None:
        """The --camera that it stands for."""
        beside = self.file or camera_beside(self.scene)
        if self.camera and beside is None:
            raise InputError(f"--cameras {self.camera}: {self.scene} has no file of cameras")
        return f"{beside}:{self.camera}" if self.camera else beside

    def camera_of(self, source: Source) -> Camera:
        """Its camera, in pixels of its size."""
        camera = open_camera(self.camera_text, self.size, source)
        source.seen_by(camera)
        return camera

    def open(self) -> tuple[Source, Camera]:
        """The scene and its camera."""
        source = open_source(self.scene, self.reading)
        return source, self.camera_of(source)
