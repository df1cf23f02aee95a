"""Significance of each Gaussian: its contribution to the views, times a volume term.

Source: Fan et al., "LightGaussian" (2024), section 3.2: the sum over views and pixels of
opacity·T, and the volume normalised by the 90th percentile and damped by an exponent.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.gradients.finetune import Progress
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

VOLUME_PERCENTILE = 90.0  # percentile above which a larger volume counts no more
VOLUME_POWER = 0.1  # exponent of the volume


def view_weights(scene: Scene, cameras: Sequence[Camera]) -> Iterator[np.ndarray]:
    """Yield, for each camera, Σ alpha·T over its pixels, [N]."""
    return blending_weights(scene.gaussians(), cameras)


def significance(
    scene: Scene, cameras: Sequence[Camera], progress: Progress | None = None, phase: str = ""
) -> np.ndarray:
    """Significance [N]: Σ alpha·T over views and pixels, times the volume term.

    progress: called with the number of finished cameras, and of all
    phase: begins the name for `progress`
    Returns 0 for Gaussians that no view shows.
    """
    total = np.zeros(len(scene))
    for number, weight in enumerate(view_weights(scene, cameras)):
        total += weight
        if progress:
            progress(f"{phase}: weighing Gaussians", number + 1, len(cameras), None)
    volume = scene.scale.prod(axis=1)
    large = np.percentile(volume, VOLUME_PERCENTILE) if len(volume) else 0.0
    if large > 0:
        total *= np.minimum(volume / large, 1) ** VOLUME_POWER
    return total
