"""Scenes, models and cameras: the arguments SCENE, --camera, --cameras and --size, and the folder
of scenes."""

import os
import re
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatcore.model.cameras.view import sensible_view
from splatcore.model.formats import sog_files, sog_stream
from splatcore.model.formats.camera_file import read_camera, read_cameras, split_id
from splatcore.model.formats.model_file import is_packed, read_model
from splatcore.model.formats.read import check_choices, find_format, read_scene
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.common import notes
from splatcore.sim.frame.reading import ANTIALIASED, AS_STATED, Reading
from splatcore.sim.frame.size import pictured, shape_of
from splatcore.sim.frame.unseen import axes_note, near_note
from splatcore.spec.binning import fits, groups_max
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError
from splatcore.spec.need import check_need
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

if TYPE_CHECKING:
    from splatcore.sim.frame.choose import Packed

VIEW_SIZE = (1920, 1080)  # pixels of a view that no camera file defines

VARIABLE, FOLDER = "SPLATCORE_SCENES", "../shared/scenes"
"""The environment variable that names the folder of scenes, and its default."""

SUFFIXES = tuple(".ply .ply.gz .spz .splat .ksplat .sog .glb .gltf .usd .usda .usdc .usdz".split())
"""Suffixes of scene files in that folder."""

CAMERAS, IN_FOLDER = ".cameras.json", "cameras.json"
"""Suffix of a camera file next to a scene file; name of the camera file in a scene's folder."""


@dataclass(frozen=True, eq=False)
class Source:
    """An opened scene or packed model: exactly one of `scene` and `model` is set.

    name: its file, or the name of a generated scene
    camera: own camera of a generated scene, or the first in a scene's folder
    reading: the options it was read with, already applied to the scene
    notes: lines on unusual contents, and on views that show little
    packings: the scene's packed models, which `Shot.packed` makes
    """

    name: str
    scene: Scene | None = None
    model: PackedModel | None = None
    camera: Camera | None = None
    reading: Reading = AS_STATED
    notes: list[str] = field(default_factory=list)
    packings: dict[tuple, "Packed"] = field(default_factory=dict, init=False)

    def note(self, line: str):
        """Add a note, and print it once."""
        if line and line not in self.notes:
            self.notes.append(line)
            notes.add(f"{self.name}: {line}")

    def seen_by(self, *cameras: Camera):
        """Add notes on cameras that see little, as with wrong axes, and on Gaussians that only a
        smaller near plane would show."""
        if self.scene:
            self.note(axes_note(self.scene, cameras))
        self.note(near_note(self, cameras))

    @property
    def unpacked(self) -> Scene:
        """The scene; raises InputError for a packed model."""
        if self.scene is None:
            raise InputError(f"{self.name}: is a packed model already, not a scene")
        return self.scene

    @property
    def drawn(self) -> Scene | PackedModel:
        """The scene or model, which the reference decodes batch by batch."""
        return self.model if self.scene is None else self.scene

    def check_need(self, work: str, drawn: Scene | PackedModel):
        """Raise InputError if the memory for some work on a scene or model is not available.

        work: a key of `spec.need.NEEDS`
        """
        degree = drawn.sh_degree if isinstance(drawn, Scene) else drawn.format.sh_degree
        check_need(work, len(drawn), degree, self.name)

    @cached_property
    def gaussians(self) -> Gaussians:
        """The Gaussians that a renderer draws."""
        return self.drawn.gaussians()

    @property
    def position(self) -> np.ndarray:
        """Centres of the Gaussians, [N, 3]."""
        return self.drawn.position

    @property
    def stated(self) -> dict[str, bool | str | list[str] | float]:
        """Facts for `--json`: opacity compensation and its reason, notes, and the near plane."""
        if self.scene is None:
            antialiased, by = self.model.antialiased, "model's header"
        else:
            antialiased, by = self.scene.antialiased, self.scene.mark or "not stated"
        found = {"antialiased": antialiased, "antialiased_by": by, "notes": list(self.notes)}
        return found | {"near": self.reading.near_plane}


def open_source(text: str, reading: Reading = AS_STATED) -> Source:
    """Open a scene or model by its file, folder or generated name, and print its notes.

    Raises InputError for options of `reading` that do not apply to it.
    """
    if text in GENERATORS and not os.path.exists(text):
        check_source(text, reading)
        source = Source(text, scene=generate(text), camera=generated_camera(text))
    elif os.path.isdir(text):
        cameras = camera_beside(text)
        scene = read_scene(text, reading.axes, reading.lod)
        source = Source(text, scene, camera=read_camera(cameras) if cameras else None)
    elif is_packed(text):
        reading.check_unpacked(text)
        source = Source(text, model=read_model(text))
    else:
        check_named(text)
        source = Source(text, scene=read_scene(text, reading.axes, reading.lod))
    for line in source.scene.notes if source.scene else ():
        source.note(line)
    if (mark := reading.antialiased) is None:
        return replace(source, reading=reading)
    scene = replace(source.scene, antialiased=mark, mark=ANTIALIASED[mark])
    return replace(source, scene=scene, reading=reading)


