"""Bounds on the error of pictures."""

from splatcore.model.generate.hard import HARD

BOUND = 52.0
"""PSNR, dB, that golden pictures reach at least, against the reference on the same packed model."""

HARMONICS = [name for name, case in HARD.items() if case(0).packing_db is not None]
"""The hard cases that bound what packing loses: those of harmonics."""
