"""`Config`: every size and number format of one machine, and the presets.

A hardware module with sizes takes a `Config` as its only constructor argument; golden models,
packing and reports take the same object. A quantity that follows from other fields is a property
here or a function of `spec.memory`, never a second field. The metadata of a field holds its limits
and the values to try.
"""

from dataclasses import dataclass, field, fields
from typing import Any, Literal

from splatcore.spec.convention import Faint
from splatcore.spec.energy import ENERGY, Energy
from splatcore.spec.error import InputError
from splatcore.spec.number import FP16, FP24, Float

KB = 1024
"""Bytes per kilobyte."""
MEMORY_MAX = 126 * KB
"""Upper bound for DEFAULT's bytes of on-chip memory; the paper's design has 120 KB."""

CLOCK_HZ = 800_000_000
"""Clock frequency of the paper's design; frames per second are given for it."""


FAINT = Faint(dark=4, taken=11, ends=8)
"""DEFAULT's faintness rule, as powers of two (`Config.faint`)."""


@dataclass(frozen=True)
class Size:
    """Limits of a size."""

    low: int  # smallest value
    high: int | None = None  # largest value, if limited
    power: bool = False  # only powers of two are allowed


@dataclass(frozen=True)
class Format:
    """Number of bits of one number of stage 3."""

    limits: tuple[int, int]  # minimum and maximum number of bits with which it is built
    tried: tuple[int, ...]  # values that a sweep tries in addition to DEFAULT's
    coarse: int  # value of a machine with all formats narrower
    fine: int  # value of a machine with all formats wider
    parts: tuple[str, ...] = ("lane",)  # parts of the hardware that grow with each bit
    bounds: tuple[str, ...] = ()  # the width may not exceed the sum of these fields, plus `beyond`
    beyond: int = 0
    in_features: bool = False  # also the width of the stored feature
    in_work: bool = False  # changes when pixels terminate


def size(default: int, low: int, high: int | None = None, power: bool = False) -> Any:
    """Declare a field with a `Size`."""
    return field(default=default, metadata={"about": Size(low, high, power)})


def bits(default: int, **about) -> Any:
    """Declare a field with a `Format`; about: the fields of `Format`."""
    return field(default=default, metadata={"about": Format(**about)})