@lru_cache(maxsize=1)
def opened(text: str, reading: Reading = AS_STATED) -> Source:
    """Open a source for a task; the process keeps the last one open."""
    return open_source(text, reading)


def check_source(text: str, reading: Reading = AS_STATED):
    """Raise InputError for a file that `open_source` cannot open, judged by its beginning."""
    if text in GENERATORS and not os.path.exists(text):
        if reading.axes:
            raise InputError(f"--axes {reading.axes}: {text} is generated, with axes of its own")
        if reading.lod is not None:
            raise InputError(f"--lod {reading.lod}: {text} is generated, without levels of detail")
    elif os.path.isdir(text) or not is_packed(text):
        check_named(text)
        find_format(text)
        check_choices(text, reading.axes, reading.lod)
    else:
        reading.check_unpacked(text)


def check_named(text: str):
    """Raise InputError for a mere word that names neither a file nor a generated scene."""
    if re.fullmatch(r"\w+", text) and not os.path.exists(text):
        why = "No such file or directory, and no generated scene has this name"
        raise InputError(f"{text}: {why}")


def open_camera(text: str | None, size: str | None, source: Source, resized: bool = True) -> Camera:
    """Return the camera of FILE[:ID], else the scene's own, else a generated view.

    resized: to --size; InputError if the picture is too large without it
    """
    shape = shape_of(size)
    if text:
        camera = read_camera(text, shape)
    else:
        camera = source.camera or sensible_view(source.drawn, *(shape or VIEW_SIZE))
    [camera] = source.reading.seen([camera])
    if not resized:
        return camera
    return pictured([camera], size, split_id(text)[0] if text else source.name)[0]


def open_cameras(
    camera: str | None, cameras: str | None, size: str | None, source: Source
) -> list[Camera]:
    """Return the cameras of --cameras (see `open_path`), else the one of --camera; resized."""
    check_one(camera, cameras)
    if cameras:
        found = source.reading.seen(open_path(cameras, size, source.name))
    else:
        found = [open_camera(camera, size, source)]
    source.seen_by(*found)
    return found


def check_one(camera: str | None, cameras: str | None):
    """Raise InputError if both options are given."""
    if camera and cameras:
        raise InputError("use --camera or --cameras, not both")


def open_path(cameras: str, size: str | None, scene: str) -> list[Camera]:
    """Return cameras of FILE (all), FILE:ID,ID,… or ID,ID,… (of the camera file next to the scene),
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
        name = Path(scene).with_suffix(CAMERAS).name
        raise InputError(f"--cameras {cameras}: no such file, and {scene} has no {name} next to it")
    return pictured(found, size, path)


def _ids(text: str) -> list[str]:
    return [one.strip() for one in text.split(",")]


def check_fits(config: Config, width: int, height: int):
    """Raise InputError for a picture that is too large for a machine."""
    if not fits(config, width, height):
        side = TILE * config.group
        squares = f"{groups_max(config)} squares of {side}x{side}"
        raise InputError(
            f"picture of {width}x{height}: preset {config.name} renders up to {config.width_max}x"
            f"{config.height_max}, or any shape of at most {squares} and {config.side_max} pixels "
            "per side (see --size)"
        )


def scene_folder() -> Path:
    """Return the folder of scenes, which need not exist."""
    return Path(os.environ.get(VARIABLE, FOLDER))


def scene_files(folder: Path | None = None) -> list[Path]:
    """Return the scenes of a folder, by default the folder of scenes.

    Raises InputError if the folder does not exist.
    """
    folder = scene_folder() if folder is None else folder
    if not folder.is_dir():
        raise InputError(f"{folder}: folder does not exist; name a SCENE or set {VARIABLE}")
    return sorted(path for path in folder.iterdir() if path.name.lower().endswith(SUFFIXES))


def camera_beside(source: str | Path) -> str | None:
    """Return the camera file of a scene file: the longest NAME.cameras.json next to it.

    The scene's name must begin with NAME, up to a character that is neither letter nor digit:
    leica-sofort.cameras.json belongs to leica-sofort-top8192.ply. For a folder (an output of
    INRIA's training, a SOG) and for a SOG's JSON file: cameras.json in the folder.
    """
    source = Path(source)
    if source.name.lower() in (sog_files.META, sog_stream.META):
        source = source.parent
    if source.is_dir():
        return str(source / IN_FOLDER) if (source / IN_FOLDER).is_file() else None
    if not source.name.lower().endswith(SUFFIXES):
        return None
    for end in range(len(source.name), 0, -1):
        path = source.with_name(source.name[:end] + CAMERAS)
        if re.match(r"\W|_", source.name[end:]) and path.is_file():
            return str(path)
    return None
