"""`Config`: every size and number format of one machine, and the presets.

A sized hardware module takes a `Config` as its only constructor argument; golden models, packing
and reports take the same object. Whatever can be computed from other fields is a property here or a
function of `spec.memory`, never a second field. What belongs to a field (its limits, values to try)
is its metadata.
"""

from dataclasses import dataclass, field, fields
from typing import Any, Literal

from splatcore.spec.energy import ENERGY, Energy
from splatcore.spec.error import InputError
from splatcore.spec.number import FP16, FP24, Float

KB = 1024
MEMORY_MAX = 120 * KB
"""Bytes of on-chip memory that the paper's design has: the bound for ours."""

CLOCK_HZ = 800_000_000
"""The clock of the paper's design; frames per second are quoted at it."""


@dataclass(frozen=True)
class Size:
    """Least and largest value of a size; power: powers of two only."""

    low: int
    high: int | None = None
    power: bool = False


@dataclass(frozen=True)
class Format:
    """A number format of stage 3, of so many bits.

    limits: fewest and most bits with which it is built. tried: values beside DEFAULT's for a sweep;
    coarse, fine: those of machines all of whose formats are narrower, or wider. parts: of the
    hardware that take more gates with each bit. bounds, beyond: fields whose bits together are the
    most that it may have, and so many more. in_features: splats in memory have it, too. in_work:
    pixels end later or sooner with it.
    """

    limits: tuple[int, int]
    tried: tuple[int, ...]
    coarse: int
    fine: int
    parts: tuple[str, ...] = ("lane",)
    bounds: tuple[str, ...] = ()
    beyond: int = 0
    in_features: bool = False
    in_work: bool = False


def size(default: int, low: int, high: int | None = None, power: bool = False) -> Any:
    """A field that has a `Size`."""
    return field(default=default, metadata={"about": Size(low, high, power)})


def bits(default: int, **about) -> Any:
    """A field that has a `Format`, of these values."""
    return field(default=default, metadata={"about": Format(**about)})


