"""Presets, built-in and from files: impossible values are refused with file and key; the memory
layout derived from them, and one table of stages for all models."""

import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from splatcore.eda.gates.machine_gates import PARTS
from splatcore.hdl.stages import STAGES, WHOLE
from splatcore.sim.common.preset_file import preset_text, write_preset
from splatcore.sim.cycles.frame import Cycles
from splatcore.spec import memory
from splatcore.spec.config import DEFAULT, FORMATS, PAPER, PRESETS, TINY, Config
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.counters import counters
from splatcore.spec.energy import Energy
from splatcore.spec.error import InputError
from splatcore.spec.number import FP16, FP24, Float
from splatcore.spec.preset import EXPONENT_BITS, FRACTION_BITS, check_buildable, find_preset
from splatcore.spec.raster import power_table
from splatcore.spec.stages import BLOCKS, HALVES, NAMES, OF_POINTS
from tb.helpers.command import ROOT, run
from tb.helpers.refusal import refused

POWERS = (1, 2, 4, 8, 16)
FIELDS = {
    "address_bits": st.sampled_from([32, 64]),
    "width_max": st.integers(1, 4096), "sh_degree": st.integers(0, 1), "pes": st.integers(2, 16),
    "position": st.sampled_from(["chunk", "absolute"]), "early_termination": st.booleans(),
    "faint": st.sampled_from([(), (5, 11, 9), (1, 2, 2)]),
    "rasterizers": st.sampled_from(POWERS), "sub_sorters": st.integers(1, 16),
    "sort_digits": st.lists(st.integers(1, 4), min_size=1, max_size=24).map(tuple),
    "arithmetic": st.builds(
        Float, st.integers(*EXPONENT_BITS), st.integers(*FRACTION_BITS), st.just(True),
        st.booleans(), st.sampled_from(["saturate", "infinity"]),
    ) | st.sampled_from([FP16, FP24]),
    "depth": st.builds(Float, st.integers(2, 10), st.integers(1, 52), st.booleans()),
    "energy": st.builds(Energy, supply=st.floats(0, 9), memory_words=st.integers(1, 99)),
    "colour_index": st.sampled_from([((9,), (9,)), ((9, 9), (7, 6)), ((8, 7), (7, 5))]),
} | {name: st.integers(*format.limits) for name, format in FORMATS.items()}  # fmt: skip


@st.composite
def machines(draw) -> tuple[Config, Config]:
    """Draw a base preset, and a buildable machine derived from it."""
    base = draw(st.sampled_from(list(PRESETS.values())))
    chosen = draw(st.lists(st.sampled_from(sorted(FIELDS)), unique=True))
    try:
        config = replace(base, name="some-1_A", **{name: draw(FIELDS[name]) for name in chosen})
        check_buildable(config)
    except InputError:
        assume(False)
    return base, config


@settings(max_examples=200, deadline=None)
@given(machines())
def test_round_trip(tmp_path_factory, pair):
    base, config = pair
    path = tmp_path_factory.getbasetemp() / "machine.toml"
    write_preset(path, config, base, {"pes": "two\nlines # and a mark"}, about="head\nof two lines")
    assert find_preset(str(path)) == config


def test_file_holds_differences_with_their_reasons():
    config = replace(DEFAULT, name="small", pes=3, arithmetic=FP16)
    text = preset_text(config, DEFAULT, {"pes": "three\nwill do", "rasterizers": "no matter"})
    assert text.split("\n") == [
        'base = "DEFAULT"', 'name = "small"', "", 'arithmetic = "FP16"', "", "# three will do",
        "pes = 3", "",
    ]  # fmt: skip


