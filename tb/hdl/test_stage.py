"""The stages of the point half under cocotb and Icarus, an independent simulator."""

from functools import partial

import pytest

from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.config import DEFAULT
from tb.helpers.icarus import check_under_icarus, needs_icarus
from tb.helpers.point_rows import point_rows
from tb.helpers.stage_cases import case, settled_outputs

GAUSSIANS = {"chunk": 600, "cull": 60, "place": 60, "project": 24}
"""Icarus is slow."""


@needs_icarus
@pytest.mark.slow
@pytest.mark.parametrize("stage", GAUSSIANS)
def test_under_icarus(stage, tmp_path):
    model, _ = pack(generate("garden", GAUSSIANS[stage]), DEFAULT)
    given = case(stage, point_rows(DEFAULT, model, generated_camera("garden")))
    check_under_icarus(
        given.component, tmp_path, given.inputs, given.expected, given.constants, given.first,
        partial(settled_outputs, stage, DEFAULT),
    )  # fmt: skip
