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
from splatcore.model.formats.read import find_format, read_scene
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.common.output import messages
from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.config import Config
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


OPTIONS = {True: "--antialiased", False: "--no-antialiased"}
"""The option that overrides a scene's mark, by its value."""


@dataclass(frozen=True, eq=False)
class Source:
    """A scene file, a packed model or a generated scene; exactly one of the first two is set.

    override: the value of --antialiased, if it was given; the scene has it already.
    """

    name: str
    scene: Scene | None = None
    model: PackedModel | None = None
    camera: Camera | None = None  # a generated scene's own, the first of a folder's
    packed: dict = field(default_factory=dict)  # for `sim.packing`
    override: bool | None = None

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
    def antialiasing(self) -> dict[str, bool | str]:
        """Whether opacities are compensated, and what says so, as `--json` writes it."""
        if self.scene is None:
            return {"antialiased": self.model.antialiased, "antialiased_by": "model's header"}
        by = self.scene.mark or "not stated"
        return {"antialiased": self.scene.antialiased, "antialiased_by": by}


def open_source(text: str, antialiased: bool | None = None) -> Source:
    """The scene or model that a file (or the name of a generated scene) holds.

    antialiased: overrides the mark of a scene; None keeps it. InputError for one with a model.
    """
    if text in GENERATORS and not os.path.exists(text):
        source = Source(text, scene=generate(text), camera=generated_camera(text))
    elif os.path.isdir(text):
        beside = camera_beside(text)
        source = Source(text, read_scene(text), camera=read_camera(beside) if beside else None)
    elif is_packed(text):
        check_unpacked(text, antialiased)
        source = Source(text, model=read_model(text))
    else:
        source = Source(text, scene=read_scene(text))
    if antialiased is None:
        return source
    scene = replace(source.scene, antialiased=antialiased, mark=OPTIONS[antialiased])
    return replace(source, scene=scene, override=antialiased)


def check_unpacked(text: str, antialiased: bool | None):
    """InputError for an override of a packed model's mark."""
    if antialiased is not None:
        option = OPTIONS[antialiased]
        why = "a packed model has its own mark; repack the scene"
        raise InputError(f"{option}: {text}: {why}: splatcore pack SCENE {option} -o MODEL")


def check_source(text: str, antialiased: bool | None = None):
    """InputError for what `open_source` cannot open; the file's end is not looked at."""
    if text in GENERATORS and not os.path.exists(text):
        return
    if os.path.isdir(text) or not is_packed(text):
        find_format(text)
    else:
        check_unpacked(text, antialiased)


def open_camera(text: str | None, size: str | None, source: Source) -> Camera:
    """The camera of FILE[:ID], else the scene's own, else a sensible view of it; then resized."""
    width, height = parse_size(size) if size else VIEW_SIZE
    if text:
        camera = read_camera(text)
    elif source.camera:
        camera = source.camera
    else:
        return sensible_view(source.gaussians, width, height)
    return camera.resized(width, height) if size else camera


def open_cameras(
    camera: str | None, cameras: str | None, size: str | None, source: Source
) -> list[Camera]:
    """The camera of --camera, else those of --cameras as `open_path` has them; resized."""
    check_one(camera, cameras)
    if not cameras:
        return [open_camera(camera, size, source)]
    return open_path(cameras, size, source.name)


def check_one(camera: str | None, cameras: str | None):
    """InputError if both options are given."""
    if camera and cameras:
        raise InputError("--camera and --cameras: one of them, not both")


def open_path(cameras: str, size: str | None, scene: str) -> list[Camera]:
    """All cameras of FILE, those of FILE:ID,ID,…, or those of ID,ID,… in the file beside a scene;
    resized."""
    path, ids = split_id(cameras)
    if os.path.exists(path):
        found = read_cameras(path, _ids(ids) if ids else None)
    elif beside := camera_beside(scene):
        try:
            found = read_cameras(beside, _ids(cameras))
        except InputError as error:
            raise InputError(f"--cameras {cameras}: no such file; {error}") from None
    else:
        raise InputError(f"--cameras {cameras}: no such file; {scene} has none of cameras beside")
    shape = parse_size(size) if size else None
    return [one.resized(*shape) if shape else one for one in found]


def _ids(text: str) -> list[str]:
    return [one.strip() for one in text.split(",")]


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of "WxH", each 1 … SIZE_MAX."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text.strip())
    if not match:
        raise InputError(f"--size '{text}': is not WIDTHxHEIGHT, like 1920x1080")
    width, height = int(match[1]), int(match[2])
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= SIZE_MAX:
            raise InputError(f"--size {text}: {name} {side} is not in 1 … {SIZE_MAX}")
    return width, height


def note_unseen(name: str, camera: Camera, counts: dict):
    """Say on standard error that a picture shows nothing, if no Gaussian is counted in it: of the
    reference's "visible", of a machine's "splats"."""
    if not counts.get("visible", counts.get("splats")):
        where = f" {camera.name}" if camera.name else ""
        text = f"{name}: no Gaussian is visible from camera{where}"
        messages.print(text, markup=False, soft_wrap=True)


def check_fits(config: Config, width: int, height: int):
    """InputError for a picture that is too large for a machine."""
    if width > config.width_max or height > config.height_max:
        most = f"{config.width_max}x{config.height_max}"
        raise InputError(
            f"picture of {width}x{height}: preset {config.name} renders up to {most} (see --size)"
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
    small as is good enough. antialiased: overrides the scene's mark.
    """

    scene: str
    camera: str = ""
    size: str | None = None
    file: str | None = None
    quality: str | None = None
    antialiased: bool | None = None

    @property
    def name(self) -> str:
        """Stands for all that decides on the picture but the size: results are kept by it."""
        name = Path(self.scene).name + (f":{self.camera}" if self.camera else "")
        words = name, self.quality, OPTIONS.get(self.antialiased)
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
        return open_camera(self.camera_text, self.size, source)

    def open(self) -> tuple[Source, Camera]:
        """The scene and its camera."""
        source = open_source(self.scene, self.antialiased)
        return source, self.camera_of(source)
