"""Records between binning, sorting and rasterizing: a group's entries, and splats' features.

A group is a square of `Config.group` × `Config.group` tiles, the unit of lists, sorting and pixel
memory. Groups are numbered row by row, and so are the tiles of a group: bit k of an entry's mask
stands for its tile k.
"""

from dataclasses import replace

import numpy as np

from splatcore.spec.colour import colour_format
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits, Float
from splatcore.spec.point import values
from splatcore.spec.record import Record

SPLAT_BITS = 24
"""Width of a splat's number in its frame."""

ENTRY_BITS = 64
"""Bits of an entry in memory."""

COUNT_BITS = 24
"""Width of a count of entries."""


def group_pixels(config: Config) -> int:
    """Pixels along the side of a group."""
    return TILE * config.group


def group_grid(config: Config, width: int, height: int) -> tuple[int, int]:
    """Rows and columns of groups that cover an image."""
    side = group_pixels(config)
    return -(-height // side), -(-width // side)


def key_format(config: Config) -> Bits:
    """A depth key (`spec.depth`)."""
    return Bits(config.sort_key_bits)


def entry_record(config: Config) -> Record:
    """A splat in a group's list. mask: the tiles of the group that it reaches."""
    splat, mask = Bits(SPLAT_BITS), Bits(config.group**2)
    return Record("entry", {"key": key_format(config), "splat": splat, "mask": mask})


def sorted_record(config: Config) -> Record:
    """An entry after sorting, or (end 1) the mark behind the last one of a group."""
    splat, mask = Bits(SPLAT_BITS), Bits(config.group**2)
    return Record("sorted", {"splat": splat, "mask": mask, "end": Bits(1)})


EXTENT_FRACTION = 6
"""Bits of a splat's half width and half height in its features below the leading one."""


def extent_format(config: Config) -> Float:
    """Half of a splat's width or height, as floats of few bits."""
    return replace(config.arithmetic, fraction=EXTENT_FRACTION, signed=False)


def extent_codes(config: Config, codes: np.ndarray) -> np.ndarray:
    """The next larger ones for codes [N] of half widths or heights."""
    coarser = codes.astype(np.int64) >> (config.arithmetic.fraction - EXTENT_FRACTION)
    largest = (1 << extent_format(config).width) - 1
    return np.minimum(coarser + 1, largest).astype(np.uint64)


def feature_record(config: Config) -> Record:
    """A splat as the rasterizer gets it, lengths in units of 2^`Config.screen_exponent` pixels.

    across and along are the conic's factors times `spec.frame.POWER_SCALE`, so that
    E = −opacity − (dx − shear·dy)²·across − dy²·along; opacity is −log2 of it. Colours are in units
    of 255/256, so that the highest 8 bits of a sum of weighted ones are the pixel's.
    """
    colour, extent = colour_format(config), extent_format(config)
    return Record(
        "feature",
        values(config, "u v across shear along")
        | {"opacity": OPACITY, "red": colour, "green": colour, "blue": colour}
        | {"half_width": extent, "half_height": extent},
    )
