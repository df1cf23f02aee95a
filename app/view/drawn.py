"""The Gaussians that the browser draws: the largest and most opaque ones, in their base colours."""

from dataclasses import dataclass

import numpy as np

from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import ALPHA_MIN, COLOUR_OFFSET
from splatcore.spec.scene import Gaussians, batches

MOST = 1_000_000
"""Maximum number of Gaussians that the browser draws.

Each takes 32 bytes in the server, in the message, in the page and on the GPU, and the page sorts
all of them by depth whenever the camera moves.
"""

LARGEST = float(np.finfo(np.float16).max)  # covariances are sent as float16


@dataclass(frozen=True, eq=False)
class Drawn:
    """Gaussians for the browser.

    arrays: arguments of viser's `add_gaussian_splats`; lengths are in units of `scale`
    total: number of Gaussians in the scene
    """

    arrays: dict[str, np.ndarray | float]
    total: int

    def __len__(self) -> int:
        return len(self.arrays["centers"])

    @property
    def position(self) -> np.ndarray:
        """Centres [N, 3], scene units."""
        return self.arrays["centers"] * self.arrays["scale"]


def drawn_by_browser(gaussians: Gaussians, most: int = MOST) -> Drawn:
    """Return at most `most` of the visible Gaussians, with their colours of degree 0.

    Lengths are divided by the median size: float16 has 5 digits, and covariances below 6e-8 of
    small scenes would become 0.
    """
    chosen, sizes = choose(gaussians, most)
    scale = float(np.median(sizes)) if len(sizes) else 0.0
    scale = scale if 0 < scale < np.inf else 1.0
    slices = list(batches(len(chosen))) or [slice(0)]
    parts = [_arrays(gaussians[chosen[rows]], scale) for rows in slices]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return Drawn(arrays | {"scale": scale}, len(gaussians))


def choose(gaussians: Gaussians, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices [M ≤ most] of the Gaussians to draw, in stored order, and their sizes [M]:
    root mean square of the standard deviations, scene units.

    If more are visible, the largest products of opacity and area remain: they cover the picture.
    """
    weight, size = np.empty((2, len(gaussians)))
    for batch in batches(len(gaussians)):
        part = gaussians[batch]
        with np.errstate(all="ignore"):
            seen = part.opacity >= ALPHA_MIN
            square = (part.factor**2).sum((1, 2))
            area = np.linalg.norm(_covariance(part), axis=(1, 2)) ** 2
            area = np.sqrt(np.maximum(square**2 - area, 0))  # of the ellipsoid's three shadows
        seen &= np.isfinite(part.position).all(1) & np.isfinite(part.factor).all((1, 2))
        size[batch] = np.sqrt(square / 3)
        weight[batch] = np.where(seen, part.opacity * np.nan_to_num(area, nan=np.inf), -1)
    chosen = np.flatnonzero(weight >= 0)
    if len(chosen) > most:
        order = np.argpartition(weight[chosen], len(chosen) - most)
        chosen = np.sort(chosen[order[len(chosen) - most :]])
    return chosen, size[chosen]


def base_colours(gaussians: Gaussians) -> np.ndarray:
    """Return the colours [N, 3] of degree 0, 8 bits, rounded as the reference's pixels."""
    colour = gaussians.sh[:, 0].astype(np.float64) * SH_C0 + COLOUR_OFFSET
    return np.rint(np.clip(np.nan_to_num(colour), 0, 1) * 255).astype(np.uint8)


def _arrays(part: Gaussians, scale: float) -> dict[str, np.ndarray]:
    covariance = np.clip(_covariance(part) / scale**2, -LARGEST, LARGEST)
    opacity = np.rint(np.clip(part.opacity, 0, 1) * 255).astype(np.uint8)
    return {
        "centers": (part.position / scale).astype(np.float32),
        "covariances": covariance.astype(np.float32),
        "rgbs": base_colours(part),
        "opacities": opacity[:, None],
    }


def _covariance(gaussians: Gaussians) -> np.ndarray:
    return gaussians.factor @ gaussians.factor.swapaxes(1, 2)
