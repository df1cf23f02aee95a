"""Report on packing a scene: counts, sizes, errors, and notes about losses."""

from dataclasses import dataclass

import numpy as np

from splatcore.model.pack.factor import largest_axis
from splatcore.spec.colour import folded
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

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

    @property
    def notes(self) -> list[str]:
        """Lines for the user about Gaussians that are stored inexactly or not at all."""
        counts = {
            "with NaN, Inf or beyond float32, left out": self.not_finite,
            "far outside the scene, stored in chunks of {their} own": self.floaters,
            "of these moved nearer and shrunk in proportion": self.moved,
            "too large for the model's number format, clipped": self.clipped,
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


def report(
    kept: Scene, lower: np.ndarray, model: PackedModel, padding: np.ndarray, counts: dict[str, int]
) -> PackReport:
    """Compare a model with its Gaussians before rounding.

    kept: Gaussians [N] in stored order
    lower: [N, 3, 3] their factors L
    padding: [N] bool, copies that do not count
    counts: the report's fields that packing has counted
    """
    own = ~padding
    kept, lower, packed = kept[own], lower[own], model.gaussians()[own]
    axis = np.maximum(largest_axis(lower), np.finfo(np.float64).tiny)
    off = np.abs(packed.position - kept.position).max(1)
    coarse = (off > axis) & (off > COARSE_SHARE * np.abs(kept.position).max(1))
    pairs = zip(model.factors, folded(kept.sh), strict=True)
    errors = [packed_factor[own] - exact for packed_factor, exact in pairs]
    return PackReport(
        **counts,
        packed=len(kept),
        coarse=int(coarse.sum()),
        padding=int(padding.sum()),
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


def _largest(error: np.ndarray) -> float:
    return float(np.abs(error).max(initial=0))


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt((error**2).mean())) if error.size else 0.0
