"""Memory map of the simulated machine: models, work areas, scratch memory and images."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from splatcore.sim.machine.script import MAPPED, Region
from splatcore.spec.axi import ADDRESS_BITS, window_bits
from splatcore.spec.binning import PAGE_BITS, groups_max
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import address_values
from splatcore.spec.work import aligned, page_bytes, scratch_bytes, stride, work

BASE = 1 << 28  # address of memory's first byte; not 0, to catch accesses to address 0
GAP = 1 << 12  # inaccessible bytes between areas

SPREAD = 0x9E3779B1  # odd, so its multiples are distinct windows all over the address space

WORK_AREAS = 2
IMAGES = 2

ENTRIES_A_GAUSSIAN, PAGES_A_GROUP = 8, 32
"""Estimate of the list pages that a frame needs."""

FILL = 1 << 20  # bytes of noise, repeated to fill memory


@dataclass(frozen=True)
class Areas:
    """Memory map of a run.

    models, images: their addresses
    pages, features: capacity of a work area
    registers: address registers of a frame, for each work area
    end: address after the last area
    """

    models: tuple[int, ...]
    pages: int
    features: int
    registers: tuple[dict[str, int], ...]
    images: tuple[int, ...]
    regions: tuple[Region, ...]
    end: int

    def region(self, name: str) -> Region:
        """Find a region by name."""
        return next(region for region in self.regions if region.name == name)

    def read(self, memory: np.ndarray, name: str) -> np.ndarray:
        """View of a region's bytes in a run's memory."""
        region = self.region(name)
        return memory[region.at : region.at + region.size]


def place_areas(
    config: Config,
    models: list[PackedModel],
    sizes: list[tuple[int, int]],
    pages: int | None = None,
    features: int | None = None,
) -> Areas:
    """Place the areas for models and images in memory.

    sizes: (width, height) of each image
    pages: list pages of a work area; by default an estimate that is likely to be enough
    features: capacity of a work area; by default enough for any frame of the models
    With 64-bit addresses each area has its own 4 GiB window, except that both work areas share one
    for each of their registers. Raises InputError if the areas exceed the address space.
    """
    count = max([1, *map(len, models)])
    if pages is None:
        pages = -(-count * ENTRIES_A_GAUSSIAN // (config.page - 1))
        pages = min(pages + groups_max(config) * PAGES_A_GROUP, (1 << PAGE_BITS) - 1)
    features = count if features is None else features
    regions, place = [], BASE

    def add(name: str, size: int, writable: bool = True) -> int:
        nonlocal place
        begin, place = place, place + aligned(size) + GAP
        number = SPREAD * (1 + len(regions)) % (1 << window_bits(config))
        address = begin + (number << ADDRESS_BITS)
        regions.append(Region(name, address, size, writable, begin - BASE))
        return address

    starts = tuple(add(f"model{k}", len(model.image), False) for k, model in enumerate(models))
    offsets = work(config, pages, features)
    found = {}
    for k in range(WORK_AREAS):
        found[k] = (
            add(f"groups{k}", offsets.lists - offsets.groups),
            add(f"lists{k}", aligned(pages * page_bytes(config))),
            add(f"features{k}", offsets.size - offsets.features),
        )
    scratch = add("scratch", scratch_bytes(config))
    largest = max(stride(width, config.rgba) * height for width, height in sizes)
    images = tuple(add(f"image{k}", largest) for k in range(IMAGES))
    if place > 1 << ADDRESS_BITS:
        raise InputError(f"memory of {place - BASE} bytes exceeds the 32-bit address space")
    registers = []
    for parts in found.values():
        values = {"LISTS_PAGES": pages, "FEATURES_MAX": features}
        for name, begin in zip(("GROUPS", "LISTS", "FEATURES"), parts, strict=True):
            values |= address_values(config, name, begin)
        registers.append(values | address_values(config, "SCRATCH", scratch))
    first, second = registers
    first["WORK_AREA"] = second["WORK_AREA"] = second["GROUPS"] - first["GROUPS"]
    # Both work areas share the lower bits of the addresses; WORK_AREA is added for the second.
    second |= {name: first[name] for name in ("GROUPS", "LISTS", "FEATURES")}
    return Areas(starts, pages, features, tuple(registers), images, tuple(regions), place - GAP)


def make_memory(folder: Path, areas: Areas, models: list[PackedModel], seed: int = 0) -> None:
    """Write a run's memory file: the models, and noise everywhere else."""
    noise = np.random.default_rng(seed).integers(0, 256, FILL, np.uint8)
    memory = np.resize(noise, areas.end - BASE)
    for k, model in enumerate(models):
        areas.read(memory, f"model{k}")[:] = model.image
    memory.tofile(folder / MAPPED)
