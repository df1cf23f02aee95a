"""Models with levels of detail on the whole machine."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.hdl.points.preprocess import Preprocess
from splatcore.sim.cycles.preprocessing import preprocessing_cycles
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL, LPDDR4
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


def test_the_reader_turns():
    """Of the subtrees of groups that are drawn, headers on their way are all that is read."""
    _, model = clouds(ALPHA, 120)
    camera = replace(view(), translation=np.add(view().translation, [0, 0, 10]))
    jobs = [Job(model, replace(camera, lod_pixels=pixels)) for pixels in (1.0, 0.8, 9.0)]
    jobs.insert(1, Job(clouds(ALPHA, 120, size=0.01)[1], replace(view(), lod_pixels=1.0)))
    for timing in (LPDDR4, ROUGH):
        check(ALPHA, jobs, timing)
    read = check(ALPHA, jobs[-1:], IDEAL).report.traffic["read_model"]
    layout, headers = model.layout, 16 * model.format.header_stride
    assert read < layout.chunks + layout.end - layout.colours + headers


@pytest.mark.parametrize("levels", [False, True])
def test_cycles_of_a_view_of_nothing(levels):
    """Only headers and records are read: 60 more take as many cycles as in the cycle model, within
    3 %."""
    away = replace(view(), translation=np.array([0, 0, -1000.0]))
    taken, modelled = [], []
    for chunks in (60, 120):
        model = clouds(ALPHA, chunks)[levels]
        taken.append(check(ALPHA, [Job(model, away)], IDEAL).preprocessing_cycles[0])
        frame = render(ALPHA, model, away)
        modelled.append(preprocessing_cycles(ALPHA, frame, IDEAL.latency))
        assert not frame.counts["points_read"]
    assert np.diff(modelled) == pytest.approx(np.diff(taken), rel=0.03)


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