@dataclass(frozen=True)
class Config:
    """One machine. Raises InputError, naming the field, for values that cannot be built."""

    name: str = "DEFAULT"

    # Size of the image, pixels. Other shapes with at most as many groups of tiles also fit
    # (`spec.binning.fits`).
    width_max: int = size(1920, 1, 4096)
    height_max: int = size(1080, 1, 4096)

    # The packed model (`spec.memory`).
    sh_degree: int = size(3, 0, 3)  # highest degree of spherical harmonics that is evaluated
    # "beside": colours have integer units of their own, next to the projection's array
    # (`spec.colour`). "array": the array computes them in floats, up to degree 1.
    colours: Literal["beside", "array"] = "beside"
    # "chunk": positions are integers relative to their chunk's origin. "absolute": FP16 floats.
    position: Literal["chunk", "absolute"] = "chunk"
    # Index bits of each stage of the colour codebook and of the SH codebook, for compact models
    # of degree 0 and degree 1.
    colour_index: tuple[tuple[int, ...], ...] = ((9, 9), (7, 6))
    sh_index: tuple[tuple[int, ...], ...] = ((), (7, 7))
    small_models: bool = True  # also renders models with half a beat of attributes (`spec.small`)
    levels: bool = True  # also renders models with levels of detail (`spec.levels`)

    # Stages 0 and 1: cull and project.
    arithmetic: Float = FP24  # all numbers except depths
    depth: Float = Float(7, 20, signed=False, subnormal=False)  # depths and keys (`spec.depth`)
    screen_exponent: int = 0  # unit of length on the screen: 2^screen_exponent pixels
    pe_arrays: int = size(1, 1, 4)  # multiplies `pes`
    pes: int = size(14, 1, 16)  # processing elements of the projection's array
    depth_interval: bool = False  # cull by z + Δz instead of the centre's z
    # Culling before the projection. "near": at the near plane. "all": also at the guard band.
    culling: Literal["none", "near", "all"] = "all"
    skip_zeros: bool = True  # leave out the products with zeros of the Jacobian
    antialiasing: bool = True  # see `compensates`
    multiply_latency: int = 2  # clock cycles of a multiplication
    add_latency: int = 3  # clock cycles of an addition
    unary_latency: int = 4  # clock cycles of a reciprocal or reciprocal square root
    # Points in flight from the request of their attributes to the end of their projection.
    projection_slots: int = size(64, 8, power=True)

    # Binning: tiles of a splat, entries of groups of tiles, lists in memory.
    # "exact": the tiles with alpha ≥ 1/255. "3sigma": the tiles of the original renderer's square.
    tile_test: Literal["exact", "3sigma"] = "exact"
    group: int = size(4, 1, 4, power=True)  # tiles per side of a group
    burst: int = size(4, 2, 16, power=True)  # list entries per write
    page: int = size(128, 4, power=True)  # list entries per page, the unit of allocation

    # The memory port.
    port: int = size(256, 128, 256, power=True)  # bits per beat
    address_bits: int = size(32, 32, 64, power=True)  # bits of a byte address

    # Stage 2: sort. Runs of `sub_sorter_entries` are sorted, then merged, `merge_ways` at a time.
    # "trees": OR-trees over all entries, digit by digit. "cascade": a cascade of merges.
    sub_sorter: Literal["trees", "cascade"] = "cascade"
    sub_sorters: int = size(1, 1, 16)  # number of sub-sorters
    sub_sorter_entries: int = size(128, 2, 512, power=True)  # entries per run
    sort_digits: tuple[int, ...] = (1,) * 23  # bits of each digit of a key, highest digit first
    merge_ways: int = size(16, 2, 16, power=True)  # runs merged at a time

    # Stage 3: rasterize. E = log2(opacity) − Q·log2(e)/2 in fixed point.
    rasterizers: int = size(8, 1, 16, power=True)  # each has a part of the blocks of every tile
    # "block": each rasterizer has 16 lanes, which blend one block at a time. "quads": two share 16
    # lanes, in four sets of 2×2 pixels, each with a queue for either rasterizer.
    lanes: Literal["block", "quads"] = "quads"
    exponent_fraction: int = bits(  # fraction bits of E's coefficients
        14, limits=(10, 18), tried=(11, 12, 13, 16), coarse=12, fine=16,
        parts=("evaluate", "mark"),
    )  # fmt: skip
    pixel_fraction: int = bits(  # fraction bits of a pixel's E
        12, limits=(6, 16), tried=(8, 10, 14), coarse=10, fine=14,
        parts=("evaluate",), bounds=("exponent_fraction",), beyond=2,
    )  # fmt: skip
    power_fraction: int = bits(  # fraction bits of E that index the table of 2^x
        6, limits=(3, 8), tried=(4, 5, 7), coarse=5, fine=7,
        parts=("lane", "evaluate"), bounds=("pixel_fraction",),
    )  # fmt: skip
    power_mantissa: int = bits(  # bits of an entry of that table
        8, limits=(4, 12), tried=(6, 7, 10), coarse=7, fine=10, in_work=True
    )
    transmittance: int = bits(  # fraction bits of T, which has no others
        16, limits=(10, 20), tried=(12, 14, 18), coarse=14, fine=18, in_work=True
    )
    weight: int = bits(  # fraction bits of T·alpha, which has no others
        11, limits=(7, 16), tried=(9, 10, 13), coarse=10, fine=13, bounds=("transmittance",)
    )
    colour_fraction: int = bits(  # fraction bits of a splat's colour
        9, limits=(6, 9), tried=(6, 7, 8), coarse=8, fine=9, in_features=True
    )
    sum_fraction: int = bits(  # fraction bits of a pixel's colour
        13, limits=(9, 16), tried=(10, 12, 15), coarse=12, fine=15,
        bounds=("colour_fraction", "weight"), beyond=-1,
    )  # fmt: skip
    # Target of the logic; results are the same. "gates": multiples of a colour are computed once
    # and shared by all lanes, terms of colour are sums of rows, and counters are trees. "fpga":
    # multiplier blocks and carry chains, which an FPGA has, replace these.
    logic: Literal["gates", "fpga"] = "gates"
    early_termination: bool = True  # a pixel ends when T is below a threshold
    # Faintness rule (`spec.raster`): the thresholds are 2^−dark, 2^−taken, 2^−ends. Three numbers
    # become a `Faint`; () is 3DGS's rule.
    faint: Faint | tuple[()] = FAINT
    rgba: bool = False  # also writes images with alpha: register FORMAT, `spec.work`

    codebook: int = 8 * KB  # bytes of the codebook memory on chip

    energy: Energy = ENERGY  # constants of the power estimate; the hardware does not depend on them

    def __post_init__(self):
        for name, value in vars(self).items():
            if type(value) is int and value < 0:
                raise self._error(name, "is negative")
        for name, about in SIZES.items():
            value = getattr(self, name)
            if about.high and not about.low <= value <= about.high:
                raise self._error(name, f"is not in {about.low} … {about.high}")
            if about.power and (value < about.low or value & (value - 1)):
                raise self._error(name, f"is not a power of two ≥ {about.low}")
        if not 8 <= self.sort_key_bits <= 24:
            raise self._error("sort_digits", "do not sum to 8 … 24 bits")
        if self.lanes == "quads" and (self.rasterizers < 2 or self.logic == "fpga"):
            raise self._error("lanes", "needs two rasterizers and logic 'gates'; 'block' does not")
        if self.levels and self.position == "absolute":
            raise self._error("levels", "needs positions of the kind 'chunk'")
        if self.colours == "array" and self.sh_degree > 1:
            raise self._error("sh_degree", "is above 1, the highest degree of colours='array'")
        if self.faint:
            if not self.early_termination:
                raise self._error("faint", "ends pixels, but early_termination is False")
            if len(self.faint) != 3:
                raise self._error("faint", "has neither three numbers nor none")
            object.__setattr__(self, "faint", rule := Faint(*self.faint))
            if not 1 <= rule.dark <= rule.ends <= rule.taken <= self.transmittance:
                raise self._error("faint", f"is not 1 ≤ dark ≤ ends ≤ taken ≤ {self.transmittance}")
        for name in ("colour_index", "sh_index"):
            if len(getattr(self, name)) <= min(self.sh_degree, 1):
                raise self._error(name, f"has no entry for degree {min(self.sh_degree, 1)}")

    def _error(self, field: str, why: str) -> InputError:
        return InputError(f"preset {self.name}: {field} {getattr(self, field)} {why}")

    @property
    def compensates(self) -> bool:
        """Whether it also renders antialiased models (`spec.compensation`).

        Requires arithmetic that saturates and has no subnormal values.
        """
        arithmetic = self.arithmetic
        fits = not arithmetic.subnormal and arithmetic.overflow == "saturate"
        return self.antialiasing and fits

    @property
    def side_max(self) -> int:
        """Maximum pixels per side of an image: the largest value with the bits of `width_max`."""
        bits = max(self.width_max, self.height_max).bit_length()
        return min((1 << bits) - 1, SIZES["width_max"].high)

    @property
    def sort_key_bits(self) -> int:
        """Width of a sub-sorter's key."""
        return sum(self.sort_digits)


