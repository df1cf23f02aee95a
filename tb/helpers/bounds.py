"""Bounds on the error of pictures."""

BOUND = 52.0
"""dB that every picture must reach (design's figures)."""
