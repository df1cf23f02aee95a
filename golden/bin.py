"""Golden model of binning: splats to features, to entries of groups, to lists in memory."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.arithmetic import convert, to_fixed
from splatcore.golden.batches import in_batches
from splatcore.golden.footprint import LIBRARY, footprints
from splatcore.spec import feature
from splatcore.spec import group as records
from splatcore.spec.binning import PAGE_BITS, bursts_per_page
from splatcore.spec.colour import CHANNELS, scaled_colours, unscaled_colour_format
from splatcore.spec.config import Config
from splatcore.spec.depth import depth_keys
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Fixed
from splatcore.spec.record import Codes

PAGE_MAX = (1 << PAGE_BITS) - 1
"""Largest number of a page."""

_integers, _words = np.dtype(np.int64), np.dtype(np.uint64)
_write_lists = LIBRARY.function(
    "write_lists", int, _integers, _words, _integers, _integers, _words, _integers, _integers,
    _integers, result=int,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Lists:
    """The list memory of a frame."""

    address: np.ndarray  # [B] bursts' addresses in list memory, in bursts, in the order of writing
    slots: np.ndarray  # [B, burst] uint64, their entries
    page: np.ndarray  # [G] first page of each group, 0 if its list is empty
    count: np.ndarray  # [G] entries of each group
    needed: int  # pages that the lists need, even if memory has fewer


@dataclass(frozen=True, eq=False)
class Binned:
    """The result of binning a frame's splats. A splat's number is its place in `kept`."""

    kept: np.ndarray  # [K] indices of the splats that touch a tile, in their order
    features: Codes  # [K] of `feature_record`
    group: np.ndarray  # [E] group of each entry, in the hardware's order
    entries: Codes  # [E] of `entry_record`, in the same order
    lists: Lists
    splat_rows: np.ndarray  # [N] tile rows visited for each splat
    splat_entries: np.ndarray  # [N] entries of each splat

    @property
    def rows(self) -> int:
        """Tile rows visited."""
        return int(self.splat_rows.sum())


def bin_splats(config: Config, codes: Codes, width: int, height: int, pages: int) -> Binned:
    """Bin the splats of a frame.

    codes: [N] codes of `splat_record`
    width, height: image size, pixels
    pages: pages of list memory
    """
    found, rows = footprints(config, codes, width, height)
    counts = np.bincount(found["splat"], minlength=len(codes["u"]))
    kept, number = np.flatnonzero(counts), np.cumsum(counts > 0) - 1
    group = found["group"].astype(np.int64)
    entries = {
        "key": keys(config, codes)[found["splat"]],
        "splat": number[found["splat"]].astype(np.uint64),
        "mask": found["mask"].astype(np.uint64),
    }
    slot = np.zeros((len(group), 8), np.uint8)
    record = records.entry_record(config)
    slot[:, : record.size] = record.pack(entries)
    groups = int(np.prod(records.group_grid(config, width, height)))
    lists = write_lists(config, group, slot.view("<u8")[:, 0], groups, pages)

    def some(batch: slice) -> Codes:
        return features(config, {name: code[kept[batch]] for name, code in codes.items()})

    parts = in_batches(some, len(kept))
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return Binned(kept, found, group, entries, lists, rows, counts)


def keys(config: Config, codes: Codes) -> np.ndarray:
    """Return the depth keys [N] of splats, from codes [N] of `splat_record`."""
    low = codes.get("z_low", np.zeros_like(codes["z"]))  # if depths are not finer
    return depth_keys(config, codes["z"], low)


def features(config: Config, splats: Codes) -> Codes:
    """Return codes [K] of `feature_record`, from codes [K] of `splat_record`."""
    format, unit = config.arithmetic, config.screen_exponent
    u, v = (format.decode(splats[name]) for name in "uv")
    found = feature.centre_codes(np.ldexp(u, unit), np.ldexp(v, unit))
    found["shear"] = convert(format, feature.SHEAR, splats["shear"])
    for name in ("across", "along"):
        scale = feature.FACTOR_SCALE - 2 * unit
        found[name] = convert(format, feature.FACTOR, splats[f"power_{name}"], scale)
    found["opacity"] = to_fixed(format, Fixed(OPACITY.width, 0), splats["attenuation"])
    unscaled = unscaled_colour_format(config)
    for channel in CHANNELS:
        codes = splats[channel]
        if config.colours == "array":
            codes = to_fixed(format, unscaled, codes)
        codes = feature.short_colours(config, scaled_colours(codes.astype(np.int64)), np.where)
        found[channel] = codes.astype(np.uint64)
    return found


def write_lists(config: Config, group: np.ndarray, slot: np.ndarray, groups: int, pages: int):
    """Write the lists of all groups.

    group: [E] group of each entry
    slot: [E] uint64, entries as stored in memory
    groups: number of groups
    pages: pages of list memory
    Returns `Lists`.
    """
    most = len(group) // (config.burst - 1) + groups
    address, slots = np.zeros(most, np.int64), np.zeros((most, config.burst), np.uint64)
    page, count = np.zeros(groups, np.int64), np.zeros(groups, np.int64)
    per_page = bursts_per_page(config)
    sizes, needed = np.array([groups, per_page, pages, config.burst]), np.zeros(1, np.int64)
    about = group.astype(np.int64), slot, sizes, address, slots, page, count, needed
    written = _write_lists(len(group), *about)
    return Lists(address[:written], slots[:written], page, count, int(needed[0]))
