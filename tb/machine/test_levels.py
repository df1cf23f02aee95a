"""Models with levels of detail on the whole machine."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.hdl.points.preprocess import Preprocess
from splatcore.sim.cycles.preprocessing import preprocessing_cycles
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL
from splatcore.sim.soak.fault_kinds import check_outcome, drawn
from splatcore.sim.soak.fault_runs import run_fault
from tb.helpers.configs import ALPHA
from tb.helpers.level_models import clouds
from tb.helpers.machines import ROUGH, check, view
from tb.planted.fault import plant

pytestmark = pytest.mark.slow

CHUNKS = 9


@pytest.mark.parametrize("away", [0, 10])
def test_levels_in_turn(away):
    """A model without levels, then with them: at 0 pixels the same picture, then others."""
    plain, model = clouds(ALPHA, CHUNKS)
    camera = view()
    camera = replace(camera, translation=np.add(camera.translation, [0, 0, away]))
    jobs = [Job(plain, camera)]
    jobs += [Job(model, replace(camera, lod_pixels=pixels)) for pixels in (0.0, 0.25, 1000.0)]
    run = check(ALPHA, jobs, ROUGH)
    first, same, *_, last = (frame.pixels for frame in run.frames)
    assert np.array_equal(first, same) and (first != last).any()
    drawn = [render(ALPHA, *job).points.drawn.sum() for job in jobs]
    assert drawn[1] == CHUNKS > drawn[3]


@pytest.mark.parametrize("pixels", [0.0, 0.25])
def test_cycles_of_a_view_of_nothing(pixels):
    """Only headers and records are read: as many cycles as in the cycle model, within 3 %."""
    _, model = clouds(ALPHA, 120)
    away = replace(view(), translation=np.array([0, 0, -1000.0]), lod_pixels=pixels)
    run = check(ALPHA, [Job(model, away)], IDEAL)
    frame = render(ALPHA, model, away)
    assert not frame.counts["points_read"]
    found = preprocessing_cycles(ALPHA, frame, IDEAL.latency)
    assert found == pytest.approx(run.preprocessing_cycles[0], rel=0.03)


def test_a_record_in_a_wrong_order_is_reported():
    for seed in range(2):
        fault = drawn(ALPHA, "levels", seed, pair=True)
        check_outcome(ALPHA, fault, run_fault(ALPHA, fault, seed, pair=True), pair=True)


@pytest.mark.verify
def test_a_lost_report_is_found(monkeypatch):
    plant(monkeypatch, Preprocess, "_control", "m.If(points.fault)", "m.If(0)")
    config = replace(ALPHA, name="UNREPORTED")
    fault = drawn(config, "levels", 0, pair=True)
    with pytest.raises(AssertionError):
        check_outcome(config, fault, run_fault(config, fault, 0, pair=True), pair=True)
