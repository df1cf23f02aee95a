"""PSNR: the one formula, for pictures that are compared in any room."""

import math


def psnr_of_square(square: float) -> float | None:
    """PSNR in dB of values 0 … 1 whose mean squared error is `square`; None for 0."""
    return -10 * math.log10(square) if square else None
