"""The simulated memory: places of models, work areas, scratch memory and images."""

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

BASE = 1 << 28  # address of memory's first byte: what reads or writes at 0 by mistake is found out
GAP = 1 << 12  # bytes between areas that must not be accessed

SPREAD = 0x9E3779B1  # odd, so that its multiples are as many windows, all over the address space

WORK_AREAS = 2
IMAGES = 2

ENTRIES_A_GAUSSIAN, PAGES_A_GROUP = 8, 32
"""List pages that are set apart before it is known how many a frame needs."""

FILL = 1 << 20  # bytes of noise that memory begins with, again and again


@dataclass(frozen=True)
class Areas:
    """The memory of a run. models, images: addresses; pages, features: what the areas hold;
    registers: of frames that have the work areas in turn."""

    models: tuple[int, ...]
    pages: int
    features: int
    registers: tuple[dict[str, int], ...]
    images: tuple[int, ...]
    regions: tuple[Region, ...]
    end: int

    def region(self, name: str) -> Region:
        """The region of that name."""
        return next(region for region in self.regions if region.name == name)

    def read(self, memory: np.ndarray, name: str) -> np.ndarray:
        """The bytes of a region in a run's memory."""
        region = self.region(name)
        return memory[region.at : region.at + region.size]


def place_areas(
    config: Config,
    models: list[PackedModel],
    sizes: list[tuple[int, int]],
    pages: int | None = None,
    features: int | None = None,
) -> Areas:
    """Areas for models and images of these sizes (width, height).

    pages, features: of a work area, instead of what is enough for any frame of the models, or
    (pages) likely to be. Of a machine with addresses of 64 bits each area has a window of its own,
    and so have both parts of work areas that one register is for. InputError if addresses do not
    suffice.
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
    largest = max(stride(width) * height for width, height in sizes)
    images = tuple(add(f"image{k}", largest) for k in range(IMAGES))
    if place > 1 << ADDRESS_BITS:
        raise InputError(f"memory of {place - BASE} bytes: there are addresses of 32 bits only")
    registers = []
    for parts in found.values():
        values = {"LISTS_PAGES": pages, "FEATURES_MAX": features}
        for name, begin in zip(("GROUPS", "LISTS", "FEATURES"), parts, strict=True):
            values |= address_values(config, name, begin)
        registers.append(values | address_values(config, "SCRATCH", scratch))
    first, second = registers
    first["WORK_AREA"] = second["WORK_AREA"] = second["GROUPS"] - first["GROUPS"]
    # Only the upper bits are each work area's own.
    second |= {name: first[name] for name in ("GROUPS", "LISTS", "FEATURES")}
    return Areas(starts, pages, features, tuple(registers), images, tuple(regions), place - GAP)


def make_memory(folder: Path, areas: Areas, models: list[PackedModel], seed: int = 0) -> None:
    """The file of a run's memory: models, and noise everywhere else."""
    noise = np.random.default_rng(seed).integers(0, 256, FILL, np.uint8)
    memory = np.resize(noise, areas.end - BASE)
    for k, model in enumerate(models):
        areas.read(memory, f"model{k}")[:] = model.image
    memory.tofile(folder / MAPPED)
