"""Scene to packed model: drop what cannot be seen, order, quantise, lay out, and say the loss."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from splatcore.model.pack.chunk import Chunks, chunk_positions
from splatcore.model.pack.codebook import Codebook, quantise
from splatcore.model.pack.factor import largest_axis, lower_triangular
from splatcore.model.pack.layout import Quantised, lay_out
from splatcore.model.pack.quality import COMPACT, INDEXED, SMALL, STEPPED
from splatcore.model.pack.steps import quantise_steps
from splatcore.spec.colour import COARSE, FINE, SECOND, SH_EXPONENT_MAX, folded, slopes_of
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.convention import ALPHA_MIN, COLOUR_OFFSET
from splatcore.spec.error import InputError
from splatcore.spec.memory import (
    ABSOLUTE,
    CHUNK,
    COMPACT_DEGREE,
    COMPONENT,
    FACTOR,
    SLOPE,
    STORED_BITS,
    ModelFormat,
    compact_degrees,
    model_format,
    step_format,
)
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from splatcore.spec.small import FACTOR_MAX, rounded_factor

STEPS = ("order", "colour", "harmonics", "layout")
Progress = Callable[[str], None]  # called with the name of each of `STEPS` as it begins
Codebooks = tuple[Codebook, Codebook]  # of colours, and of harmonics as slopes


@dataclass(frozen=True)
class PackReport:
    """The effect of packing on a scene. Errors are of the packed Gaussians against the scene's."""

    gaussians: int  # in the scene
    packed: int
    not_finite: int  # dropped: NaN or Inf
    transparent: int  # dropped: opacity below 1/255
    sh_degree: int
    bytes: int
    codebook_bytes: int
    bytes_per_gaussian: float  # without the codebooks
    position_error: float  # largest, scene units
    factor_error: float  # largest error of an element of L over the Gaussian's largest axis
    opacity_error: float  # largest
    colour_rms: float
    sh_rms: list[float]  # of degrees 1, 2 …, of the factors of their polynomials
    colour_error: float  # largest
    sh_error: list[float]  # largest, likewise

    def as_dict(self) -> dict:
        return asdict(self)


def pack(
    scene: Scene,
    config: Config = DEFAULT,
    sh_degree: int | None = None,
    progress: Progress | None = None,
    codebooks: Codebooks | None = None,
    quality: str | np.ndarray = COMPACT,
) -> tuple[PackedModel, PackReport]:
    """Pack a scene for a machine, with harmonics up to `sh_degree` (default: as many as fit), in
    one of `QUALITIES` or with layouts [C] of `spec.colour.LAYOUTS` for its chunks.

    Gaussians that hold NaN or Inf, or can never reach alpha 1/255, are dropped and counted.
    `codebooks` of the scene's Gaussians replace those that are made here; they need the machine's
    format of that degree.
    """
    progress = progress or (lambda step: None)
    degree = min(config.sh_degree, scene.sh_degree, 3 if sh_degree is None else sh_degree)
    known = qualities_of(config)
    if (quality if isinstance(quality, str) else STEPPED[0]) not in known:
        kinds = ", ".join(known)
        raise InputError(f"{scene.name}: preset {config.name} renders {kinds} models only")
    format = format_of(config, quality, degree)
    degree = format.sh_degree
    progress("order")
    finite, visible = keep(scene)
    stored, chunks = stored_order(scene, format.stored_bits)
    kept = scene[stored].with_sh_degree(degree)
    lower = lower_triangular(kept.gaussians().factor)
    progress("colour")
    if codebooks:
        colour = tuple(codebook[stored] for codebook in codebooks)
    elif format.codebooks:
        colours, slopes = appearance(kept)
        first = quantise(colours, format.colour_index, COMPONENT)
        progress("harmonics")
        colour = first, quantise(slopes, format.sh_index, SLOPE, largest=SH_EXPONENT_MAX)
    else:
        progress("harmonics")
        factors = folded(kept.sh)
        colour = quantise_steps(factors, layouts(factors, quality))
    progress("layout")
    absolute = format.position == "absolute"
    if absolute and not np.isfinite(ABSOLUTE.round(kept.position)).all():
        raise InputError(f"{scene.name}: a position is too large for preset {config.name}'s floats")
    position = ABSOLUTE.encode(kept.position) if absolute else chunks.stored
    exponent = factor_exponent(config, format, np.abs(lower).max(initial=0))
    factor = np.ldexp(lower, -exponent)
    factor = rounded_factor(factor) if format.small else FACTOR.round(factor)
    opacity = format.stored_record["opacity"].round(-np.log2(np.minimum(kept.opacity, 1)))
    quantised = Quantised(
        format, chunks, position, factor, exponent, opacity, colour, scene.antialiased
    )
    model = PackedModel(lay_out(quantised), scene.name)
    dropped = int((~finite).sum()), int((finite & ~visible).sum())
    return model, report(kept, lower, model, dropped)


def qualities_of(config: Config) -> tuple[str, ...]:
    """`QUALITIES` of the models that a machine renders."""
    stepped = () if config.colours == "array" else STEPPED
    return (*INDEXED[not config.small_models :], *stepped)


