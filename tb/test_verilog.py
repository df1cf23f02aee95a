"""Generated Verilog: headers, names, lint, depth between registers."""

from itertools import pairwise

import pytest

from hdl.place import Place
from hdl.stages import LARGE, PRIMITIVES, STAGES
from sim.synth import DEPTH_MAX, gates, memories
from sim.verilog import WAIVERS, lint, stage_source, write_stages
from spec.config import DEFAULT, MEMORY_MAX, PRESETS

PARTS = ("sub_sorter", "merge", "prepare", "setup", "mark", "evaluate", "lane")
"""Of the stages that take too long to synthesise."""

FAULTY = """\
module faulty(input clk, input [3:0] i, output reg [3:0] o, output p);
  always @* if (i[0]) o = i;
endmodule
"""


@pytest.mark.slow
@pytest.mark.parametrize("preset", PRESETS.values(), ids=lambda config: config.name)
def test_stages_are_clean(preset, tmp_path):
    *paths, waivers = write_stages(preset, tmp_path)
    assert [path.stem for path in paths] == [f"splatcore_{name}" for name in STAGES]
    assert waivers.read_bytes() == WAIVERS.read_bytes()
    for path in paths:
        assert lint(path, path.stem) == []


def test_lint_sees_faults(tmp_path):
    (tmp_path / "faulty.v").write_text(FAULTY)
    found = "\n".join(lint(tmp_path / "faulty.v", "faulty"))
    assert "LATCH" in found and "UNDRIVEN" in found


def test_every_waiver_has_a_reason():
    lines = WAIVERS.read_text().splitlines()
    for before, line in pairwise(lines):
        if line.startswith("lint_off"):
            assert before.startswith(("// ", "lint_off"))


def test_source_says_what_it_is():
    text = stage_source("place", Place(DEFAULT), DEFAULT)
    assert "preset DEFAULT" in text and "hdl/place.py" in text and "Timing" in text
    assert "module splatcore_place(" in text and "array.pe1" in text


@pytest.mark.slow
@pytest.mark.parametrize("name", [*(name for name in STAGES if name not in LARGE), *PARTS])
def test_no_path_is_too_deep(name):
    found = gates((STAGES | PRIMITIVES)[name](DEFAULT))
    assert found.speed_depth <= DEPTH_MAX
    least, most = (0.95, 1.15) if name in PARTS else (1, 1.1)
    assert least * found.nand2 < found.speed_nand2 < most * found.nand2


def test_memories_fit():
    """All of DEFAULT's stages together stay within what the paper's machine has."""
    stages = ("points", "bin", "sort", "raster")
    sizes = [size for name in stages for size in memories(STAGES[name](DEFAULT))]
    assert 0 < sum(words * bits for words, bits in sizes) / 8 <= MEMORY_MAX
