"""Bin: splats in; features, bursts of lists and the table of groups out, frame after frame.

Full: the lists need more pages than there are. Tie: equal depths, as keys; order is kept.
"""

from functools import partial

import numpy as np

from splatcore.spec.config import TINY
from splatcore.spec.record import Codes
from tb.helpers.bin_frames import BinFrames, Frame, bin_frame, rows_in, rows_out
from tb.helpers.bin_splats import KINDS, splats, together
from tb.helpers.feeds import Feed

NEAR = int(TINY.arithmetic.encode(0.2))
SIZE = TINY.width_max, TINY.height_max
EACH = 8  # splats of each kind

component = partial(BinFrames, TINY)


def cases() -> dict[str, Feed]:
    mixed = together(*(splats(TINY, kind, EACH, SIZE) for kind in KINDS))
    tied = together(*(splats(TINY, kind, EACH, SIZE) for kind in ("common", "huge")))
    none = {name: codes[:0] for name, codes in mixed.items()}
    pages = bin_frame(TINY, Frame(mixed, *SIZE)).lists.needed
    return {
        "empty": feed(Frame(none, 17, 16)),
        "full": feed(Frame(mixed, *SIZE, pages // 2)),
        "tie": feed(Frame(tied | {"z": np.full_like(tied["z"], NEAR + 1)}, 61, 35)),
        "saturated": feed(Frame(largest(tied), *SIZE)),
    }


def feed(frame: Frame) -> Feed:
    expected = rows_out(TINY, [bin_frame(TINY, frame)])
    return Feed(rows_in(TINY, [frame]), expected)


def largest(codes: Codes) -> Codes:
    """The same splats with the largest depths and sizes of the format."""
    most = int(TINY.arithmetic.encode(TINY.arithmetic.max))
    names = ("z", "half_width", "half_height")
    return codes | {name: np.full_like(codes[name], most) for name in names}
