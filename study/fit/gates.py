"""Gates of the parts that `splatcore fit` sizes: each is synthesised alone for area, and cached.

The logic between these parts (queues, control, memory access: about 150 k of DEFAULT's 900 k
NAND2-equivalents) hardly depends on the fitted fields and is left out.

The search needs differences only. They are linear in a format's bits, in a merge's ways and in the
entries of a sub-sorter of OR-trees, to within a few percent: two small syntheses give the slope,
which is multiplied by the number of parts.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from splatcore.eda.gates.synth import area
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.quads import SHARE, Quad
from splatcore.hdl.stages import PRIMITIVES, STAGES, Build
from splatcore.spec.config import DEFAULT, FORMATS, Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.microprogram import program, projection
from splatcore.spec.number import Float
from splatcore.spec.quads import QUADS
from splatcore.spec.raster import block_count
from splatcore.spec.schedule import pes
from splatcore.spec.sort import index_bits
from splatcore.spec.stages import HALVES

SMALL_ENTRIES = 16
"""Entries of the sub-sorter that is synthesised for the slope; the other has twice as many."""

FEW_BLOCKS = 4
"""Blocks in the memories of lanes synthesised for the slope; they do not change a lane."""


PARTS: dict[str, tuple[Build, Callable[[Config], int]]] = {
    **{name: (STAGES[name], lambda _: 1) for name in HALVES["preprocessing"]},
    "sub_sorter": (PRIMITIVES["sub_sorter"], lambda config: config.sub_sorters),
    **{name: (PRIMITIVES[name], lambda _: 1) for name in ("merge", "prepare", "setup", "mark")},
    "evaluate": (PRIMITIVES["evaluate"], lambda config: config.rasterizers),
}  # fmt: skip
"""Builder and number of each part."""

PARTS_OF_LANES: dict[str, dict[str, tuple[Build, Callable[[Config], int]]]] = {
    "block": {
        "first lane": (
            lambda config: Blend(config, block_count(config), 1), lambda config: config.rasterizers,
        ),
        "lanes": (
            lambda config: Blend(config, block_count(config), 2),
            lambda config: config.rasterizers * (BLOCK**2 - 1),
        ),
    },
    "quads": {"quads": (Quad, lambda config: config.rasterizers // SHARE * QUADS)},
}  # fmt: skip
"""The same by `Config.lanes`. "lanes" is built with two lanes; the gates of "first lane", the part
before it, are subtracted."""


def part_gates(config: Config, progress: Callable[[str], None]) -> dict[str, float]:
    """NAND2-equivalents by part, all instances of a part together.

    progress: called with the name of the next part
    """
    found, first = {}, 0.0
    for name, (build, count) in (PARTS | PARTS_OF_LANES[config.lanes]).items():
        progress(name)
        one = area(build(config))
        found[name] = (one - first if name == "lanes" else one) * count(config)
        first = one
    return found


@cache
def _lane(config: Config) -> float:
    """NAND2-equivalents per lane."""
    one, two = (area(Blend(config, FEW_BLOCKS, lanes)) for lanes in (1, 2))
    return two - one


def _primitive(name: str, **sizes: int) -> Callable[[Config], float]:
    return lambda config: area(PRIMITIVES[name](replace(config, **sizes)))


def _pes(config: Config) -> int:
    """PEs of stages 0 and 1, except those of polynomials."""
    programs = (program("chunk"), program("cull"), program("place"), projection(config))
    return sum(pes(config, one) for one in programs)


Share = tuple[Callable[[Config], float], Callable[[Config], float]]

OF_RASTER: dict[str, Share] = {
    "lane": (
        _lane,
        lambda config: config.rasterizers * BLOCK**2 // (SHARE if config.lanes == "quads" else 1),
    ),
    "evaluate": (_primitive("evaluate"), lambda config: config.rasterizers),
    "mark": (_primitive("mark"), lambda _: 1),
}

SHARES: dict[str, tuple[Share, ...]] = {
    "arithmetic": ((_primitive("multiply_add"), _pes),),
    "sort_digits": (
        (
            _primitive("sub_sorter", sub_sorter_entries=2),
            lambda config: config.sub_sorters * index_bits(config),
        ),
    ),
} | {field: tuple(OF_RASTER[part] for part in format.parts) for field, format in FORMATS.items()}
"""By format: the parts with most of its gates, each with its size and its number in a machine."""


def with_bits(config: Config, field: str, bits: int) -> Config:
    """A machine with a format of `bits` bits.

    bits: fraction bits for `arithmetic`, key bits for `sort_digits`, else the field's value

    The difference between the fraction bits of depth and arithmetic is kept.
    """
    if field == "sort_digits":
        return replace(config, sort_digits=(1,) * bits)
    if field == "arithmetic":
        arithmetic: Float = replace(config.arithmetic, fraction=bits)
        finer = config.depth.fraction - config.arithmetic.fraction
        depth = replace(config.depth, fraction=bits + finer)
        return replace(config, arithmetic=arithmetic, depth=depth)
    return replace(config, **{field: bits})


def bits_of(config: Config, field: str) -> int:
    """Bits of a format, as set by `with_bits`."""
    if field == "sort_digits":
        return config.sort_key_bits
    return config.arithmetic.fraction if field == "arithmetic" else getattr(config, field)


SLOPE_BITS = 2  # bits fewer at which a format's slope is measured


@cache
def _slopes(field: str) -> tuple[float, ...]:
    """NAND2-equivalents per bit of a format, for each of its parts in `SHARES`."""
    narrow = with_bits(DEFAULT, field, bits_of(DEFAULT, field) - SLOPE_BITS)
    return tuple((size(DEFAULT) - size(narrow)) / SLOPE_BITS for size, _ in SHARES[field])


def bit_gates(config: Config, field: str) -> float:
    """NAND2-equivalents per bit of a format in a whole machine."""
    counts = (count(config) for _, count in SHARES[field])
    return sum(slope * count for slope, count in zip(_slopes(field), counts, strict=True))


@cache
def _line(name: str, field: str, values: tuple[int, int], **changes) -> tuple[float, float]:
    """A part's size as a line over a field: its value at 0 and its slope."""
    low, high = (_primitive(name, **{field: value}, **changes)(DEFAULT) for value in values)
    slope = (high - low) / (values[1] - values[0])
    return low - slope * values[0], slope


def sort_gates(config: Config) -> float:
    """NAND2-equivalents of stage 2's sub-sorters and merge."""
    if config.sub_sorter == "trees":
        few = SMALL_ENTRIES, 2 * SMALL_ENTRIES
        constant, slope = _line("sub_sorter", "sub_sorter_entries", few, sub_sorter="trees")
        sorters = config.sub_sorters * (constant + slope * config.sub_sorter_entries)
    else:
        sorters = _primitive("sub_sorter", sub_sorter_entries=config.sub_sorter_entries)(DEFAULT)
    constant, slope = _line("merge", "merge_ways", (DEFAULT.merge_ways // 2, DEFAULT.merge_ways))
    return sorters + constant + slope * config.merge_ways
