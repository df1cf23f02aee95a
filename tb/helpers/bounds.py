"""Bounds on the error of pictures."""

from dataclasses import replace

from splatcore.model.generate.hard import HARD
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.raster import faint_rule

BOUND = 52.0
"""Minimum PSNR in dB of golden pictures against the reference on the same packed model."""

RULE = replace(SPLATCORE, faint=faint_rule(DEFAULT))
"""The reference's conventions with DEFAULT's faintness rule."""

HARMONICS = [name for name, case in HARD.items() if case(0).packing_db is not None]
"""Hard cases with a bound on the error of packing: harmonics."""
