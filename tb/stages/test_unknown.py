"""The whole machine without initial values in Icarus, which knows X: none leaves the machine."""

import json

import pytest

from splatcore.sim.machine.machine import machine_source
from splatcore.sim.rtl.cocotb_runner import run_sources
from splatcore.sim.rtl.verilator import without_initial
from splatcore.spec.config import TINY
from tb.helpers.runs import needs_icarus
from tb.stages.table import STAGES

pytestmark = [pytest.mark.slow, needs_icarus]


@pytest.mark.parametrize("few", [True, pytest.param(False, marks=pytest.mark.testbenches)])
def test_nothing_unknown_leaves_the_machine(few, tmp_path):
    """After one cycle of reset, START without set-up, and a reset in the middle of a frame."""
    cases = {kind: case.numbers() for kind, case in STAGES["top"].cases().items()}
    (tmp_path / "cases.json").write_text(json.dumps(cases))
    sources = {"top.v": without_initial(machine_source(TINY))}
    run_sources(sources, "tb.testbenches.unknown", "icarus", folder=str(tmp_path), few=few)
