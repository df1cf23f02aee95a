"""Work areas: the memory through which a frame's first half passes data to its second half.

The host provides two work areas, `WORK_AREA` bytes apart, which frames take in turn. Each has

    groups' table │ list pages │ features

each beginning at a multiple of `WORK_ALIGNMENT` (`Work`). The scratch memory for sorting long lists
is separate, as only the second half uses it, and so is the image: rows of `STRIDE` bytes. A pixel
is red, green and blue, 8 bits each. If register FORMAT is `RGBA` (machines with `Config.rgba`), a
fourth byte has alpha, 1 − T (`spec.pixel.alpha_code`), and the colour is premultiplied and without
the background, whose registers are ignored.
"""

from dataclasses import dataclass

from splatcore.spec.axi import BEAT, BOUNDARY
from splatcore.spec.binning import PAGE_BITS, groups_max
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from splatcore.spec.sort import AREAS, BUCKETS, half_entries

WORK_ALIGNMENT = BOUNDARY
"""The parts of a work area begin at multiples of this many bytes."""

SLOT = ENTRY_BITS // 8
"""Bytes of an entry in a list, and of a group in the table."""

FEATURE = BEAT
"""Bytes of a splat's features."""

PIXEL, PIXEL_RGBA = 3, 4
"""Bytes of a pixel, and of one with alpha."""

STRIDE_BITS = 16
"""Width of a stride: the bytes from one row of the image to the next."""

STRIDE_ALIGNMENT = 32
"""Rows of the image begin at multiples of this many bytes: beats of the widest port."""


def table_record() -> Record:
    """A group in the table.

    page: its first page
    count: number of entries
    """
    spare = Bits(ENTRY_BITS - PAGE_BITS - COUNT_BITS)
    return Record("table", {"page": Bits(PAGE_BITS), "count": Bits(COUNT_BITS), "reserved": spare})


def page_bytes(config: Config) -> int:
    """Return the bytes of a list page."""
    return config.page * SLOT


@dataclass(frozen=True)
class Work:
    """Byte offsets of the parts of a work area, and its size, for a machine's largest image."""

    groups: int
    lists: int
    features: int
    size: int


def work(config: Config, pages: int, features: int) -> Work:
    """Return a work area for `pages` list pages and `features` features."""
    lists = aligned(groups_max(config) * SLOT)
    found = lists + aligned(pages * page_bytes(config))
    return Work(0, lists, found, found + aligned(features * FEATURE))


def scratch_bytes(config: Config) -> int:
    """Return the bytes of scratch memory, enough to deal lists of any length into buckets."""
    return aligned(AREAS * BUCKETS * half_entries(config) * SLOT)


def aligned(size: int) -> int:
    """Round a size up to a multiple of `WORK_ALIGNMENT`."""
    return -(-size // WORK_ALIGNMENT) * WORK_ALIGNMENT


def pixel_bytes(rgba: bool) -> int:
    """Return the bytes of a pixel, which are also its channels."""
    return PIXEL_RGBA if rgba else PIXEL


def stride(width: int, rgba: bool = False) -> int:
    """Return the minimum bytes from one row of an image to the next."""
    return -(-width * pixel_bytes(rgba) // STRIDE_ALIGNMENT) * STRIDE_ALIGNMENT
