"""The conventions of 3D Gaussian Splatting that decide which pixel gets which value.

One named constant each; `Convention` gathers them so that the reference renderer can switch any
of them to another renderer's choice. Source: Kerbl et al., "3D Gaussian Splatting for Real-Time
Radiance Field Rendering" (SIGGRAPH 2023) and its CUDA rasterizer, except for the footprint.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

NEAR_PLANE = 0.2
"""Default of `Camera.near` (scene units)."""

FRUSTUM_MARGIN = 1.3
"""X/Z and Y/Z in the Jacobian are clamped to ± this times tan(fov/2)."""

COVARIANCE_BLUR = 0.3
"""Added to both diagonal elements of the 2D covariance (square pixels)."""

ALPHA_MIN = 1.0 / 255.0
"""Pixels with a smaller alpha are skipped."""

ALPHA_MAX = 0.99
"""Alpha is clamped to this maximum."""

TRANSMITTANCE_MIN = 1e-4
"""A pixel ends before a Gaussian that would reduce its transmittance below this."""

PIXEL_CENTRE = 0.0
"""Pixel (0, 0) is sampled at u = v = this, with u = fx·X/Z + cx − 0.5."""

PRINCIPAL_POINT_SHIFT = 0.5
"""Subtracted from the principal point so that pixel centres are integers."""

COLOUR_OFFSET = 0.5
"""Added to the spherical-harmonics sum; the result is clamped at 0 from below."""

SIGMA_EXTENT = 3.0
"""Half-width of the original renderer's square footprint in standard deviations."""

TILE = 16
"""Pixels per side of a tile."""

BLOCK = 4
"""Pixels per side of a block, which a rasterizer blends at a time."""

SH_DEGREE_MAX = 3
"""Highest spherical-harmonics degree of scene files."""

Footprint = Literal["exact", "3sigma"]
"""Pixels that a splat may touch.

exact: every pixel with alpha ≥ `alpha_min`
3sigma: only the tiles that the square of half-width ⌈3·√λmax⌉ touches, like the original renderer
"""


class Faint(NamedTuple):
    """The faintness rule: thresholds of the transmittance T (`spec.raster`)."""

    dark: float  # below it, splats that take too little are skipped
    taken: float  # a splat that takes less from a pixel below `dark` is skipped, and T stays
    ends: float  # a splat that would leave less takes all of T, and the pixel ends


@dataclass(frozen=True)
class Convention:
    """Every choice above, for one rendering.

    footprint: pixels that a splat may touch
    faint: the faintness rule, or None for `transmittance_min`
    background: linear RGB in [0, 1], visible through the final transmittance
    """

    frustum_margin: float = FRUSTUM_MARGIN
    covariance_blur: float = COVARIANCE_BLUR
    alpha_min: float = ALPHA_MIN
    alpha_max: float = ALPHA_MAX
    transmittance_min: float = TRANSMITTANCE_MIN
    faint: Faint | None = None
    pixel_centre: float = PIXEL_CENTRE
    principal_point_shift: float = PRINCIPAL_POINT_SHIFT
    colour_offset: float = COLOUR_OFFSET
    footprint: Footprint = "exact"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)


SPLATCORE = Convention()
"""The machine's conventions."""

ORIGINAL = Convention(footprint="3sigma")
"""The original CUDA renderer's conventions."""
