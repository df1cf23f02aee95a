"""Golden model of binning, second half: entries of groups to bursts of linked lists in memory."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from splatcore.spec.binning import PAGE_BITS, bursts_per_page
from splatcore.spec.config import Config

PAGE_MAX = (1 << PAGE_BITS) - 1


@dataclass(frozen=True, eq=False)
class Lists:
    """The list memory of a frame.

    address [B] (in bursts) and slots [B, burst] of the bursts in their order; page [G] (first one
    of each group that has entries, else 0) and count [G] of all groups; needed: pages.
    """

    address: np.ndarray
    slots: np.ndarray
    page: np.ndarray
    count: np.ndarray
    needed: int


def write_lists(config: Config, group: np.ndarray, slot: np.ndarray, groups: int, pages: int):
    """Lists of entries `slot` [E] (uint64) of groups `group` [E] in `pages` pages of memory."""
    most = len(group) // (config.burst - 1) + groups
    address, slots = np.zeros(most, np.int64), np.zeros((most, config.burst), np.uint64)
    page, count = np.zeros(groups, np.int64), np.zeros(groups, np.int64)
    per_page = bursts_per_page(config)
    written, needed = _write(
        group.astype(np.int64), slot, per_page, pages, address, slots, page, count
    )
    return Lists(address[:written], slots[:written], page, count, needed)


@njit(cache=True)
def _write(group, slot, per_page, pages, address, slots, first, count):
    """Fill bursts, first pages and counts; returns the bursts written and the pages needed."""
    burst = slots.shape[1]
    page, position = np.zeros_like(count), np.zeros_like(count)  # of the next entry
    buffer = np.zeros((len(count), burst), np.uint64)
    written = needed = 0
    for entry in range(len(group)):
        g = group[entry]
        full = position[g] == per_page * burst - 1
        whole = position[g] % burst == burst - 1
        buffer[g, position[g] % burst] = np.uint64(needed) if full else slot[entry]
        if whole:
            if page[g] < pages:
                address[written] = page[g] * per_page + position[g] // burst
                slots[written] = buffer[g]
                written += 1
            buffer[g] = 0
        if full or count[g] == 0:
            page[g], position[g] = needed, 0
            buffer[g, 0] = slot[entry]
            if count[g] == 0:
                first[g] = needed
            needed = min(needed + 1, PAGE_MAX)
        position[g] += 1
        count[g] += 1
    for g in range(len(count)):
        if position[g] % burst and page[g] < pages:
            address[written] = page[g] * per_page + position[g] // burst
            slots[written] = buffer[g]
            written += 1
    return written, needed
