"""`Config`: every size and number format of one machine, and the presets.

A sized hardware module takes a `Config` as its only constructor argument; twins, packing and
reports take the same object. Whatever can be computed from other fields is a property here or a
function of `spec.memory`, never a second field.
"""

from dataclasses import dataclass, fields
from typing import Literal

from splatcore.spec.energy import ENERGY, Energy
from splatcore.spec.error import InputError
from splatcore.spec.number import FP16, FP24, Float

KB = 1024
MEMORY_MAX = 120 * KB
"""Bytes of on-chip memory that the paper's design has: the bound for ours."""

CLOCK_HZ = 800_000_000
"""The clock of the paper's design; frames per second are quoted at it."""


@dataclass(frozen=True)
class Config:
    """One machine. Raises InputError, naming the field, for values that cannot be built."""

    name: str = "DEFAULT"

    # What the image may be at most (pixels).
    width_max: int = 1920
    height_max: int = 1080

    # The packed model. `sh_degree` is the highest that the colour program evaluates; index bits
    # are those of each codebook stage, for models of degree 0 and 1 in turn (see `spec.memory`).
    sh_degree: int = 1
    position: Literal["chunk", "absolute"] = "chunk"
    colour_index: tuple[tuple[int, ...], ...] = ((9, 9), (7, 6))
    sh_index: tuple[tuple[int, ...], ...] = ((), (7, 7))

    # Stages 0 and 1: cull and project.
    arithmetic: Float = FP24
    depth: Float = Float(7, 16, signed=False, subnormal=False)
    screen_exponent: int = 0  # stages 0 and 1 measure the screen in units of 2^this pixels
    screen_fraction: int = 5  # bits of a screen coordinate below one pixel
    pe_arrays: int = 1
    pes: int = 6
    depth_interval: bool = False  # cull by z + Δz instead of the centre's z
    culling: Literal["none", "near", "all"] = "all"  # at the near plane; and at the guard band
    skip_zeros: bool = True  # leave out the products with zeros of the Jacobian
    multiply_latency: int = 2  # clock cycles of the units of stages 0 and 1
    add_latency: int = 3
    unary_latency: int = 4  # reciprocal and reciprocal root
    projection_slots: int = 32  # points that wait for their attributes or are being projected

    # Binning: tiles of a splat, entries of groups of tiles, lists in memory.
    tile_test: Literal["exact", "3sigma"] = "exact"
    group: int = 4  # tiles along the side of a group
    burst: int = 4  # list entries written at a time
    page: int = 64  # list entries for which memory is taken at a time

    # Stage 2: sort. Runs of `sub_sorter_entries` are sorted, then merged, `merge_ways` at a time.
    sub_sorters: int = 2
    sub_sorter_entries: int = 128
    sort_digits: tuple[int, ...] = (1,) * 23  # bits of a key, most significant group first
    merge_ways: int = 16

    # Stage 3: rasterize. E = log2(opacity) − Q·log2(e)/2 in fixed point.
    rasterizers: int = 4  # each has 16 lanes, a block's pixels
    exponent_fraction: int = 14  # bits of E's coefficients below the point
    pixel_fraction: int = 12  # bits of E within a block below the point
    power_fraction: int = 6  # bits of E below the point that index the table of 2^x
    power_mantissa: int = 8  # bits of an entry of that table
    transmittance: int = 16  # bits of T, all below the point
    weight: int = 11  # bits of T·alpha, all below the point
    colour_fraction: int = 9  # bits of a splat's colour below the point
    sum_fraction: int = 13  # bits of a pixel's colour below the point
    early_termination: bool = True  # pixels end once too little of T is left

    # Other on-chip memories (bytes).
    codebook: int = 8 * KB

    # What the estimate of power reckons with; the hardware does not depend on it.
    energy: Energy = ENERGY

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            if type(value) is int and value < 0:
                raise self._error(field.name, "is negative")
        for name, low, high in (
            ("width_max", 1, 4096), ("height_max", 1, 4096), ("sh_degree", 0, 1),
            ("pe_arrays", 1, 4), ("pes", 1, 12), ("sub_sorters", 1, 16),
            ("sub_sorter_entries", 2, 512), ("rasterizers", 1, 16),
            ("group", 1, 4), ("burst", 2, 16), ("merge_ways", 2, 16),
        ):  # fmt: skip
            if not low <= getattr(self, name) <= high:
                raise self._error(name, f"is not in {low} … {high}")
        for name, least in (
            ("projection_slots", 8), ("sub_sorter_entries", 2), ("merge_ways", 2), ("group", 1),
            ("rasterizers", 1), ("page", 4), ("burst", 2),
        ):  # fmt: skip
            value = getattr(self, name)
            if value < least or value & (value - 1):
                raise self._error(name, f"is not a power of two from {least} on")
        if not 8 <= self.sort_key_bits <= 24:
            raise self._error("sort_digits", "do not sum to 8 … 24 bits")
        for name in ("colour_index", "sh_index"):
            if len(getattr(self, name)) <= self.sh_degree:
                raise self._error(name, f"says nothing about models of degree {self.sh_degree}")

    def _error(self, field: str, why: str) -> InputError:
        return InputError(f"preset {self.name}: {field} {getattr(self, field)} {why}")

    @property
    def sort_key_bits(self) -> int:
        """Width of a sub-sorter's key."""
        return sum(self.sort_digits)


DEFAULT = Config()
"""The machine that `docs/` describes."""

PAPER = Config(
    name="PAPER",
    position="absolute",
    colour_index=((9,), (9,)),
    sh_index=((), (8,)),
    arithmetic=FP16,
    depth=Float(5, 10, signed=False, overflow="infinity"),
    screen_exponent=5,
    tile_test="3sigma",
    sub_sorters=4,
    sub_sorter_entries=256,
    sort_digits=(3, 4, 4, 4),
)
"""The paper's choices to the letter where it states them: FP16 positions, arithmetic and depth
keys, one codebook stage, 3σ tile bounds; the rest as DEFAULT. Units of 32 pixels keep FP16 within
its range where one has the choice: in pixels, x · focal length overflows beyond 65 scene units."""

TINY = Config(
    name="TINY",
    width_max=64,
    height_max=64,
    group=2,
    sub_sorters=2,
    page=8,
    sub_sorter_entries=16,
    merge_ways=4,
    rasterizers=2,
)
"""Small enough to reach overflow and full states within seconds of simulation."""

PRESETS = {config.name: config for config in (DEFAULT, PAPER, TINY)}


def preset(name: str) -> Config:
    """The preset of that name in any case; InputError lists the names."""
    try:
        return PRESETS[name.upper()]
    except KeyError:
        raise InputError(f"preset '{name}': unknown (there are {', '.join(PRESETS)})") from None
