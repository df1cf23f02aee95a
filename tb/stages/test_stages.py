"""Each stage under cocotb, in Verilator and, if installed, in Icarus."""

from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules

import numpy as np
import pytest

from tb import stages
from tb.helpers.feeds import KINDS, run_cases
from tb.helpers.runs import needs_icarus

STAGES = {
    module.name: import_module(f"tb.stages.{module.name}")
    for module in iter_modules(stages.__path__)
    if not module.name.startswith("test_")
}
"""Every file in this folder: `component` makes the stage, `cases` its cases."""

pytestmark = pytest.mark.slow

SIMULATORS = ["verilator", pytest.param("icarus", marks=(needs_icarus, pytest.mark.testbenches))]


@pytest.mark.parametrize("stage", STAGES)
def test_stages_have_all_cases(stage):
    """Or their docstring explains why a kind is missing."""
    module = STAGES[stage]
    for kind in KINDS:
        assert (kind in module.cases()) != (f"No {kind}: " in " ".join(module.__doc__.split()))


WRONG = {
    "o, item 1 is": lambda rows: rows ^ (np.arange(len(rows)) == 1)[:, None].astype(np.uint8),
    "o has": lambda rows: rows[:-1],
    "no output for": lambda rows: np.concatenate([rows, rows[:1]]),
}
"""Changes of the expected outputs, by the message that they cause."""


@pytest.mark.parametrize("found", WRONG)
def test_what_is_wrong_is_found(found, tmp_path):
    right = STAGES["cascade"].cases()["full"]
    given = {"full": replace(right, expected={"o": WRONG[found](right.expected["o"])})}
    with pytest.raises(AssertionError, match=found):
        run_cases("cascade", STAGES["cascade"].component(), given, tmp_path, few=True)


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_stage(stage, simulator, tmp_path):
    module = STAGES[stage]
    few = simulator == "icarus"
    run_cases(stage, module.component(), module.cases(), tmp_path, simulator, few)
