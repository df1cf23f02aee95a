"""Packing, pictures, errors and cycles for Python programs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.golden import pipeline, reference
from splatcore.model.pack.pack import pack as packed
from splatcore.model.pack.quality import QUALITIES
from splatcore.model.pack.report import PackReport
from splatcore.sim.common.metric import LEVELS, Difference, difference
from splatcore.sim.common.source import check_fits
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.packing.choose import candidates, choose
from splatcore.sim.python import check
from splatcore.spec.camera import Camera
from splatcore.spec.colour import background_codes
from splatcore.spec.config import CLOCK_HZ, DEFAULT, Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

Colour = Sequence[float]


def pack(
    scene: Scene,
    quality: str | None = None,
    cameras: Sequence[Camera] = (),
    config: Config | str = DEFAULT,
) -> tuple[PackedModel, PackReport]:
    """A scene as the model that a machine reads, and a report on what that lost.

    quality: one of `QUALITIES`, at most 14, 22, 38 or 54 bytes a Gaussian. None: with
    cameras the smallest whose picture is 45 dB or more from the scene's in each of them, as the
    commands choose it; without cameras the best. The model has `bytes_per_gaussian`, its length is
    the number of Gaussians, `image` its bytes (uint8). The report counts Gaussians that were
    dropped (not_finite, transparent: opacity below 1/255) and has the largest errors. InputError
    for an unknown quality, and for a scene that the machine's formats cannot hold.
    """
    check.kind("scene", scene, Scene)
    config = check.machine(config)
    if quality is not None and quality not in QUALITIES:
        raise InputError(f"quality: {quality!r} is not one of {', '.join(QUALITIES)}")
    views = [check.view(each) for each in cameras]
    if quality is None and views:
        found = choose(scene, config, views)
        return found.model, found.report
    return packed(scene, config, quality=quality or candidates(scene, config)[-1])


def render_reference(
    scene: Scene | PackedModel, camera: Camera, background: Colour = (0, 0, 0)
) -> np.ndarray:
    """The float64 reference's picture of a scene or model, float64 [H, W, 3].

    RGB ≥ 0, where 1 is white; brighter is not clipped. background: RGB, each 0 … 1. Gaussians with
    NaN or Inf are left out. InputError names the argument that is wrong.
    """
    convention = replace(SPLATCORE, background=check.colour("background", background))
    return reference.render(check.shown(scene).gaussians(), check.view(camera), convention).image


def render_golden(
    model: PackedModel,
    camera: Camera,
    config: Config | str = DEFAULT,
    background: Colour = (0, 0, 0),
) -> np.ndarray:
    """The picture that a machine makes of a model, uint8 [H, W, 3], every bit of it.

    It is the golden model's, which the RTL equals bit for bit. background: RGB, each 0 … 1.
    InputError for a picture too large for the machine, and for a model packed for another one.
    """
    return _frame(model, camera, check.machine(config), background).pixels


def cycles(
    model: PackedModel, camera: Camera, config: Config | str = DEFAULT
) -> dict[str, int | float]:
    """Clock cycles of a picture by stage, by the cycle model: within 3 % of the RTL for each stage.

    Keys: chunk, cull, place, project, bin, sort, raster, each stage by itself; preprocessing and
    rendering, the halves that work at once, with memory's latency; frame, the slower of them; fps,
    frames a second at 800 MHz. The golden model renders the picture for it. Errors are those of
    `render_golden`.
    """
    config = check.machine(config)
    found = frame_cycles(config, _frame(model, camera, config, (0, 0, 0)))
    return found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)}


def compare(image: np.ndarray, truth: np.ndarray) -> Difference:
    """How far a picture [H, W, 3] is from another of the same size, both as 8-bit pictures.

    Each is uint8, or float with 1 for white, which is clipped and rounded to 8 bits first. The
    result has psnr_db (None for equal pictures), ssim (None below 11 pixels a side), max_error of
    one channel of one pixel (0 … 1), and identical. InputError for other shapes and for NaN.
    """
    one, other = pixels("image", image), pixels("truth", truth)
    if one.shape != other.shape:
        raise InputError(f"image: has shape {one.shape}, truth {other.shape}")
    return difference(one, other)


def pixels(name: str, picture: np.ndarray) -> np.ndarray:
    """A picture as uint8 [H, W, 3]; InputError, naming the argument, for anything else."""
    found = np.asarray(picture)
    if found.ndim != 3 or found.shape[2] != 3 or not found.size:
        raise InputError(f"{name}: has shape {found.shape}, not (height, width, 3)")
    if found.dtype == np.uint8:
        return found
    if not np.issubdtype(found.dtype, np.floating):
        raise InputError(f"{name}: has type {found.dtype}, not uint8 or float")
    found = check.array(name, found, (None, None, 3))
    return np.rint(np.clip(found, 0, 1) * LEVELS).astype(np.uint8)


def _frame(
    model: PackedModel, camera: Camera, config: Config, background: Colour
) -> pipeline.Frame:
    """The golden model's frame."""
    if isinstance(model, Scene):
        raise InputError("model: is a Scene; splatcore.pack makes a packed model of it")
    check.kind("model", model, PackedModel)
    check.view(camera)
    check_fits(config, camera.width, camera.height)
    colour = check.colour("background", background)
    return pipeline.render(config, model, camera, background_codes(config, colour))
