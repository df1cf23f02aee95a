"""Presets, the memory layout derived from them, and one table of stages for all models."""

from dataclasses import FrozenInstanceError, fields, replace

import pytest

from splatcore.eda.gates.machine_gates import PARTS
from splatcore.hdl.stages import STAGES, WHOLE
from splatcore.sim.cycles.frame import Cycles
from splatcore.spec import memory
from splatcore.spec.config import DEFAULT, PAPER, PRESETS, TINY
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.counters import counters
from splatcore.spec.error import InputError
from splatcore.spec.number import FP16
from splatcore.spec.preset import find_preset
from splatcore.spec.raster import power_table
from splatcore.spec.stages import BLOCKS, HALVES, NAMES, OF_POINTS


def test_names():
    assert [config.name for config in PRESETS.values()] == list(PRESETS)
    assert find_preset("paper") is PAPER
    with pytest.raises(InputError, match=r"preset 'x': unknown; .*DEFAULT, PAPER, TINY"):
        find_preset("x")


def test_frozen_and_hashable():
    with pytest.raises(FrozenInstanceError):
        DEFAULT.rasterizers = 3
    assert len({DEFAULT, PAPER, TINY, replace(DEFAULT)}) == 3


@pytest.mark.parametrize(
    "field, value",
    [("rasterizers", 3), ("width_max", 0), ("sub_sorter_entries", 1024), ("sort_digits", (3, 4)),
     ("sh_degree", 4), ("group", -1), ("burst", 1), ("sh_index", ((),))],
)  # fmt: skip
def test_impossible_values_are_refused_by_name(field, value):
    with pytest.raises(InputError, match=rf"preset DEFAULT: {field} "):
        replace(DEFAULT, **{field: value})


def test_the_papers_choices():
    assert PAPER.arithmetic == FP16 and PAPER.depth.width == PAPER.sort_key_bits == 15
    assert PAPER.position == "absolute" and PAPER.tile_test == "3sigma"
    assert (PAPER.sub_sorters, PAPER.sub_sorter_entries) == (4, 256)


@pytest.mark.parametrize("config", PRESETS.values(), ids=lambda config: config.name)
def test_memory(config):
    for degree in memory.compact_degrees(config):
        format = memory.model_format(config, degree)
        assert format.codebook_bytes <= min(memory.CODEBOOK_MAX, 8 * 1024)
        assert format.attribute_record.width == memory.ATTRIBUTE_BITS


def test_records_fill_their_words():
    assert (memory.HEADER.width, memory.CHUNK_HEADER.width) == (512, 256)
    assert (memory.COLOUR_ENTRY.width, memory.SH_ENTRY.width) == (64, 128)


@pytest.mark.parametrize("count", [0, 1, 255, 256, 257, 100_000])
def test_layout_is_in_order_and_aligned(count):
    layout = memory.model_format(DEFAULT, 1).layout(count)
    places = [getattr(layout, name) for name in layout.__dataclass_fields__]
    assert places == sorted(places) and all(place % memory.ALIGNMENT == 0 for place in places)
    assert layout.attributes - layout.positions >= count * 45 / 8
    assert layout.colours - layout.attributes >= 16 * count


def test_every_visible_opacity_has_a_code():
    assert memory.OPACITY.decode(memory.OPACITY.encode(0.0)) == 0
    assert 2.0**-memory.OPACITY.max > ALPHA_MIN  # kept Gaussians can reach alpha 1/255


def test_stage_names_agree():
    """Hardware, cycle model, counters and synthesis parts have the stages of one table."""
    blocks = [block for half in BLOCKS.values() for block in half]
    assert [*OF_POINTS, *blocks] == list(STAGES) and [*blocks, "control"] == list(WHOLE)
    assert [field.name for field in fields(Cycles)] == [*NAMES, *HALVES]
    named = [(half, *BLOCKS[half]) for half in HALVES]
    assert list(counters(DEFAULT)) == [name for names in named for name in names]
    assert {part.stage for part in PARTS} == {f"stage {k}" for k in range(4)} | {
        "binning", "control",
    }  # fmt: skip


@pytest.mark.parametrize("bits", range(4, 13))
def test_powers_fit(bits):
    """For all mantissa and step widths, each table entry has its leading bit and is below 1."""
    for steps in range(3, 9):
        table = power_table(replace(DEFAULT, power_mantissa=bits, power_fraction=steps))
        assert len(table) == 1 << steps and list(table) == sorted(table)
        assert 1 << bits - 1 <= table[0] and table[-1] < 1 << bits