def format_of(config: Config, quality: str | np.ndarray, degree: int) -> ModelFormat:
    """The format of models of a quality, of that SH degree at most."""
    if not isinstance(quality, str) or quality in STEPPED:
        return step_format(config, degree)
    return model_format(config, min(degree, COMPACT_DEGREE), quality == SMALL)


def layouts(factors: list[np.ndarray], quality: str | np.ndarray) -> np.ndarray:
    """Layouts [C] of the chunks of Gaussians with factors [N, k, 3] of each degree's polynomials:
    those given, but none more than the chunk has harmonics for."""
    starts = np.arange(0, len(factors[0]), CHUNK)
    degree = np.zeros(len(starts), np.int64)  # the highest that is not zero
    for d, factor in enumerate(factors):
        largest = np.abs(factor).max((1, 2), initial=0)
        has = np.maximum.reduceat(largest, starts) > 0 if len(starts) else degree > 0
        degree = np.where(has, d, degree)
    return layout_of(quality, degree)


def layout_of(quality: str | np.ndarray, degree: int | np.ndarray) -> np.ndarray:
    """The layout in `spec.colour.LAYOUTS` of chunks with harmonics up to `degree`."""
    asked = {"balanced": COARSE, "faithful": FINE}[quality] if isinstance(quality, str) else quality
    second = np.minimum(asked, SECOND)  # those of degree 3 hold nothing more of degrees 1 and 2
    return np.where(np.greater(degree, 2), asked, np.where(np.greater(degree, 0), second, 0))


def report(kept: Scene, lower: np.ndarray, model: PackedModel, gone: tuple[int, int]) -> PackReport:
    """The report on Gaussians in stored order with factors `lower`; `gone` counts those that are
    not finite and transparent."""
    packed = model.gaussians()
    axis = np.maximum(largest_axis(lower), np.finfo(np.float64).tiny)
    errors = [a - b for a, b in zip(model.factors, folded(kept.sh), strict=True)]
    return PackReport(
        gaussians=len(kept) + sum(gone),
        packed=len(model),
        not_finite=gone[0],
        transparent=gone[1],
        sh_degree=kept.sh_degree,
        bytes=len(model.image),
        codebook_bytes=model.format.codebook_bytes,
        bytes_per_gaussian=model.bytes_per_gaussian,
        position_error=_largest(packed.position - kept.position),
        factor_error=_largest((packed.factor - lower) / axis[:, None, None]),
        opacity_error=_largest(packed.opacity - kept.opacity),
        colour_rms=_rms(errors[0]),
        sh_rms=[_rms(error) for error in errors[1:]],
        colour_error=_largest(errors[0]),
        sh_error=[_largest(error) for error in errors[1:]],
    )


def appearance(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The vectors that codebooks hold of a scene of degree 0 or 1: colours [N, 3] as the original
    renderer has them without harmonics, and slopes [N, 9] (without harmonics [0, 9])."""
    colours = folded(scene.sh)[0][:, 0] + COLOUR_OFFSET
    if not scene.sh_degree:
        return colours, np.zeros((0, 9))
    return colours, slopes_of(folded(scene.sh)[1]).reshape(-1, 9)


def _largest(error: np.ndarray) -> float:
    return float(np.abs(error).max(initial=0))


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt((error**2).mean())) if error.size else 0.0


def keep(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Masks [N]: Gaussians without NaN and Inf, and Gaussians that can reach alpha 1/255."""
    finite = np.isfinite(scene.opacity) & np.isfinite(scene.sh).all((1, 2))
    for array in (scene.position, scene.scale, scene.quaternion):
        finite &= np.isfinite(array).all(1)
    return finite, scene.opacity >= ALPHA_MIN


def stored_order(scene: Scene, bits: int = STORED_BITS) -> tuple[np.ndarray, Chunks]:
    """Which Gaussians [M] of a scene are stored, in that order, and their chunks, of whose offsets
    so many bits are stored."""
    finite, visible = keep(scene)
    stored = np.flatnonzero(finite & visible)
    chunks = chunk_positions(scene.position[stored], bits)
    return stored[chunks.order], chunks


def packable(config: Config) -> tuple:
    """What of a machine decides how a scene is packed for it."""
    formats = [model_format(config, degree) for degree in compact_degrees(config)]
    kinds = config.sh_degree, config.colours, config.small_models
    return *formats, *kinds, largest_factor(config.arithmetic)


def factor_exponent(config: Config, format: ModelFormat, largest: float) -> int:
    """The least exponent of a unit in which elements of L up to `largest` fit."""
    bound = largest_factor(config.arithmetic)
    return int(np.frexp(largest / (min(bound, FACTOR_MAX) if format.small else bound))[1])


def largest_factor(arithmetic: Float) -> float:
    """Bound on the elements of L: in the middle of the machine's range, if that is small.

    The view rotation takes up L's unit; so neither L overflows nor the rotation underflows.
    """
    return min(FACTOR.max, np.sqrt(arithmetic.max))
