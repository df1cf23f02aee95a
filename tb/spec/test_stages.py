"""One table of stages: hardware, cycle model, counters and parts for synthesis have the same."""

from dataclasses import fields

from splatcore.hdl.stages import STAGES, WHOLE
from splatcore.sim.cycles.frame import Cycles
from splatcore.sim.eda.machine_gates import PARTS
from splatcore.spec.config import DEFAULT
from splatcore.spec.counters import counters
from splatcore.spec.stages import BLOCKS, HALVES, NAMES, OF_POINTS


def test_all_have_the_same_stages():
    blocks = [block for half in BLOCKS.values() for block in half]
    assert [*OF_POINTS, *blocks] == list(STAGES) and [*blocks, "control"] == list(WHOLE)
    assert [field.name for field in fields(Cycles)] == [*NAMES, *HALVES]
    named = [(half, *BLOCKS[half]) for half in HALVES]
    assert list(counters(DEFAULT)) == [name for names in named for name in names]
    assert {part.stage for part in PARTS} == {f"stage {k}" for k in range(4)} | {
        "binning", "control",
    }  # fmt: skip
