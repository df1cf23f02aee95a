"""The conventions of 3D Gaussian Splatting that decide which pixel gets which value.

One named constant each; `Convention` gathers them so that the reference renderer can switch any
of them to another renderer's choice. Source: Kerbl et al., "3D Gaussian Splatting for Real-Time
Radiance Field Rendering" (SIGGRAPH 2023) and its CUDA rasterizer, but for the footprint.
"""

from dataclasses import dataclass
from typing import Literal

NEAR_PLANE = 0.2
"""Default of `Camera.near`."""

FRUSTUM_MARGIN = 1.3
"""X/Z and Y/Z in the Jacobian are clamped to ± this times tan(fov/2)."""

COVARIANCE_BLUR = 0.3
"""Added to both diagonal elements of the 2D covariance (square pixels)."""

ALPHA_MIN = 1.0 / 255.0
"""A pixel whose alpha is below this is skipped."""

ALPHA_MAX = 0.99
"""Alpha is clamped to this."""

TRANSMITTANCE_MIN = 1e-4
"""A pixel ends when its next transmittance would fall below this; that Gaussian is not blended."""

PIXEL_CENTRE = 0.0
"""Pixel (0, 0) is sampled at u = v = this, with u = fx·X/Z + cx − 0.5."""

PRINCIPAL_POINT_SHIFT = 0.5
"""Subtracted from the principal point so that pixel centres are integers."""

COLOUR_OFFSET = 0.5
"""Added to the spherical-harmonics sum; the result is clamped at 0 from below."""

SIGMA_EXTENT = 3.0
"""Half-width of the original renderer's square footprint in standard deviations."""

TILE = 16
"""Pixels along the side of a tile."""

BLOCK = 4
"""Pixels along the side of a block, the unit that a rasterizer visits."""

SH_DEGREE_MAX = 3
"""Highest spherical-harmonics degree that scene files hold."""

Footprint = Literal["exact", "3sigma"]


@dataclass(frozen=True)
class Convention:
    """Every choice above, for one rendering.

    `footprint` is "exact" (every pixel with alpha ≥ `alpha_min`) or "3sigma" (the original
    renderer's: only the tiles that the square of half-width ⌈3·√λmax⌉ touches).
    `faint` leaves out what is too faint to be seen, in place of `transmittance_min`: (from, below,
    ends), where T < from a contribution alpha·T < below is skipped, and the one that brings T below
    `ends` takes all of T and ends the pixel.
    `background` is linear RGB in [0, 1], seen through the final transmittance.
    """

    frustum_margin: float = FRUSTUM_MARGIN
    covariance_blur: float = COVARIANCE_BLUR
    alpha_min: float = ALPHA_MIN
    alpha_max: float = ALPHA_MAX
    transmittance_min: float = TRANSMITTANCE_MIN
    faint: tuple[float, float, float] | None = None
    pixel_centre: float = PIXEL_CENTRE
    principal_point_shift: float = PRINCIPAL_POINT_SHIFT
    colour_offset: float = COLOUR_OFFSET
    footprint: Footprint = "exact"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)


SPLATCORE = Convention()
"""The machine's conventions."""

ORIGINAL = Convention(footprint="3sigma")
"""The original CUDA renderer's."""
