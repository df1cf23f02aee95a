"""PSNR: the formula for every comparison of pictures."""

import math


def psnr_of_square(square: float) -> float | None:
    """Return the PSNR in dB for a mean squared error of values 0 … 1; None for error 0."""
    return -10 * math.log10(square) if square else None
