"""The folder of scenes, the cameras beside a scene file, and a view: a scene by a camera."""

import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from splatcore.sim.common.source import Source, open_camera, open_source
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError

VARIABLE, FOLDER = "SPLATCORE_SCENES", "../shared/scenes"
"""The environment's variable that names the folder of scenes, and the folder without it."""

SUFFIXES = (".ply", ".spz", ".splat", ".sog")  # files of that folder that are scenes

CAMERAS = ".cameras.json"


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
    leica-sofort.cameras.json goes with leica-sofort-top8192.ply.
    """
    source = Path(source)
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
    as --camera takes them, instead of those beside.
    """

    scene: str
    camera: str = ""
    size: str | None = None
    file: str | None = None

    @property
    def name(self) -> str:
        return Path(self.scene).name + (f":{self.camera}" if self.camera else "")

    @cached_property
    def camera_text(self) -> str | None:
        """The --camera that it stands for."""
        beside = self.file or camera_beside(self.scene)
        if self.camera and beside is None:
            raise InputError(f"--cameras {self.camera}: {self.scene} has no file of cameras")
        return f"{beside}:{self.camera}" if self.camera else beside

    def camera_of(self, source: Source) -> Camera:
        """Its camera, in pixels of its size."""
        return open_camera(self.camera_text, self.size, source)

    def open(self) -> tuple[Source, Camera]:
        """The scene and its camera."""
        source = open_source(self.scene)
        return source, self.camera_of(source)
