"""Blocks that marking cannot leave out, of lanes in quads: what each visit does to a quad's level.

A visit depends on the order of splats alone, not on cycles, so that it is found beforehand.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.golden import setup
from splatcore.golden.pipeline import Frame
from splatcore.spec.config import Config
from splatcore.spec.group import group_grid
from splatcore.spec.native import Library
from splatcore.spec.quads import QUADS, ended_level, quad_pixels
from splatcore.spec.raster import BLOCKS, POWER_SHIFTS, power_table

BLOCKS_A_TILE = BLOCKS**2
QUAD_BITS = 4  # bits of a visit's number for each quad
NOT_SEEN = POWER_SHIFTS
"""Halvings of a quad in which no pixel has alpha ≥ 1/255."""

UNSEEN = sum(NOT_SEEN << QUAD_BITS * quad for quad in range(QUADS))
"""A visit's halvings if no quad is seen."""

MARK_BITS = 4  # bits of a pair's number for each block
LATE = 200  # entries behind a group's last live pixel that hardware may still take

LIBRARY = Library(
    Path(__file__).with_name("visits.cpp"),
    {
        "QUADS": QUADS, "QUAD_BITS": QUAD_BITS, "MARK_BITS": MARK_BITS, "NOT_SEEN": NOT_SEEN,
        "LATE": LATE, "QUAD_PIXELS": sum(map(tuple, map(quad_pixels, range(QUADS))), ()),
    },
    {},
    setup.LIBRARY,
)  # fmt: skip

_trace = LIBRARY.function(
    "trace", int, np.int64, np.int64, np.int64, setup.PREPARED, setup.MACHINE, setup.LEVEL, int,
    np.int32, np.int64, np.int64, np.uint16, np.uint16, result=int,
)  # fmt: skip


class Visits(NamedTuple):
    """The pairs of a frame's entries and tiles, and their visits by block."""

    marks: np.ndarray  # [pairs] int64, `MARK_BITS` per block: levels at which it is marked
    first: np.ndarray  # [pairs + 1] a pair's first visit
    halvings: np.ndarray  # [visits] uint16, `QUAD_BITS` per quad: least of its seen pixels
    levels: np.ndarray  # [visits] uint16, `QUAD_BITS` per quad: its level after the visit


def visits(config: Config, frame: Frame) -> Visits:
    """Return the visits of a frame, also of blocks whose pixels have ended."""
    entries, (height, width) = frame.sorted, frame.pixels.shape[:2]
    pairs = int(np.bitwise_count(entries.mask.astype(np.uint64)).sum())
    found = Visits(
        np.zeros(pairs, np.int64), np.zeros(pairs + 1, np.int64),
        *np.empty((2, pairs * BLOCKS_A_TILE), np.uint16),
    )  # fmt: skip
    machine = setup.constants(config)
    columns = group_grid(config, width, height)[1]
    for name, value in {"columns": columns, "width": width, "height": height}.items():
        machine[name] = value
    count = _trace(
        len(entries.start) - 1, entries.start.astype(np.int64), entries.splat.astype(np.int64),
        entries.mask.astype(np.int64), setup.prepare(config, frame.binned.features), machine,
        setup.levels(config, mark_all=False), ended_level(config),
        np.array(power_table(config), np.int32), *found,
    )  # fmt: skip
    return found._replace(halvings=found.halvings[:count], levels=found.levels[:count])
