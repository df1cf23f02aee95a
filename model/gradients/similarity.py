"""Structural similarity as a loss, with its gradient."""

import numpy as np
import torch
from numba import njit, prange

SSIM_SHARE = 0.2  # of the loss on photographs; the rest is L1 (Kerbl et al. 2023).

SIGMA, RADIUS = 1.5, 5
C1, C2 = 0.01**2, 0.03**2  # of Wang et al. 2004, for values 0 … 1.

WINDOW = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * SIGMA**2))
WINDOW /= WINDOW.sum()


def photograph_loss(picture: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """0.8·L1 + 0.2·(1 − SSIM) of images [H, W, 3]."""
    absolute = (picture - wanted).abs().mean()
    return (1 - SSIM_SHARE) * absolute + SSIM_SHARE * (1 - ssim(picture, wanted))


def ssim(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Mean structural similarity (Wang et al. 2004) of images [H, W, 3], zeros beyond the edge."""
    a, b = (image.permute(2, 0, 1) for image in (first, second))
    means = blur(torch.cat([a, b, a * a, b * b, a * b]))
    mean_a, mean_b, square_a, square_b, product = means.split(3)
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a * mean_a + square_b - mean_b * mean_b
    above = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    below = (mean_a * mean_a + mean_b * mean_b + C1) * (variance + C2)
    return (above / below).mean()


def blur(planes: torch.Tensor) -> torch.Tensor:
    """Planes [P, H, W] blurred by the window, zeros beyond the edge."""
    if planes.is_cuda:
        window = planes.new_tensor(WINDOW)
        planes = torch.nn.functional.conv2d(
            planes[:, None], window.reshape(1, 1, 1, -1), padding=(0, RADIUS)
        )
        window = window.reshape(1, 1, -1, 1)
        return torch.nn.functional.conv2d(planes, window, padding=(RADIUS, 0))[:, 0]
    return _Blur.apply(planes)


class _Blur(torch.autograd.Function):
    """On a CPU torch's convolution of single channels takes a hundred times as long."""

    @staticmethod
    def forward(context, planes):
        array = planes.detach().numpy()
        return torch.from_numpy(_blurred(array, WINDOW.astype(array.dtype)))

    @staticmethod
    def backward(context, gradient):
        """The window is symmetric: blurring is its own transpose."""
        gradient = np.ascontiguousarray(gradient.numpy())
        return torch.from_numpy(_blurred(gradient, WINDOW.astype(gradient.dtype)))


@njit(parallel=True, cache=True)
def _blurred(planes, window):
    count, height, width = planes.shape
    result = np.empty_like(planes)
    for plane in prange(count):
        down = np.zeros((height, width), planes.dtype)
        for y in range(height):
            for k in range(-RADIUS, RADIUS + 1):
                if 0 <= y + k < height:
                    for x in range(width):
                        down[y, x] += window[k + RADIUS] * planes[plane, y + k, x]
        padded = np.zeros(width + 2 * RADIUS, planes.dtype)
        for y in range(height):
            padded[RADIUS : RADIUS + width] = down[y]
            row = np.zeros(width, planes.dtype)
            for k in range(2 * RADIUS + 1):
                for x in range(width):
                    row[x] += window[k] * padded[x + k]
            result[plane, y] = row
    return result
