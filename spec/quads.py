"""Quads of a block's pixels, which lanes blend one by one (`Config.lanes`), and their levels."""

from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.raster import mark_min

QUADS = 4
"""Quads of 2×2 pixels per block, row by row (`Config.lanes`)."""


def quad_pixels(quad: int) -> list[int]:
    """Return a quad's pixels, as numbers in its block, row by row."""
    half = BLOCK // 2
    first = quad // 2 * half * BLOCK + quad % 2 * half
    return [first + row * BLOCK + column for row in range(half) for column in range(half)]


def ended_level(config: Config) -> int:
    """Return the level of a quad whose pixels have all ended, above the levels of `mark_min`."""
    return len(mark_min(config))


def halvings_min(config: Config, level: int) -> int:
    """Return the halvings of alpha (`POWER_SHIFTS`) from which on every pixel of a quad at a level
    of 1 or more skips a splat: alpha < 2^−halvings and T < 2^−(dark + level − 1)."""
    return config.faint.taken - config.faint.dark - level + 1
