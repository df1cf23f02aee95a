"""Scene to packed model: drop invisible Gaussians, order, quantise, lay out, report the loss."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.model.pack.codebook import Codebook, quantise
from splatcore.model.pack.factor import lower_triangular
from splatcore.model.pack.layout import Quantised, lay_out
from splatcore.model.pack.quality import COMPACT, INDEXED, SMALL, STEPPED
from splatcore.model.pack.report import PackReport, report
from splatcore.model.pack.steps import Steps, no_steps, quantise_steps
from splatcore.model.pack.stored import keep, stored_scene
from splatcore.spec.colour import COARSE, FINE, SECOND, SH_EXPONENT_MAX, folded, slopes_of
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.error import InputError
from splatcore.spec.memory import (
    ABSOLUTE,
    CHUNK,
    COMPACT_DEGREE,
    COMPONENT,
    EXPONENT_MAX,
    FACTOR,
    SLOPE,
    ModelFormat,
    compact_degrees,
    model_format,
    step_format,
)
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.progress import report as report_progress
from splatcore.spec.scene import Scene
from splatcore.spec.small import FACTOR_MAX, rounded_factor

STEPS = ("order", "colour", "harmonics", "layout")
Progress = Callable[[str], None]  # called with the name of each of `STEPS` as it begins
MEDIAN_BITS = 8  # L of the median Gaussian is at least 2^−MEDIAN_BITS units
Codebooks = tuple[Codebook, Codebook]  # of colours, and of harmonics as slopes


def pack(
    scene: Scene,
    config: Config = DEFAULT,
    sh_degree: int | None = None,
    progress: Progress | None = None,
    codebooks: Codebooks | None = None,
    quality: str | np.ndarray = COMPACT,
) -> tuple[PackedModel, PackReport]:
    """Pack a scene for a machine; return the model and a report on what was lost.

    sh_degree: highest degree of harmonics to keep (default: all that the machine renders)
    progress: called with the name of each of `STEPS` as it begins (default: `spec.progress`)
    codebooks: of the scene's Gaussians, in the format of that degree (default: made here)
    quality: one of `QUALITIES`, or layouts [C] (`spec.colour.LAYOUTS`), one per chunk

    Gaussians with NaN, Inf or a number beyond float32, or that never reach alpha 1/255, are
    dropped and counted. Raises InputError if the machine cannot render models of that quality.
    """
    progress = progress or report_progress
    degree = min(config.sh_degree, scene.sh_degree, 3 if sh_degree is None else sh_degree)
    known = qualities_of(config)
    if (quality if isinstance(quality, str) else STEPPED[0]) not in known:
        kinds = ", ".join(known)
        raise InputError(f"{scene.name}: preset {config.name} renders {kinds} models only")
    format = format_of(config, quality, degree)
    degree = format.sh_degree
    progress("order")
    finite, visible = keep(scene)
    stored = stored_scene(scene, format)
    chunks, kept = stored.chunks, stored.scene.with_sh_degree(degree)
    kept, clipped = clip_scales(kept, largest_element(config, format))
    lower = lower_triangular(kept.gaussians().factor)
    progress("colour")
    books = tuple(codebook[stored.index] for codebook in codebooks or ())
    colour = quantised_colours(kept, format, quality, books, progress)
    progress("layout")
    absolute = format.position == "absolute"
    if absolute and not np.isfinite(ABSOLUTE.round(kept.position)).all():
        raise InputError(f"{scene.name}: a position is too large for preset {config.name}'s floats")
    position = ABSOLUTE.encode(kept.position) if absolute else chunks.stored
    exponent = factor_exponent(config, format, np.abs(lower).max(initial=0))
    factor = np.ldexp(lower, -exponent)
    factor = rounded_factor(factor) if format.small else FACTOR.round(factor)
    with np.errstate(divide="ignore"):  # padding gets the lowest opacity
        opacity = format.stored_record["opacity"].round(-np.log2(np.minimum(kept.opacity, 1)))
    quantised = Quantised(
        format, chunks, position, factor, exponent, opacity, *colour, scene.antialiased
    )
    model = PackedModel(lay_out(quantised, scene.name), scene.name)
    counts = {
        "gaussians": len(scene),
        "not_finite": int((~finite).sum()),
        "transparent": int((finite & ~visible).sum()),
        "floaters": stored.floaters,
        "moved": stored.moved,
        "clipped": clipped,
    }
    return model, report(kept, lower, model, chunks.padding, counts)


def quantised_colours(
    kept: Scene,
    format: ModelFormat,
    quality: str | np.ndarray,
    books: tuple[Codebook, ...],
    progress: Progress,
) -> tuple[Steps, tuple[Codebook, ...]]:
    """Steps and codebooks of Gaussians in stored order.

    books: codebooks that are already made, or none
    """
    if not format.codebooks:
        progress("harmonics")
        factors = folded(kept.sh)
        return quantise_steps(factors, layouts(factors, quality)), ()
    if not books:
        colours, slopes = appearance(kept)
        first = quantise(colours, format.colour_index, COMPONENT)
        progress("harmonics")
        books = first, quantise(slopes, format.sh_index, SLOPE, largest=SH_EXPONENT_MAX)
    used = [codebook.exponent for codebook in books if codebook.entries]
    return no_steps(len(kept), used), books


def qualities_of(config: Config) -> tuple[str, ...]:
    """The qualities of `QUALITIES` that a machine renders."""
    stepped = () if config.colours == "array" else STEPPED
    return (*INDEXED[not config.small_models :], *stepped)


def format_of(config: Config, quality: str | np.ndarray, degree: int) -> ModelFormat:
    """The format of models of a quality, with at most that SH degree."""
    if not isinstance(quality, str) or quality in STEPPED:
        return step_format(config, degree)
    return model_format(config, min(degree, COMPACT_DEGREE), quality == SMALL)


def layouts(factors: list[np.ndarray], quality: str | np.ndarray) -> np.ndarray:
    """Layouts [C] of chunks: the quality's layout, reduced to the degree that each chunk needs.

    factors: [N, k, 3] for each degree, of its polynomials
    quality: in steps, or a layout [C] per chunk
    """
    starts = np.arange(0, len(factors[0]), CHUNK)
    degree = np.zeros(len(starts), np.int64)  # the highest with a factor that is not zero
    for d, factor in enumerate(factors):
        largest = np.abs(factor).max((1, 2), initial=0)
        has = np.maximum.reduceat(largest, starts) > 0 if len(starts) else degree > 0
        degree = np.where(has, d, degree)
    return layout_of(quality, degree)


def layout_of(quality: str | np.ndarray, degree: int | np.ndarray) -> np.ndarray:
    """The layout in `spec.colour.LAYOUTS` of chunks with harmonics up to `degree`."""
    asked = {"balanced": COARSE, "faithful": FINE}[quality] if isinstance(quality, str) else quality
    second = np.minimum(asked, SECOND)  # degree 3 layouts store degrees 1 and 2 no better
    return np.where(np.greater(degree, 2), asked, np.where(np.greater(degree, 0), second, 0))


def appearance(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The vectors that codebooks store for a scene of degree 0 or 1: colours [N, 3], as rendered
    without higher harmonics, and slopes [N, 9] ([0, 9] for degree 0)."""
    colours = folded(scene.sh)[0][:, 0] + COLOUR_OFFSET
    if not scene.sh_degree:
        return colours, np.zeros((0, 9))
    return colours, slopes_of(folded(scene.sh)[1]).reshape(-1, 9)


