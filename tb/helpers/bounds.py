"""Bounds on the error of pictures."""

from dataclasses import replace

from splatcore.model.generate.hard import HARD
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.raster import faint_rule

BOUND = 52.0
"""PSNR, dB, that golden pictures reach at least, against the reference on the same packed model."""

RULE = replace(SPLATCORE, faint=faint_rule(DEFAULT))
"""The reference's conventions with DEFAULT's rule for what is too faint to be seen."""

HARMONICS = [name for name, case in HARD.items() if case(0).packing_db is not None]
"""The hard cases that bound what packing loses: those of harmonics."""
