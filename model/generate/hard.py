"""The hard cases by name: small scenes that each sit on a corner where renderers go wrong."""

from splatcore.model.generate import hard_geometry, hard_value  # noqa: F401  # they fill HARD
from splatcore.model.generate.hard_case import HARD, HardCase

__all__ = ["HARD", "HardCase"]
