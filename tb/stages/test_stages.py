"""Each stage under cocotb, in Verilator and, if installed, in Icarus."""

import json
from dataclasses import replace

import numpy as np
import pytest

from splatcore.hdl.lib.holds import holds
from splatcore.sim.rtl.cocotb_runner import run_testbench
from tb.helpers.runs import marked, needs_icarus
from tb.stages.primitives import Primitives
from tb.stages.table import KINDS, STAGES, Stage

pytestmark = pytest.mark.slow

LARGE = ("top", "preprocess", "render", "points", "project", "raster")
"""Stages whose parts are in the table, too: they take minutes."""

SIMULATORS = ["verilator", pytest.param("icarus", marks=(needs_icarus, pytest.mark.testbenches))]


def run(name: str, stage: Stage, folder, simulator: str = "verilator", few: bool = False):
    """Run all cases in a simulator, and print one line per run.

    few: one stall pattern and one reset only, for a slow simulator
    """
    cases = {kind: case.numbers() for kind, case in stage.cases().items()}
    (folder / "cases.json").write_text(json.dumps(cases))
    summary = folder / "summary"
    summary.touch()
    try:
        run_testbench(
            stage.component(), "tb.testbenches.stage",
            simulator=simulator, folder=str(folder), few=few,
        )  # fmt: skip
    finally:
        for line in summary.read_text().splitlines():
            print(f"{name} under {simulator}: {line}")


@pytest.mark.parametrize("name", STAGES)
def test_stages_have_all_cases(name):
    """Or the table says why a kind is missing."""
    stage = STAGES[name]
    given = stage.cases()
    assert stage.missing.keys().isdisjoint(given) and given.keys() | stage.missing >= {*KINDS}


WRONG = {
    "o, item 1 is": lambda rows: rows ^ (np.arange(len(rows)) == 1)[:, None].astype(np.uint8),
    "o has": lambda rows: rows[:-1],
    "no output for": lambda rows: np.concatenate([rows, rows[:1]]),
}
"""Changes of the expected outputs, by the message that they cause."""


@pytest.mark.parametrize("found", WRONG)
def test_what_is_wrong_is_found(found, tmp_path):
    stage = STAGES["cascade"]
    right = stage.cases()["full"]
    wrong = replace(right, expected={"o": WRONG[found](right.expected["o"])})
    with pytest.raises(AssertionError, match=found):
        run("cascade", replace(stage, cases=lambda: {"full": wrong}), tmp_path, few=True)


FORBIDDEN = {
    "a read of": lambda regions: [each for each in regions if each[2]],
    "a write of": lambda regions: [(begin, end, False) for begin, end, _ in regions],
}
"""Changes of the regions of memory, by the message that they cause."""


@pytest.mark.testbenches
@pytest.mark.parametrize("found", FORBIDDEN)
def test_an_access_that_no_region_allows_is_found(found, tmp_path):
    stage = STAGES["preprocess"]
    cases = {
        name: replace(case, regions=FORBIDDEN[found](case.regions))
        for name, case in stage.cases().items()
    }
    with pytest.raises(AssertionError, match=f"no region allows {found}"):
        run("preprocess", replace(stage, cases=lambda: cases), tmp_path, few=True)


class Refuses(Primitives):
    """Primitives with an assertion that fails at each item."""

    def elaborate(self, platform):
        m = super().elaborate(platform)
        holds(m, "never", ~self.register.o.valid, "an item comes")
        return m


@needs_icarus
def test_a_failed_assertion_fails_the_run_in_icarus(tmp_path):
    """Icarus prints it, goes on and ends with status 0."""
    stage = replace(STAGES["streams"], component=Refuses)
    with pytest.raises(AssertionError, match="wrong: an item comes"):
        run("streams", stage, tmp_path, "icarus", few=True)


@pytest.mark.parametrize("name", marked(STAGES, LARGE, pytest.mark.testbenches))
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_stage(name, simulator, tmp_path):
    run(name, STAGES[name], tmp_path, simulator, few=simulator == "icarus")