@dataclass(frozen=True)
class Config:
    """One machine. Raises InputError, naming the field, for values that cannot be built."""

    name: str = "DEFAULT"

    # The image (pixels). Others fit if they have no more groups of tiles (`spec.binning`).
    width_max: int = size(1920, 1, 4096)
    height_max: int = size(1080, 1, 4096)

    # The packed model. `sh_degree` is the highest that the machine evaluates: in small integers
    # beside the projection's array (`spec.colour`), or degree 1 of compact models in the array.
    # Index bits are those of each codebook stage, for compact models of degree 0 and 1 in turn.
    sh_degree: int = size(3, 0, 3)
    colours: Literal["beside", "array"] = "beside"
    position: Literal["chunk", "absolute"] = "chunk"
    colour_index: tuple[tuple[int, ...], ...] = ((9, 9), (7, 6))
    sh_index: tuple[tuple[int, ...], ...] = ((), (7, 7))
    small_models: bool = True  # reads those with half a beat of attributes, too (`spec.small`)

    # Stages 0 and 1: cull and project.
    arithmetic: Float = FP24
    depth: Float = Float(7, 20, signed=False, subnormal=False)  # `spec.depth` says what has it
    screen_exponent: int = 0  # stages 0 and 1 measure the screen in units of 2^this pixels
    screen_fraction: int = 5  # bits of a screen coordinate below one pixel
    pe_arrays: int = size(1, 1, 4)
    pes: int = size(9, 1, 12)
    depth_interval: bool = False  # cull by z + Δz instead of the centre's z
    culling: Literal["none", "near", "all"] = "all"  # at the near plane; and at the guard band
    skip_zeros: bool = True  # leave out the products with zeros of the Jacobian
    antialiasing: bool = True  # see `compensates`
    multiply_latency: int = 2  # clock cycles of the units of stages 0 and 1
    add_latency: int = 3
    unary_latency: int = 4  # reciprocal and reciprocal root
    # Points that wait for their attributes or are being projected.
    projection_slots: int = size(64, 8, power=True)

    # Binning: tiles of a splat, entries of groups of tiles, lists in memory.
    tile_test: Literal["exact", "3sigma"] = "exact"
    group: int = size(4, 1, 4, power=True)  # tiles along the side of a group
    burst: int = size(4, 2, 16, power=True)  # list entries written at a time
    page: int = size(128, 4, power=True)  # list entries for which memory is taken at a time

    # Bits of a beat of the memory port, and of an address.
    port: int = size(256, 128, 256, power=True)
    address_bits: int = size(32, 32, 64, power=True)

    # Stage 2: sort. Runs of `sub_sorter_entries` are sorted, then merged, `merge_ways` at a time.
    # By OR-trees over all entries, digit by digit, or by a cascade of merges.
    sub_sorter: Literal["trees", "cascade"] = "cascade"
    sub_sorters: int = size(1, 1, 16)
    sub_sorter_entries: int = size(128, 2, 512, power=True)
    sort_digits: tuple[int, ...] = (1,) * 23  # bits of a key, most significant group first
    merge_ways: int = size(16, 2, 16, power=True)

    # Stage 3: rasterize. E = log2(opacity) − Q·log2(e)/2 in fixed point.
    rasterizers: int = size(4, 1, 16, power=True)  # each has 16 lanes, a block's pixels
    exponent_fraction: int = bits(  # of E's coefficients below the point
        14, limits=(10, 18), tried=(11, 12, 13, 16), coarse=12, fine=16,
        parts=("evaluate", "mark"),
    )  # fmt: skip
    pixel_fraction: int = bits(  # of E within a block below the point
        12, limits=(6, 16), tried=(8, 10, 14), coarse=10, fine=14,
        parts=("evaluate",), bounds=("exponent_fraction",), beyond=2,
    )  # fmt: skip
    power_fraction: int = bits(  # of E below the point that index the table of 2^x
        6, limits=(3, 8), tried=(4, 5, 7), coarse=5, fine=7,
        parts=("lane", "evaluate"), bounds=("pixel_fraction",),
    )  # fmt: skip
    power_mantissa: int = bits(  # of an entry of that table
        8, limits=(4, 12), tried=(6, 7, 10), coarse=7, fine=10, in_work=True
    )
    transmittance: int = bits(  # of T, all below the point
        16, limits=(10, 20), tried=(12, 14, 18), coarse=14, fine=18, in_work=True
    )
    weight: int = bits(  # of T·alpha, all below the point
        11, limits=(7, 16), tried=(9, 10, 13), coarse=10, fine=13, bounds=("transmittance",)
    )
    colour_fraction: int = bits(  # of a splat's colour below the point
        9, limits=(6, 9), tried=(6, 7, 8), coarse=8, fine=9, in_features=True
    )
    sum_fraction: int = bits(  # of a pixel's colour below the point
        13, limits=(9, 16), tried=(10, 12, 15), coarse=12, fine=15,
        bounds=("colour_fraction", "weight"), beyond=-1,
    )  # fmt: skip
    # What logic is made for; results are the same. gates: a lane weights a colour by multiples of
    # it, made once for all lanes, terms of colour are sums of rows, and counts go up by trees.
    # fpga: these are multiplier blocks and carry chains, which an FPGA has.
    logic: Literal["gates", "fpga"] = "gates"
    early_termination: bool = True  # pixels end once too little of T is left
    # (a, b, c): what is too faint to be seen is left out (`spec.raster`). Nothing for 3DGS's rule.
    faint: tuple[int, ...] = (4, 11, 8)

    # Other on-chip memories (bytes).
    codebook: int = 8 * KB

    # What the estimate of power reckons with; the hardware does not depend on it.
    energy: Energy = ENERGY

    def __post_init__(self):
        for name, value in vars(self).items():
            if type(value) is int and value < 0:
                raise self._error(name, "is negative")
        for name, about in SIZES.items():
            value = getattr(self, name)
            if about.high and not about.low <= value <= about.high:
                raise self._error(name, f"is not in {about.low} … {about.high}")
            if about.power and (value < about.low or value & (value - 1)):
                raise self._error(name, f"is not a power of two from {about.low} on")
        if not 8 <= self.sort_key_bits <= 24:
            raise self._error("sort_digits", "do not sum to 8 … 24 bits")
        if self.colours == "array" and self.sh_degree > 1:
            raise self._error("sh_degree", "is above 1, the highest that colours='array' knows")
        if self.faint:
            if not self.early_termination:
                raise self._error("faint", "ends pixels, which early_termination=False does not")
            if len(self.faint) != 3:
                raise self._error("faint", "is neither three numbers nor none")
            from_, below, ends = self.faint
            if not 1 <= from_ <= ends <= below <= self.transmittance:
                raise self._error("faint", f"is not 1 ≤ a ≤ c ≤ b ≤ {self.transmittance}")
        for name in ("colour_index", "sh_index"):
            if len(getattr(self, name)) <= min(self.sh_degree, 1):
                raise self._error(name, f"says nothing about models of degree {self.sh_degree}")

    def _error(self, field: str, why: str) -> InputError:
        return InputError(f"preset {self.name}: {field} {getattr(self, field)} {why}")

    @property
    def compensates(self) -> bool:
        """Whether it renders antialiased models (`spec.compensation`), too: only with arithmetic
        that saturates and has no subnormal values."""
        arithmetic = self.arithmetic
        fits = not arithmetic.subnormal and arithmetic.overflow == "saturate"
        return self.antialiasing and fits

    @property
    def side_max(self) -> int:
        """Most pixels along a side of an image: as many as `width_max` has bits for."""
        bits = max(self.width_max, self.height_max).bit_length()
        return min((1 << bits) - 1, SIZES["width_max"].high)

    @property
    def sort_key_bits(self) -> int:
        """Width of a sub-sorter's key."""
        return sum(self.sort_digits)


