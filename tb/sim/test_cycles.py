"""The cycle model against RTL, stage by stage, within 3 %."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import Frame, render
from splatcore.hdl.sorting.sort import Sort
from splatcore.model.generate.generate import generated_camera
from splatcore.sim.cycles.frame import Cycles, frame_cycles
from splatcore.sim.cycles.raster import NEAR, block_wide, raster_cycles
from splatcore.spec.config import DEFAULT
from splatcore.spec.stages import OF_POINTS
from tb.helpers import bin_frames
from tb.helpers.configs import MACHINES
from tb.helpers.machines import garden
from tb.helpers.point_rows import point_rows
from tb.helpers.runs import compiled
from tb.stages import points
from tb.stages.raster import Lists
from tb.stages.sorting import sort_case

WITHIN = 0.03  # the model's relative error at most

GAUSSIANS = 20_000


@functools.cache
def modelled() -> tuple[Frame, Cycles]:
    frame = render(DEFAULT, garden(DEFAULT, GAUSSIANS), generated_camera("garden"))
    return frame, frame_cycles(DEFAULT, frame)


def check(modelled: int, cycles: int):
    assert abs(modelled - cycles) <= WITHIN * cycles, f"{modelled} is not {cycles}"


@pytest.mark.slow
@pytest.mark.parametrize("stage", OF_POINTS)
def test_stages_0_and_1(stage):
    rows = point_rows(DEFAULT, garden(DEFAULT, GAUSSIANS), generated_camera("garden"))
    check(getattr(modelled()[1], stage), points.check(stage, rows, 0).cycles)


@pytest.mark.slow
def test_binning():
    frame, cycles = modelled()
    camera = generated_camera("garden")
    codes = frame.points.codes
    given = bin_frames.Frame(codes, camera.width, camera.height)
    run, _ = bin_frames.check(DEFAULT, [given], stall=0)
    check(cycles.bin, run.cycles)


@pytest.mark.slow
def test_stage_2():
    frame, cycles = modelled()
    order = np.argsort(frame.binned.group, kind="stable")
    entries = {name: codes[order] for name, codes in frame.binned.entries.items()}
    case = sort_case(DEFAULT, np.diff(frame.start), entries)
    part = compiled(Sort, DEFAULT, samples=("o__valid", "o__payload"))
    check(cycles.sort, case.check(part).cycles)


@pytest.mark.verify
def test_stage_3():
    frame, cycles = modelled()
    camera = generated_camera("garden")
    size, groups = (camera.width, camera.height), np.flatnonzero(np.diff(frame.start))
    lists = Lists(DEFAULT, frame.binned.features, frame.sorted, size, chosen=groups)
    check(cycles.raster, lists.run().result.cycles)


def test_model_knows_sizes():
    """More rasterizers or PEs take fewer cycles, in their own stages only."""
    packed, camera = garden(DEFAULT, 2000), generated_camera("garden", 160, 90)
    few = replace(DEFAULT, rasterizers=4, pes=9)
    machines = [few, replace(few, rasterizers=8), replace(few, pes=14)]
    base, more_rasterizers, more_pes = (
        vars(frame_cycles(config, render(config, packed, camera))) for config in machines
    )
    for found, stages in (
        (more_rasterizers, {"raster", "rendering"}),
        (more_pes, {"cull", "place", "project", "preprocessing"}),
    ):
        assert {name for name in base if found[name] < base[name]} == stages
        assert all(found[name] <= base[name] for name in base)


def test_lanes_in_quads():
    """Fewer cycles than block-wide lanes, which at the found cycles per block take as long."""
    config = MACHINES["QUADS"]
    frame = render(config, garden(config, 2000), generated_camera("garden", 160, 90))
    cycles = raster_cycles(config, frame)
    wide, step = block_wide(config, frame, cycles)
    assert cycles < raster_cycles(wide, frame)
    assert raster_cycles(wide, frame, step) == pytest.approx(cycles, rel=NEAR)