def packing_key(config: Config) -> tuple:
    """Cache key: the fields of a machine that change the packed model."""
    formats = [model_format(config, degree) for degree in compact_degrees(config)]
    kinds = config.sh_degree, config.colours, config.small_models
    return *formats, *kinds, largest_factor(config.arithmetic)


def factor_exponent(config: Config, format: ModelFormat, largest: float) -> int:
    """The smallest exponent of a unit of L in which elements up to `largest` fit."""
    exponent = int(np.frexp(largest / largest_element(config, format))[1])
    return max(exponent, -EXPONENT_MAX)


def largest_element(config: Config, format: ModelFormat) -> float:
    """Bound on the elements of L, in L's unit."""
    bound = largest_factor(config.arithmetic)
    return min(bound, FACTOR_MAX) if format.small else bound


def clip_scales(scene: Scene, bound: float) -> tuple[Scene, int]:
    """Clip scales so that the unit of L suits most Gaussians; return the scene and the number of
    clipped Gaussians.

    bound: largest element of L, in L's unit; the median Gaussian's L has at least 2^−MEDIAN_BITS
    """
    largest = scene.scale.max(1, initial=0)
    if not largest.any():
        return scene, 0
    most = np.median(largest[largest > 0]) * bound * 2.0**MEDIAN_BITS
    return replace(scene, scale=np.minimum(scene.scale, most)), int((largest > most).sum())


def largest_factor(arithmetic: Float) -> float:
    """Bound on the elements of L: the middle of the arithmetic's range, if that is small.

    L's unit is multiplied into the view rotation; so neither L overflows nor the rotation
    underflows.
    """
    return min(FACTOR.max, np.sqrt(arithmetic.max))
