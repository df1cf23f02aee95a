"""Report on packing a scene: counts, sizes, errors, and notes about losses."""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.model.pack.factor import ABOUT, about_axis, from_elements, largest_axis
from splatcore.model.pack.stored import Stored
from splatcore.spec.colour import folded
from splatcore.spec.packed import PackedModel
from splatcore.spec.threads import in_threads

COARSE_SHARE = 1e-3
"""A position is `coarse` if its error exceeds this share of it and the size of its Gaussian."""


@dataclass(frozen=True)
class PackReport:
    """The effect of packing on a scene. Errors compare packed Gaussians with the scene's."""

    gaussians: int  # in the scene
    packed: int  # Gaussians in the model, without padding
    not_finite: int  # dropped: NaN, Inf or beyond float32
    transparent: int  # dropped: opacity below 1/255
    floaters: int  # far outside the scene, in chunks of their own
    moved: int  # floaters beyond the grid, moved nearer and shrunk in proportion
    clipped: int  # scales larger than L can represent
    coarse: int  # position errors above a thousandth of the position and the Gaussian's size
    padding: int  # copies in the model, nearly transparent, that fill the chunk before the floaters
    sh_degree: int
    bytes: int
    codebook_bytes: int
    bytes_per_gaussian: float  # without the codebooks
    position_error: float  # largest, scene units
    factor_error: float  # largest error of an element of L over the Gaussian's largest axis
    opacity_error: float  # largest
    colour_rms: float  # root mean square error
    sh_rms: list[float]  # per degree from 1, of the factors of its polynomials
    colour_error: float  # largest
    sh_error: list[float]  # largest, per degree from 1
    coarse_clipped: int = 0  # scales of coarser levels that are larger than L can represent

    def with_levels(self, model: PackedModel, clipped: int) -> "PackReport":
        """Return the report with the sizes of the model with levels. clipped: `coarse_clipped`"""
        size = {"bytes": len(model.image), "bytes_per_gaussian": model.bytes_per_gaussian}
        return replace(self, **size, coarse_clipped=clipped)

    @property
    def notes(self) -> list[str]:
        """Lines for the user about Gaussians that are stored inexactly or not at all."""
        counts = {
            "with NaN, Inf or beyond float32, left out": self.not_finite,
            "far outside the scene, stored in chunks of {their} own": self.floaters,
            "of these moved nearer and shrunk in proportion": self.moved,
            "too large for the model's number format, clipped": self.clipped,
            "of coarser levels too large for the model's number format, clipped": (
                self.coarse_clipped
            ),
            "off by more than {their} size, because positions are too far apart": self.coarse,
        }
        lines = [
            f"{count} Gaussian{'' if count == 1 else 's'} "
            + fate.format(their="its" if count == 1 else "their")
            for fate, count in counts.items()
            if count
        ]
        errors = enumerate([self.colour_error, *self.sh_error])
        lost = ", ".join(f"{error:.3g} of degree {d}" for d, error in errors if error > 1)
        if lost:
            lines.append(f"coefficients out of the range of their steps, off by up to {lost}")
        return lines


def report(stored: Stored, lower: np.ndarray, model: PackedModel, clipped: int) -> PackReport:
    """Compare a model with its Gaussians before rounding.

    lower: [N, 6] elements of L
    clipped: scales that were clipped
    """
    degree, padding = model.format.sh_degree, stored.chunks.padding

    def errors(rows: slice) -> tuple[list, list, int]:
        """Largest errors, sums of squares, and coarse positions of some Gaussians."""
        own = ~padding[rows]
        part, factor = model.decoded(rows), from_elements(lower[rows][own])
        position = stored.position[rows][own]
        off = np.abs(part.position[own] - position).max(1)
        larger = off > COARSE_SHARE * np.abs(position).max(1)
        coarse = int((off[larger] > axis_of(factor[larger])).sum())
        opaque = np.abs(part.opacity - stored.opacity(rows))[own].max(initial=0)
        ratio = largest_ratio(part.factor[own] - factor, factor)
        pairs = zip(part.factors, folded(stored.sh(rows, degree)), strict=True)
        colours = [(found - true)[own] for found, true in pairs]
        most = [off.max(initial=0), ratio, opaque, *(np.abs(e).max(initial=0) for e in colours)]
        return most, [(error**2).sum() for error in colours], coarse

    most, squares, coarse = np.zeros(4 + degree), np.zeros(degree + 1), 0
    for largest, sums, number in in_threads(errors, len(stored)):
        most, squares, coarse = np.maximum(most, largest), squares + sums, coarse + number
    position, factor, opacity, *of_degree = most.tolist()
    count = int(len(stored) - padding.sum())
    numbers = 3 * (2 * np.arange(degree + 1) + 1) * max(count, 1)
    rms = [float(each) for each in np.sqrt(squares / numbers)]
    return PackReport(
        gaussians=len(stored.original),
        packed=count,
        not_finite=stored.not_finite,
        transparent=stored.transparent,
        floaters=stored.floaters,
        moved=stored.moved,
        clipped=clipped,
        coarse=coarse,
        padding=int(padding.sum()),
        sh_degree=degree,
        bytes=len(model.image),
        codebook_bytes=model.format.codebook_bytes,
        bytes_per_gaussian=model.bytes_per_gaussian,
        position_error=position,
        factor_error=factor,
        opacity_error=opacity,
        colour_rms=rms[0],
        sh_rms=rms[1:],
        colour_error=of_degree[0],
        sh_error=of_degree[1:],
    )


def axis_of(factor: np.ndarray) -> np.ndarray:
    """Largest standard deviation [N] > 0 of Gaussians with factors [N, 3, 3]."""
    return np.maximum(largest_axis(factor), np.finfo(np.float64).tiny)


def largest_ratio(error: np.ndarray, factor: np.ndarray) -> float:
    """Largest element of errors [N, 3, 3] over their Gaussians' largest axes. Only candidates by
    the approximate axis need the exact one."""
    error = np.abs(error).max((1, 2), initial=0)
    about = error / np.maximum(about_axis(factor), np.finfo(np.float64).tiny)
    near = np.flatnonzero(about >= about.max(initial=0) * (1 - 3 * ABOUT))
    return float((error[near] / axis_of(factor[near])).max(initial=0))
