"""The arguments SCENE, --camera, --size and --engine: scenes, models and cameras."""

import os
import re
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property

from splatcore.model.cameras.view import sensible_view
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.model.pack.pack import largest_factor, pack
from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import model_format
from splatcore.spec.packed import PackedModel, is_packed, read_model
from splatcore.spec.scene import Gaussians, Scene

ENGINES = ("reference", "golden", "rtl")
"""Float64 reference, bit-accurate golden model, simulated hardware."""

VIEW_SIZE = (1920, 1080)  # pixels of a view that no camera file defines


@dataclass(frozen=True, eq=False)
class Source:
    """A scene file, a packed model or a generated scene; exactly one of the first two is set."""

    name: str
    scene: Scene | None = None
    model: PackedModel | None = None
    camera: Camera | None = None  # a generated scene's own
    packed: dict[tuple, PackedModel] = field(default_factory=dict)  # for `packed_model`

    @cached_property
    def gaussians(self) -> Gaussians:
        """The Gaussians that a renderer draws."""
        return (self.model if self.scene is None else self.scene).gaussians()


def open_source(text: str) -> Source:
    """The scene or model that a file (or the name of a generated scene) holds."""
    if text in GENERATORS and not os.path.exists(text):
        return Source(text, scene=generate(text), camera=generated_camera(text))
    if is_packed(text):
        return Source(text, model=read_model(text))
    return Source(text, scene=read_scene(text))


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


def packed_model(source: Source, config: Config) -> PackedModel:
    """The model that a machine renders, kept; a scene is packed for it. It may be empty."""
    if source.model is not None:
        return source.model
    degree = min(source.scene.sh_degree, config.sh_degree)
    packing = model_format(config, degree), largest_factor(config.arithmetic)
    if packing not in source.packed:
        source.packed[packing] = pack(source.scene, config)[0]
    return source.packed[packing]


def check_known(option: str, known: Collection[str], *names: str):
    """InputError for the first of an option's names that is not known."""
    for name in names:
        if name not in known:
            raise InputError(f"{option} '{name}': unknown (there are {', '.join(known)})")
