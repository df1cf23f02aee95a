"""Scene to packed model: drop invisible Gaussians, order, quantise, lay out, report the loss."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.model.pack.codebook import Codebook, quantise
from splatcore.model.pack.factor import elements, from_elements, lower_triangular
from splatcore.model.pack.layout import Quantised, Whole, lay_out, rows_of
from splatcore.model.pack.quality import COMPACT, INDEXED, SMALL, STEPPED
from splatcore.model.pack.report import PackReport, report
from splatcore.model.pack.steps import (
    largest_factors,
    no_steps,
    quantise_steps,
    step_exponents,
)
from splatcore.model.pack.stored import Stored, stored_scene
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
    chunk_count,
    compact_degrees,
    model_format,
    step_format,
)
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.progress import report as report_progress
from splatcore.spec.scene import LARGE, Scene
from splatcore.spec.small import FACTOR_MAX, rounded_factor
from splatcore.spec.threads import in_threads

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
    stored = stored_scene(scene, format)
    absolute = format.position == "absolute"
    if absolute and not np.isfinite(ABSOLUTE.round(stored.position)).all():
        raise InputError(f"{scene.name}: a position is too large for preset {config.name}'s floats")
    stored, clipped = clip_scales(stored, largest_element(config, format))
    progress("colour")
    books = tuple(codebook[stored.index] for codebook in codebooks or ())
    harmonics, exponents, books = colours(stored, format, quality, books, progress)
    progress("layout")
    lower = np.empty((len(stored), 6))

    def factors(rows: slice):
        lower[rows] = elements(lower_triangular(stored.factor(rows)))

    for _ in in_threads(factors, len(stored)):
        pass
    largest = max(lower.max(initial=0), -lower.min(initial=0))
    whole = Whole(
        format, len(stored), harmonics, exponents, stored.chunks.exponent,
        factor_exponent(config, format, largest), books, scene.antialiased,
    )  # fmt: skip
    parts = in_threads(lambda rows: rows_of(quantised(stored, lower, rows, whole)), len(stored))
    model = PackedModel(lay_out(whole, parts, scene.name), scene.name)
    return model, report(stored, lower, model, clipped)


def quantised(stored: Stored, lower: np.ndarray, rows: slice, whole: Whole) -> Quantised:
    """Round some Gaussians; lower: [N, 6] elements of L of all Gaussians."""
    format, chunks = whole.format, stored.chunks[rows]
    absolute = format.position == "absolute"
    position = ABSOLUTE.encode(stored.position[rows]) if absolute else chunks.stored
    factor = np.ldexp(from_elements(lower[rows]), -whole.factor_exponent)
    factor = rounded_factor(factor) if format.small else FACTOR.round(factor)
    with np.errstate(divide="ignore"):  # padding gets the lowest opacity
        attenuation = -np.log2(np.minimum(stored.opacity(rows), 1))
    opacity = format.stored_record["opacity"].round(attenuation)
    if format.codebooks:
        steps = no_steps(len(opacity), whole.exponents)
    else:
        own = whole.harmonics[rows.start // CHUNK : chunk_count(rows.stop)]
        steps = quantise_steps(folded(stored.sh(rows, format.sh_degree)), own, whole.exponents)
    books = tuple(codebook[rows] for codebook in whole.codebooks)
    exponent = whole.factor_exponent
    return Quantised(format, chunks, position, factor, exponent, opacity, steps, books)


def colours(
    stored: Stored,
    format: ModelFormat,
    quality: str | np.ndarray,
    books: tuple[Codebook, ...],
    progress: Progress,
) -> tuple[np.ndarray, list[int], tuple[Codebook, ...]]:
    """Layouts [C] of chunks, exponents E of each degree, and codebooks.

    books: codebooks that are already made, or none
    """
    count, degree = len(stored), format.sh_degree
    if not format.codebooks:
        progress("harmonics")
        largest = np.zeros((chunk_count(count), degree + 1))

        def measured(rows: slice):
            own = slice(rows.start // CHUNK, chunk_count(rows.stop))
            largest[own] = largest_factors(folded(stored.sh(rows, degree)))

        for _ in in_threads(measured, count):
            pass
        found = layouts(largest, quality)
        return found, step_exponents(largest, found), ()
    if not books:
        dtype = np.float64 if count <= LARGE else np.float32
        shown, slopes = np.empty((count, 3), dtype), np.empty((count if degree else 0, 9), dtype)

        def appear(rows: slice):
            shown[rows], slopes[rows] = appearance(stored.sh(rows, degree))

        for _ in in_threads(appear, count):
            pass
        first = quantise(shown, format.colour_index, COMPONENT)
        del shown
        progress("harmonics")
        books = first, quantise(slopes, format.sh_index, SLOPE, largest=SH_EXPONENT_MAX)
    used = [codebook.exponent for codebook in books if codebook.entries]
    steps = no_steps(count, used)
    return steps.harmonics, steps.exponents, books


def qualities_of(config: Config) -> tuple[str, ...]:
    """The qualities of `QUALITIES` that a machine renders."""
    stepped = () if config.colours == "array" else STEPPED
    return (*INDEXED[not config.small_models :], *stepped)


def format_of(config: Config, quality: str | np.ndarray, degree: int) -> ModelFormat:
    """The format of models of a quality, with at most that SH degree."""
    if not isinstance(quality, str) or quality in STEPPED:
        return step_format(config, degree)
    return model_format(config, min(degree, COMPACT_DEGREE), quality == SMALL)


def layouts(largest: np.ndarray, quality: str | np.ndarray) -> np.ndarray:
    """Layouts [C] of chunks: the quality's layout, reduced to the degree that each chunk needs.

    largest: [C, degrees] largest magnitude of the polynomials' factors of each degree
    quality: in steps, or a layout [C] per chunk
    """
    degree = np.zeros(len(largest), np.int64)  # the highest with a factor that is not zero
    for d, factor in enumerate(largest.T):
        degree = np.where(factor > 0, d, degree)
    return layout_of(quality, degree)


def layout_of(quality: str | np.ndarray, degree: int | np.ndarray) -> np.ndarray:
    """The layout in `spec.colour.LAYOUTS` of chunks with harmonics up to `degree`."""
    asked = {"balanced": COARSE, "faithful": FINE}[quality] if isinstance(quality, str) else quality
    second = np.minimum(asked, SECOND)  # degree 3 layouts store degrees 1 and 2 no better
    return np.where(np.greater(degree, 2), asked, np.where(np.greater(degree, 0), second, 0))


def appearance(sh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vectors that codebooks store for harmonics [N, (degree+1)², 3] of degree 0 or 1: colours
    [N, 3], as rendered without higher harmonics, and slopes [N, 9] ([0, 9] for degree 0)."""
    factors = folded(sh)
    colours = factors[0][:, 0] + COLOUR_OFFSET
    if len(factors) == 1:
        return colours, np.zeros((0, 9))
    return colours, slopes_of(factors[1]).reshape(-1, 9)


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


def clip_scales(stored: Stored, bound: float) -> tuple[Stored, int]:
    """Clip scales so that the unit of L suits most Gaussians; return the Gaussians and the number
    of clipped ones.

    bound: largest element of L, in L's unit; the median Gaussian's L has at least 2^−MEDIAN_BITS
    """
    largest = stored.original.scale.max(1, initial=0)[stored.index] * stored.share
    if not largest.any():
        return stored, 0
    most = np.median(largest[largest > 0]) * bound * 2.0**MEDIAN_BITS
    return replace(stored, scale_max=most), int((largest > most).sum())


def largest_factor(arithmetic: Float) -> float:
    """Bound on the elements of L: the middle of the arithmetic's range, if that is small.

    L's unit is multiplied into the view rotation; so neither L overflows nor the rotation
    underflows.
    """
    return min(FACTOR.max, np.sqrt(arithmetic.max))
