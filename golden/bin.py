"""Golden model of binning: splats to features, to entries of groups, and to lists in memory."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.footprint import footprints
from splatcore.golden.lists import Lists, write_lists
from splatcore.spec.config import Config
from splatcore.spec.group import (
    depth_keys,
    entry_record,
    extent_codes,
    feature_record,
    group_grid,
    scaled_colours,
    unscaled_colour_format,
)
from splatcore.spec.number import Fixed
from splatcore.spec.point import splat_record
from splatcore.spec.raster import COLOURS as CHANNELS
from splatcore.spec.record import Codes


@dataclass(frozen=True, eq=False)
class Binned:
    """The result of binning a frame's splats.

    kept [K]: the splats that touch a tile, in their order, numbered from 0 from here on; features
    [K]: codes of `feature_record`; group [E] and entries [E], codes of `entry_record`, in the order
    in which the hardware makes them; splat_rows, splat_entries [N]: tile rows that were looked at
    and entries of each splat.
    """

    kept: np.ndarray
    features: Codes
    group: np.ndarray
    entries: Codes
    lists: Lists
    splat_rows: np.ndarray
    splat_entries: np.ndarray

    @property
    def rows(self) -> int:
        """Tile rows that were looked at."""
        return int(self.splat_rows.sum())


def bin_splats(
    config: Config, near_code: int, codes: Codes, width: int, height: int, pages: int
) -> Binned:
    """Splats [N], codes of `splat_record`, on an image of width × height pixels.

    near_code: the near plane's code as a depth; pages: the size of list memory.
    """
    found, rows = footprints(config, codes, width, height)
    kept, number = np.unique(found[:, 0], return_inverse=True)
    _, columns = group_grid(config, width, height)
    group = (found[:, 1] >> 16) * columns + (found[:, 1] & 0xFFFF)
    entries = {
        "key": depth_keys(config, near_code, codes["z"])[found[:, 0]],
        "splat": number.astype(np.uint64),
        "mask": found[:, 2].astype(np.uint64),
    }
    slot = np.zeros((len(group), 8), np.uint8)
    record = entry_record(config)
    slot[:, : record.size] = record.pack(entries)
    groups = int(np.prod(group_grid(config, width, height)))
    lists = write_lists(config, group, slot.view("<u8")[:, 0], groups, pages)
    chosen = {name: code[kept] for name, code in codes.items()}
    counts = np.bincount(found[:, 0], minlength=len(codes["u"]))
    return Binned(kept, features(config, chosen), group, entries, lists, rows, counts)


def features(config: Config, splats: Codes) -> Codes:
    """Codes [K] of `feature_record` of splats with codes [K] of `splat_record`."""
    format, record = config.arithmetic, feature_record(config)
    found = {name: splats[name] for name in ("u", "v", "shear")}
    found |= {name: splats[f"power_{name}"] for name in ("across", "along")}
    for name in ("half_width", "half_height"):
        found[name] = extent_codes(config, splats[name])
    steps = Fixed(record["opacity"].width, 0)
    for name, fixed, field in (
        ("opacity", steps, "attenuation"),
        *((channel, unscaled_colour_format(config), channel) for channel in CHANNELS),
    ):
        value = format.decode(splats[field])
        found[name] = fixed.encode(np.where(np.isnan(value), 0, value))
    for channel in CHANNELS:
        found[channel] = scaled_colours(found[channel].astype(np.int64)).astype(np.uint64)
    return found


def splat_codes(config: Config, values: dict[str, np.ndarray]) -> Codes:
    """Codes of `splat_record` of what `golden.project` gives."""
    found = dict(values)
    for channel in CHANNELS:
        found.setdefault(channel, found.get(f"colour_{channel}"))
    return {name: format.encode(found[name]) for name, format in splat_record(config).fields}
