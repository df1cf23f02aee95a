"""Golden model of binning's inner loops, in C++ (`binning.cpp`): the tiles that each splat touches,
in the integers of `spec.binning`, and the lists.
"""

from pathlib import Path

import numpy as np

from splatcore.golden.batches import in_batches
from splatcore.spec import binning
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.native import Library
from splatcore.spec.record import Codes


def _integers(names: str) -> list[tuple[str, type]]:
    return [(name, np.int64) for name in names.split()]


MACHINE = np.dtype(
    _integers(
        "exponent fraction bias width_bits has_sign subnormal screen_exponent slack margin outward "
        "position_bits square compensates group width height"
    )
)
"""Constants of a machine and the image: its arithmetic, and numbers of `spec.binning`."""

SPLAT = np.dtype(_integers("u v half_width half_height radius shear slope lean"))
"""Codes of a splat, in the machine's arithmetic; 0 for those that `splat_record` has not."""

AXIS = np.dtype(_integers("step vast half centre limit pixel shift seen"))
"""One axis of a splat, in units of 2^(step − FINEST) pixels.

step: doublings from the finest unit
vast: the splat covers the whole image
half: half of the splat's width or height
centre: the splat's centre
limit: the last pixel's centre
pixel: units per pixel, 0 if the unit is larger
shift: log2 of the units per tile
seen: the splat's box overlaps the image
"""

OUTLINE = np.dtype(
    [("x", AXIS), ("y", AXIS), *_integers("box shear slope lean normalise between first last")]
)
"""A splat's outline.

x, y: its axes
box: its outline is a box, not an ellipse
shear, slope, lean, normalise: shear', slope', lean and k of `spec.binning`
between: it is between two rows of pixels
first, last: tile rows
"""

ENTRY = np.dtype([(name, np.int32) for name in ("splat", "group", "mask")])

NAMES = "TILE LENGTH_BITS HALF_BITS FINEST STEP_MAX FACTOR_FRACTION GUARD".split()
LIBRARY = Library(
    Path(__file__).with_name("binning.cpp"),
    {name: getattr(binning, name) for name in NAMES} | {"PAGE_MAX": (1 << binning.PAGE_BITS) - 1},
    {"Machine": MACHINE, "Splat": SPLAT, "Axis": AXIS, "Outline": OUTLINE, "Entry": ENTRY},
)

_footprints = LIBRARY.function("footprints", int, SPLAT, MACHINE, int, ENTRY, np.int64, result=int)
_right_ends = LIBRARY.function("right_ends", int, OUTLINE, np.int64, np.int64, MACHINE, np.int64)

ENTRIES_PER_SPLAT = 4
"""Room for entries; a batch with more of them is repeated."""


def machine(config: Config, width: int, height: int) -> np.ndarray:
    """Return `MACHINE` [1] for images of width × height pixels."""
    format, found = config.arithmetic, np.zeros(1, MACHINE)
    values = {
        "exponent": format.exponent, "fraction": format.fraction, "bias": format.bias,
        "width_bits": format.width, "has_sign": format.signed, "subnormal": format.subnormal,
        "screen_exponent": config.screen_exponent, "slack": binning.slack(config),
        "margin": binning.lean_margin(config), "outward": binning.outward(config),
        "position_bits": binning.position_bits(config), "square": config.tile_test == "3sigma",
        "compensates": config.compensates, "group": config.group, "width": width, "height": height,
    }  # fmt: skip
    for name, value in values.items():
        found[name] = value
    return found


def footprints(config: Config, codes: Codes, width: int, height: int):
    """Return entries of `ENTRY` [E] of splats [N], in the hardware's order, and their tile rows
    [N].

    codes: [N] codes of `splat_record`
    width, height: image size, pixels
    """
    constants = machine(config, width, height)

    def of(batch: slice) -> tuple[np.ndarray, np.ndarray]:
        splats = np.zeros(len(codes["u"][batch]), SPLAT)
        for name in SPLAT.names:
            if name in codes:
                splats[name] = codes[name][batch]
        count, rows = ENTRIES_PER_SPLAT * len(splats), np.empty(len(splats), np.int64)
        room = -1
        while room < count:
            room, entries = count, np.empty(count, ENTRY)
            count = _footprints(len(splats), splats, constants, room, entries, rows)
        entries = entries[:count].copy()
        entries["splat"] += batch.start
        return entries, rows

    entries, rows = zip(*in_batches(of, len(codes["u"])), strict=True)
    return np.concatenate(entries), np.concatenate(rows)


def right_ends(
    config: Config, outlines: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the right ends [N] of `OUTLINE` [N] in bands low … high [N]."""
    found = np.empty(len(outlines), np.int64)
    _right_ends(len(outlines), outlines, low, high, machine(config, TILE, TILE), found)
    return found
