"""Bounds on the error of pictures."""

BOUND = 52.0
"""PSNR, dB, that golden pictures reach at least, against the reference on the same packed model."""
