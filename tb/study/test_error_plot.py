"""The plot of errors by field: every point is visible, and points are not joined by lines."""

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure

from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.study.accuracy.plot import FLOOR, LOW, draw_fields

MACHINES = (DEFAULT, PAPER, TINY)
RMS = {"u": 1e-3, "v": 2e-3, "depth": 1e-17, "colour": 1e-4, "opacity": 0.0, "a": None}


@pytest.fixture
def axes():
    """Axes for two kinds of scenes with equal errors per field, so that points could overlap."""
    largest = {
        kind: {c.name: {f: {"rms": rms} for f, rms in RMS.items()} for c in MACHINES}
        for kind in ("scenes", "hard")
    }
    axes = Figure().subplots()
    draw_fields(axes, largest, MACHINES)
    return axes


def points(axes) -> np.ndarray:
    found = np.concatenate([line.get_xydata() for line in axes.get_lines()])
    return found[np.isfinite(found).all(1)]


def test_fields_are_not_joined(axes):
    assert axes.get_lines() and {line.get_linestyle() for line in axes.get_lines()} == {"None"}


def test_no_point_hides_another(axes):
    found = points(axes)
    assert len(found) == 2 * len(MACHINES) * 4  # errors of 0 and unmeasured errors have no point
    for one, other in itertools.combinations(found, 2):
        assert abs(one[0] - other[0]) > 0.05
    assert (abs(found[:, 0] - found[:, 0].round()) < 0.45).all()  # nearest to its own field's name


def test_a_tiny_error_does_not_squeeze_the_others(axes):
    found = points(axes)
    assert found[:, 1].min() == FLOOR and axes.get_ylim()[0] > FLOOR / 10
    low = [line for line in axes.get_lines() if line.get_marker() == LOW]
    assert low and all((line.get_ydata() == FLOOR).all() for line in low)
    assert f"{FLOOR:.0e}" in axes.get_title()