def _about(kind: type) -> dict:
    """Return the fields of `Config` with metadata of a kind: name → metadata."""
    found = {field.name: field.metadata.get("about") for field in fields(Config)}
    return {name: about for name, about in found.items() if isinstance(about, kind)}


SIZES: dict[str, Size] = _about(Size)
"""Limits of the fields that are sizes, by name."""

FORMATS: dict[str, Format] = _about(Format)
"""Number formats of stage 3, by name."""

DEFAULT = Config()
"""The machine described in `docs/`."""

PAPER = Config(
    name="PAPER",
    sh_degree=1,
    colours="array",
    small_models=False,
    levels=False,
    position="absolute",
    colour_index=((9,), (9,)),
    sh_index=((), (8,)),
    arithmetic=FP16,
    antialiasing=False,
    depth=Float(5, 10, signed=False, overflow="infinity"),
    screen_exponent=5,
    pes=6,
    projection_slots=32,
    rasterizers=4,
    lanes="block",
    tile_test="3sigma",
    faint=(),
    sub_sorter="trees",
    sub_sorters=4,
    sub_sorter_entries=256,
    sort_digits=(3, 4, 4, 4),
)
"""The paper's choices, exactly where it states them: FP16 positions, arithmetic and depth keys, one
codebook stage, 3σ tile bounds; the rest as in DEFAULT. Where the paper leaves the choice, units of
32 pixels keep FP16 within its range: in pixels, x · focal length overflows beyond 65 scene units.
"""

TINY = Config(
    name="TINY",
    width_max=64,
    height_max=64,
    group=2,
    page=8,
    port=128,
    sub_sorter_entries=16,
    merge_ways=4,
    pes=9,
    rasterizers=2,
    lanes="block",
)
"""Small enough to reach overflow and full states within seconds of simulation."""

SMALL = Config(name="SMALL", port=128, pes=7, rasterizers=4)
"""DEFAULT with half of the lanes, half of the port and a Gaussian every 8 cycles."""

FPGA = Config(
    name="FPGA",
    antialiasing=False,
    port=128,
    pes=4,
    add_latency=4,
    unary_latency=5,
    rasterizers=1,
    lanes="block",
    logic="fpga",
    sub_sorter_entries=64,
    merge_ways=8,
)
"""DEFAULT's images, models and formats, with as few units as fit into a Lattice LFE5U-85.

The single rasterizer takes most of the time, so the few PEs hardly delay a frame: docs/fpga.md.
"""

HEADSET = Config(name="HEADSET", width_max=2064, height_max=2208)
"""DEFAULT for one eye of a headset; only the table of groups is larger."""

UHD = Config(name="UHD", width_max=3840, height_max=2160)
"""DEFAULT for images of 3840×2160 pixels."""

PRESETS = {config.name: config for config in (DEFAULT, SMALL, PAPER, TINY, FPGA, HEADSET, UHD)}
"""Built-in presets by name."""