def _about(kind: type) -> dict:
    """Fields of `Config` by name, as far as their metadata is of a kind."""
    found = {field.name: field.metadata.get("about") for field in fields(Config)}
    return {name: about for name, about in found.items() if isinstance(about, kind)}


SIZES: dict[str, Size] = _about(Size)

FORMATS: dict[str, Format] = _about(Format)

DEFAULT = Config()
"""The machine that `docs/` describes."""

PAPER = Config(
    name="PAPER",
    sh_degree=1,
    colours="array",
    small_models=False,
    position="absolute",
    colour_index=((9,), (9,)),
    sh_index=((), (8,)),
    arithmetic=FP16,
    antialiasing=False,
    depth=Float(5, 10, signed=False, overflow="infinity"),
    screen_exponent=5,
    pes=6,
    projection_slots=32,
    tile_test="3sigma",
    faint=(),
    sub_sorter="trees",
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
    page=8,
    port=128,
    sub_sorter_entries=16,
    merge_ways=4,
    rasterizers=2,
)
"""Small enough to reach overflow and full states within seconds of simulation."""

FPGA = Config(
    name="FPGA",
    antialiasing=False,
    port=128,
    pes=4,
    add_latency=4,
    unary_latency=5,
    rasterizers=1,
    logic="fpga",
    sub_sorter_entries=64,
    merge_ways=8,
)
"""DEFAULT's images, models and formats, with as few units as fit into a Lattice LFE5U-85. One
rasterizer takes most of the time, so a frame hardly waits for the few PEs: docs/fpga.md."""

HEADSET = Config(name="HEADSET", width_max=2064, height_max=2208)
"""DEFAULT for one eye of a headset: only the table of groups grows."""

UHD = Config(name="UHD", width_max=3840, height_max=2160)
"""DEFAULT for pictures of 3840×2160."""

PRESETS = {config.name: config for config in (DEFAULT, PAPER, TINY, FPGA, HEADSET, UHD)}
