"""Each stage under cocotb, in Verilator and, where it is installed, in Icarus."""

from importlib import import_module
from pkgutil import iter_modules

import pytest

from tb import stages
from tb.helpers.feeds import KINDS, run_cases
from tb.helpers.runs import needs_icarus

STAGES = {
    module.name: import_module(f"tb.stages.{module.name}")
    for module in iter_modules(stages.__path__)
    if not module.name.startswith("test_")
}
"""Every file of this folder: `component` makes the stage, `cases` what it is given."""

SIMULATORS = ["verilator", pytest.param("icarus", marks=(needs_icarus, pytest.mark.testbenches))]


@pytest.mark.parametrize("stage", STAGES)
def test_stages_have_all_cases(stage):
    """Or say why they have none of a kind."""
    module = STAGES[stage]
    for kind in KINDS:
        assert (kind in module.cases()) != (f"No {kind}: " in " ".join(module.__doc__.split()))


@pytest.mark.slow
@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_stage(stage, simulator, tmp_path):
    module = STAGES[stage]
    run_cases(stage, module.component(), module.cases(), tmp_path, simulator)
