"""How far apart two 8-bit images are: the one place where PSNR, SSIM and maximum error are made."""

from dataclasses import dataclass

import numpy as np
from skimage.metrics import mean_squared_error, structural_similarity

from spec.error import InputError

LEVELS = 255
"""Largest value of an 8-bit channel; errors are fractions of it."""

SSIM_WINDOW = 11
"""Pixels along the side of the Gaussian window (σ = 1.5) of Wang et al. 2004."""


@dataclass(frozen=True)
class Difference:
    """Metrics of one image against another."""

    psnr_db: float | None  # None for identical images
    ssim: float | None  # None for images with a side below SSIM_WINDOW
    max_error: float  # of one channel of one pixel, 0 … 1

    @property
    def identical(self) -> bool:
        return self.max_error == 0


def difference(image: np.ndarray, reference: np.ndarray, name: str = "image") -> Difference:
    """Compare uint8 images [H, W, 3]; InputError, naming `name`, if their sizes differ."""
    if image.shape != reference.shape:
        (h, w), (rh, rw) = image.shape[:2], reference.shape[:2]
        raise InputError(f"{name}: size {w}x{h} differs from the first image's {rw}x{rh}")
    mse = mean_squared_error(image / LEVELS, reference / LEVELS)
    ssim = None
    if min(image.shape[:2]) >= SSIM_WINDOW:
        ssim = float(
            structural_similarity(
                image, reference, channel_axis=2, data_range=LEVELS,
                gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
            )
        )  # fmt: skip
    return Difference(
        psnr_db=float(-10 * np.log10(mse)) if mse else None,
        ssim=ssim,
        max_error=float(channel_error(image, reference).max() / LEVELS),
    )


def channel_error(image: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Largest absolute difference of the three channels, [H, W], 0 … 255."""
    return np.abs(image.astype(np.int16) - reference.astype(np.int16)).max(axis=2)
