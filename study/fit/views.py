"""Views that `splatcore fit` fits a machine to: a packed model and its cameras."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import Frame, render
from splatcore.golden.raster import rasterize
from splatcore.golden.reference import render as render_reference
from splatcore.sim.frame.metric import LEVELS
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, FORMATS, Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.renderable import check_renderable

OF_RASTER = [field for field, format in FORMATS.items() if not format.in_features]
"""Fields that change stage 3 only."""


@dataclass(eq=False)
class View:
    """A named view of a model.

    exact: the reference's picture [H, W, 3], float32, 0 … 1
    base: a machine and its golden frame; machines that differ in stage 3 only reuse its splats
    """

    name: str
    model: PackedModel
    camera: Camera
    exact: np.ndarray = field(init=False)
    base: tuple[Config, Frame] | None = None

    def __post_init__(self):
        image = render_reference(self.model.gaussians(), self.camera).image
        self.exact = image.clip(0, 1).astype(np.float32)  # float32 suffices for 8-bit pictures

    def resized(self, width: int, height: int) -> "View":
        """The view at another size, in pixels."""
        return View(self.name, self.model, self.camera.resized(width, height))

    def frame(self, config: Config) -> Frame:
        """The golden frame without the splats' codes, which the cycle model does not need."""
        found = render(config, self.model, self.camera)
        return replace(found, points=replace(found.points, codes={}))

    def pixels(self, config: Config) -> np.ndarray:
        """The golden model's picture [H, W, 3]."""
        if self.base is None:
            self.base = config, self.frame(config)
        known, frame = self.base
        stage_3 = {name: getattr(config, name) for name in OF_RASTER}
        if replace(known, **stage_3) != config:
            return render(config, self.model, self.camera).pixels
        size = self.camera.width, self.camera.height
        return rasterize(config, frame.binned.features, frame.sorted, size).pixels

    def square(self, pixels: np.ndarray) -> float:
        """Mean squared error of an 8-bit picture."""
        return float(np.mean((pixels / LEVELS - self.exact) ** 2))

    def largest(self, pixels: np.ndarray) -> float:
        """Largest error of an 8-bit picture, of 1.0."""
        return float(np.abs(pixels / LEVELS - self.exact).max(initial=0))


def start_config(name: str, model: PackedModel, cameras: list[Camera]) -> Config:
    """DEFAULT with the size of the largest picture and the model's degree of harmonics.

    Raises InputError for a model that is packed for another machine.
    """
    check_renderable(DEFAULT, model)
    sides = {"width": 0, "height": 0}
    for camera, side in product(cameras, sides):
        sides[side] = max(sides[side], getattr(camera, side))
    try:
        return replace(
            DEFAULT, name=name, sh_degree=model.format.sh_degree,
            width_max=sides["width"], height_max=sides["height"],
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"--size {sides['width']}x{sides['height']}: {error}") from None


def views_of(
    scene: str, model: PackedModel, cameras: list[Camera], progress: Callable[[int, int], None]
) -> list[View]:
    """Views of a model, named SCENE:CAMERA. progress: called with (done, total)."""
    views, scene = {}, Path(scene).name.split(".")[0]
    for number, camera in enumerate(cameras):
        progress(number, len(cameras))
        name = scene if camera.name == scene else f"{scene}:{camera.name}"
        name = name if name not in views else f"{name} ({number})"
        views[name] = View(name, model, camera)
    return list(views.values())
