"""Packing, pictures, errors and cycles for Python programs."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from splatcore.app.python import check
from splatcore.golden import pipeline
from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack as packed
from splatcore.model.pack.quality import QUALITIES
from splatcore.model.pack.report import PackReport
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame import engines
from splatcore.sim.frame.choose import candidates, choose
from splatcore.sim.frame.metric import LEVELS, Difference, difference
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source
from splatcore.spec.camera import Camera
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
    levels: bool = False,
) -> tuple[PackedModel, PackReport]:
    """Pack a scene into a model for a machine.

    quality: one of `QUALITIES` (about 11.5, 22, up to 38 or 54 bytes per Gaussian); None: the
        smallest except small with at least 45 dB in all cameras, or without cameras the best
    cameras: list of views in which the quality is judged
    config: the machine, or a preset's name
    levels: add coarser levels of detail, drawn by `Camera.lod_pixels`; not for PAPER

    Returns the model and a report on the losses. The model's length is its number of Gaussians,
    `image` its bytes (uint8), `bytes_per_gaussian` its size. The report has the largest errors and
    the number of dropped Gaussians (not_finite; transparent: opacity below 1/255).
    Raises InputError for an unknown quality, and for a scene that the formats cannot hold.
    """
    check.kind("scene", scene, Scene)
    config = check.machine(config)
    if quality is not None and quality not in QUALITIES:
        raise InputError(f"quality: {quality!r} is not one of {', '.join(QUALITIES)}")
    views = check.views(cameras)
    if quality is None and views:
        found = choose(scene, config, views)
        model, report = found.model, found.report
    else:
        model, report = packed(scene, config, quality=quality or candidates(scene, config)[-1])
    if levels:
        model, clipped = with_levels(model, config)
        report = report.with_levels(model, clipped)
    return model, report


def render_reference(
    scene: Scene | PackedModel,
    camera: Camera,
    background: Colour = (0, 0, 0),
    rgba: bool = False,
) -> np.ndarray:
    """Render a scene or model by the float64 reference.

    background: RGB, each 0 … 1
    rgba: add alpha; colour is premultiplied, without a background

    Returns float64 [H, W, 3 or 4], RGB ≥ 0 with 1 for white, not clipped above. Gaussians with NaN
    or Inf are left out. Raises InputError, naming the wrong argument.
    """
    return engines.reference(_shot(check.shown(scene), camera, DEFAULT, background, rgba)).image


def render_golden(
    model: PackedModel,
    camera: Camera,
    config: Config | str = DEFAULT,
    background: Colour = (0, 0, 0),
    rgba: bool = False,
) -> np.ndarray:
    """Render a model as a machine does, to the bit, by the golden model.

    config: the machine, or a preset's name
    background: RGB, each 0 … 1
    rgba: add alpha; colour is premultiplied, without a background. The machine needs `rgba`, as in
        `preset("DEFAULT", rgba=True)`.

    Returns uint8 [H, W, 3 or 4]. Raises InputError for a picture too large for the machine, for
    alpha of a machine without it, and for a model packed for another machine.
    """
    return _frame(model, camera, check.machine(config), background, rgba).pixels


def cycles(
    model: PackedModel, camera: Camera, config: Config | str = DEFAULT
) -> dict[str, int | float]:
    """Estimate the clock cycles of a picture by the cycle model, within 3 % of the RTL per stage.

    Renders the picture by the golden model; raises InputError as `render_golden`.

    Keys of the result:
        chunk, cull, place, project, bin, sort, raster: cycles of each stage alone
        preprocessing, rendering: cycles of the two halves, which overlap, with memory latency
        frame: the slower half
        fps: frames per second at 800 MHz
    """
    config = check.machine(config)
    found = frame_cycles(config, _frame(model, camera, config))
    return found.by_name | {"fps": round(CLOCK_HZ / found.frame, 1)}


def compare(image: np.ndarray, truth: np.ndarray) -> Difference:
    """Compare a picture [H, W, 3] with another of the same size.

    Both are uint8, or float with 1 for white, clipped and rounded to 8 bits.

    Fields of the result:
        psnr_db: None for equal pictures
        ssim: None if a side is below 11 pixels
        max_error: of one channel of one pixel, 0 … 1
        identical: True for equal pictures

    Raises InputError for other shapes and for NaN.
    """
    one, other = pixels("image", image), pixels("truth", truth)
    if one.shape != other.shape:
        raise InputError(f"image: has shape {one.shape}, truth {other.shape}")
    return difference(one, other)


def pixels(name: str, picture: np.ndarray, alpha: bool = False) -> np.ndarray:
    """Return a picture as uint8 [H, W, 3]; raise InputError, naming the argument, if it is none.

    alpha: accept [H, W, 4], too
    """
    found = np.asarray(picture)
    if found.ndim != 3 or found.shape[2] not in ((3, 4) if alpha else (3,)) or not found.size:
        wanted = "3 or 4" if alpha else "3"
        raise InputError(f"{name}: has shape {found.shape}, not (height, width, {wanted})")
    if found.dtype == np.uint8:
        return found
    if not np.issubdtype(found.dtype, np.floating):
        raise InputError(f"{name}: has type {found.dtype}, not uint8 or float")
    found = check.array(name, found, (None, None, found.shape[2]))
    return np.rint(np.clip(found, 0, 1) * LEVELS).astype(np.uint8)


def _frame(
    model: PackedModel,
    camera: Camera,
    config: Config,
    background: Colour = (0, 0, 0),
    rgba: bool = False,
) -> pipeline.Frame:
    """Check the arguments and render the golden model's frame."""
    if isinstance(model, Scene):
        raise InputError("model: is a Scene; pack it first with splatcore.pack")
    check.kind("model", model, PackedModel)
    return engines.golden(_shot(model, camera, config, background, rgba))


def _shot(
    shown: Scene | PackedModel, camera: Camera, config: Config, background: Colour, rgba: bool
) -> Shot:
    """Check the camera and the background, and return the frame, whose progress is not shown."""
    if rgba and any(background):
        raise InputError("background: is not used with rgba")
    of = "scene" if isinstance(shown, Scene) else "model"
    convention = replace(SPLATCORE, background=check.colour("background", background))
    source = Source(shown.name, **{of: shown})
    return Shot(source, check.view(camera), config, convention=convention, rgba=rgba, bar=_silent)


@contextmanager
def _silent(label: str) -> Iterator[Callable]:
    yield lambda *_: None