def write(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_files(tmp_path):
    path = write(tmp_path / "my machine.toml", "rasterizers = 2")
    assert find_preset(path) == replace(DEFAULT, name="my_machine", rasterizers=2)
    text = 'base = "tiny"\nname = "mine"\ndepth = "FP16"\nenergy = { supply = 1 }'
    path = write(tmp_path / "x", text)
    assert find_preset(path) == replace(TINY, name="mine", depth=FP16, energy=Energy(supply=1.0))


@pytest.mark.parametrize(
    "text, error",
    [
        ("rasterizers = ", "is not TOML: "),
        ("a = " + "[" * 2000, "is not TOML: "),
        ("rasterisers = 2", "unknown key 'rasterisers'; did you mean 'rasterizers'?"),
        ("xyz = 2", "unknown key 'xyz' (known: base, name, width_max, "),
        ('base = "MINE"', f"base 'MINE' is unknown; choose one of {', '.join(PRESETS)}"),
        ("base = 1", "base 1 is unknown"),
        ("rasterizers = 2.0", "rasterizers: 2.0 is not an integer"),
        ('energy = { supply = "high" }', "energy.supply: 'high' is not a number"),
        ("rasterizers = true", "rasterizers: True is not an integer"),
        ("skip_zeros = 1", "skip_zeros: 1 is not true or false"),
        ("name = 1", "name: 1 is not a string"),
        ('name = "a/../b"', "name 'a/../b' may only have letters, digits, _ and -"),
        ('name = "a\\nb"', "may only have letters"),
        ('name = "default"', "name 'default' is the name of a built-in preset"),
        ('position = "there"', "position: 'there' is not one of chunk, absolute"),
        ("sort_digits = 3", "sort_digits: 3 is not an array"),
        ("sort_digits = [3, true]", "sort_digits[1]: True is not an integer"),
        ("sh_index = [1]", "sh_index[0]: 1 is not an array"),
        ('arithmetic = "FP17"', "arithmetic: 'FP17' is not a table of Float's fields nor one of"),
        ("arithmetic = { exponent = 7 }", "arithmetic: 'fraction' is missing"),
        ("depth = { exponent = 7, bits = 3 }", "depth: unknown key 'bits'"),
        ("depth = { exponent = 1, fraction = 3 }", "depth: Float("),
        ("rasterizers = 3", "rasterizers 3 is not a power of two"),
        ("width_max = 5000", "width_max 5000 is not in 1 … 4096"),
        ("address_bits = 40", "address_bits 40 is not a power of two ≥ 32"),
        ("address_bits = 128", "address_bits 128 is not in 32 … 64"),
        ("sum_fraction = 8", "sum_fraction 8 is not in 9 … 16"),
        ("arithmetic = { exponent = 7, fraction = 30 }", "arithmetic's fraction 30 is not in"),
        ("arithmetic = { exponent = 7, fraction = 10, signed = false }",
         "arithmetic must be signed"),
        ("exponent_fraction = 10\npixel_fraction = 13", "pixel_fraction 13 is above 12"),
        ("pixel_fraction = 6\npower_fraction = 7", "power_fraction 7 is above 6"),
        ("transmittance = 10", "ends=8) is not 1 ≤ dark ≤ ends ≤ taken ≤ 10"),
        ("transmittance = 10\nfaint = []", "weight 11 is above 10, the limit set by"),
        ("weight = 7\ncolour_fraction = 6", "sum_fraction 13 is above 12"),
        ("page = 4\nburst = 8", "burst 8 is above 4"),
        ("pes = 1", "pes 1 in 1 arrays are fewer than 2"),
        ("codebook = 100", "codebook 100 bytes are below"),
        ("colour_index = [[20, 20], [9]]", "colour_index or sh_index do not fit"),
    ],
)  # fmt: skip
def test_errors_name_file_and_key(tmp_path, text, error):
    path = write(tmp_path / "bad.toml", text)
    with pytest.raises(InputError, match=rf"^{re.escape(path)}: .*{re.escape(error)}") as found:
        find_preset(path)
    assert "\n" not in str(found.value) or "not TOML" in error


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for path, error in ((tmp_path, "directory"), (tmp_path / "bytes.toml", "is not UTF-8 text"),
                        (tmp_path / "none.toml", "No such file")):  # fmt: skip
        refused(rf"{path}: .*{error}", find_preset, str(path))


def test_commands_take_files(tmp_path, capsys):
    path = write(tmp_path / "wide.toml", "pe_arrays = 2")
    facts = tmp_path / "facts.json"
    assert run("memories", "--preset", path, "--json", facts) == 0
    assert '"preset": "wide"' in facts.read_text()
    assert run("memories", "--preset", write(tmp_path / "bad.toml", "pes = 99")) == 2
    assert "bad.toml: preset bad: pes 99 is not in 1 … 16" in capsys.readouterr().err


def test_there_is_one_way_to_find_a_preset():
    """No command looks presets up by name only, so all accept files."""
    for path in (
        path for room in ("sim", "eda", "study", "app") for path in (ROOT / room).rglob("*.py")
    ):
        assert not re.search(r"\bPRESETS(\[|\.get)", path.read_text()), path.name


def test_names():
    assert [config.name for config in PRESETS.values()] == list(PRESETS)
    assert find_preset("paper") is PAPER
    refused(r"preset 'x': unknown; .*DEFAULT, SMALL, PAPER, TINY", find_preset, "x")


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
    refused(rf"preset DEFAULT: {field} ", replace, DEFAULT, **{field: value})


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
