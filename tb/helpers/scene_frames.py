"""Frames of scenes, as binning sees them."""

from functools import cache

from splatcore.golden.bin import splat_codes
from splatcore.golden.points import project_points
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.config import DEFAULT
from tb.helpers.bin_frames import Frame
from tb.helpers.scenes import scene_path

COUNT = 30_000
"""About as many Gaussians of each real scene are taken, evenly."""

SCENES = {"flowers.spz": "flowers", "skull.sog": "skull", "kitchen.spz": "kitchen"}


@cache
def scene_frame(name: str, count: int | None = COUNT) -> tuple:
    """A scene's frame with about `count` Gaussians (None: all), model, camera and their points."""
    if name in SCENES:
        scene = read_scene(scene_path(name))
        camera = read_camera(f"{scene_path(SCENES[name] + '.cameras.json')}:0")
    else:
        scene, camera = generate(name), generated_camera(name)
    model, _ = pack(scene[:: max(1, len(scene) // count) if count else 1], sh_degree=1)
    points = project_points(DEFAULT, model, camera)
    codes = splat_codes(DEFAULT, points.projected)
    return Frame(codes, camera.width, camera.height), model, camera, points
