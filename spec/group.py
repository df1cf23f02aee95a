"""Groups of tiles, and the records of their entries between binning, sorting and rasterizing.

A group is a square of `Config.group` × `Config.group` tiles, the unit of lists, sorting and pixel
memory. Groups are numbered row by row, and so are the tiles within a group: bit k of an entry's
mask is tile k of its group.
"""

from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.number import Bits
from splatcore.spec.record import Record

SPLAT_BITS = 24
"""Width of a splat's number within its frame."""

ENTRY_BITS = 64
"""Bits of an entry in memory."""

COUNT_BITS = 24
"""Width of a number of entries."""


def group_pixels(config: Config) -> int:
    """Return the pixels per side of a group."""
    return TILE * config.group


def group_grid(config: Config, width: int, height: int) -> tuple[int, int]:
    """Return the rows and columns of groups that cover an image of width × height pixels."""
    side = group_pixels(config)
    return -(-height // side), -(-width // side)


def key_format(config: Config) -> Bits:
    """A depth key (`spec.depth`)."""
    return Bits(config.sort_key_bits)


def entry_record(config: Config) -> Record:
    """A splat in a group's list.

    key: depth key
    splat: the splat's number
    mask: the tiles of the group that it reaches
    """
    splat, mask = Bits(SPLAT_BITS), Bits(config.group**2)
    return Record("entry", {"key": key_format(config), "splat": splat, "mask": mask})


def sorted_record(config: Config) -> Record:
    """An entry after sorting, or the mark after the last entry of a group.

    splat, mask: as in `entry_record`; 0 in a mark
    end: 1 in a mark
    """
    splat, mask = Bits(SPLAT_BITS), Bits(config.group**2)
    return Record("sorted", {"splat": splat, "mask": mask, "end": Bits(1)})
