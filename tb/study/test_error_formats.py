"""`splatcore error --stage sort`: key windows, changed places and pictures of each key format;
`--stage raster`: the sweep of stage 3's formats. The plot of errors by field."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from splatcore.golden.raster import Entries
from splatcore.golden.reference import Splats
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.shot import View
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.study.accuracy import formats
from splatcore.study.accuracy.keys import (
    EXACT_ORDER,
    FRACTIONS,
    WAYS,
    depth_codes,
    reordered,
    window,
)
from splatcore.study.accuracy.plot import FLOOR, LOW, draw_fields
from tb.helpers.command import check_documented, load, run


def splats_at(depth: list[float], index: list[int]) -> Splats:
    """Splats with these depths and indices; all other values are 0."""
    centre, covariance, conic = (np.zeros((len(depth), columns)) for columns in (2, 3, 3))
    none = np.zeros(len(depth))
    return Splats(np.array(index), centre, np.array(depth), covariance, conic, none, none, conic)


def test_window():
    """Codes relative to the lowest of their part, shifted right until the bits suffice."""
    codes = np.array([100, 103, 101, 5000, 5016, 5007, 7])
    part = np.array([0, 0, 0, 2, 2, 2, 3])
    assert list(window(codes, part, 2)) == [0, 3, 1, 0, 2, 0, 0]  # the largest step is 16: >> 3
    assert list(window(codes, part, 5)) == [0, 3, 1, 0, 16, 7, 0]
    assert list(window(codes[:0], part[:0], 5)) == []


@pytest.mark.parametrize("fraction", FRACTIONS)
def test_depth_codes_rise(fraction):
    depth = np.geomspace(0.01, 1e6, 10_000)
    codes = depth_codes(depth, fraction)
    assert (np.diff(codes) >= 0).all()
    error = replace(DEFAULT.depth, fraction=fraction).decode(codes.astype(np.uint64)) / depth - 1
    assert 0.4 < np.abs(error).max() * 2**fraction <= 0.5001


def test_reordered():
    """The share counts swapped neighbours of a group; equal keys keep the order of Gaussians."""
    splats = splats_at([1.0, 2.0, 3.0, 4.0], [7, 5, 6, 4])
    entries = Entries(np.array([0, 3, 3, 5]), np.array([0, 1, 3, 2, 3]), np.arange(1, 6))
    same, share = reordered(WAYS[EXACT_ORDER], splats, entries)
    assert list(same.mask) == [1, 2, 3, 4, 5] and share == 0
    back, share = reordered(lambda depth, splat, group: -depth[splat], splats, entries)
    assert list(back.mask) == [3, 2, 1, 5, 4] and list(back.start) == [0, 3, 3, 5] and share == 1
    equal, share = reordered(lambda depth, splat, group: 0 * splat, splats, entries)
    assert list(equal.mask) == [3, 2, 1, 5, 4] and list(equal.splat) == [3, 1, 0, 3, 2]
    halves, share = reordered(lambda depth, splat, group: depth[splat] >= 3, splats, entries)
    assert list(halves.mask) == [2, 1, 3, 5, 4] and share == pytest.approx(2 / 3)


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("error", "garden", "--size", "128x72", "--stage", "sort", "-o", "keys.png",
               "--json", "e.json") == 0  # fmt: skip
    found = load(tmp_path / "e.json")
    ways = {name: facts["scenes"]["garden"] for name, facts in found["machines"].items()}
    assert list(ways) == list(WAYS) and found["stage"] == "sort"
    bits = [ways[f"{fraction} fraction bits"] for fraction in FRACTIONS]
    changed = [way["changed_places"] for way in bits]
    assert changed == sorted(changed, reverse=True) and changed[0] > 0.1 > 0.01 > changed[-1] > 0
    exact = ways[EXACT_ORDER]
    assert exact["changed_places"] == 0 and exact["max_error_float64"] < 0.02
    decibels = [way["psnr_db_float64"] for way in (bits[0], bits[-1], exact)]
    assert decibels[0] + 3 < decibels[1] <= decibels[2] + 0.1
    assert bits[0]["max_error_float64"] > 5 * exact["max_error_float64"]
    assert ways["15 bits, by group"]["changed_places"] > ways["18 bits, by group"]["changed_places"]
    assert read_png("keys.png").std() > 5
    printed = capsys.readouterr().out
    assert "14 fraction bits" in printed and "…" not in printed
    check_documented("--stage sort", exact)


def test_no_other_machines(capsys):
    for option in ("--width 7/10", "--preset TINY"):
        assert run("error", "garden", "--stage", "sort", *option.split()) == 2
        assert "--stage sort: has formats of its own" in capsys.readouterr().err


@pytest.mark.slow
def test_fewer_bits_cost_decibels_and_save_gates(monkeypatch, tmp_path):
    monkeypatch.setattr(formats, "SWEEP", {"sum_fraction": (10,)})
    found = formats.raster_errors({"garden": View("garden", size="160x90")})
    full, cut = found["DEFAULT"], found["sum_fraction 10"]
    assert full["gates"] > cut["gates"] > 1000
    wide, narrow = (machine["scenes"]["garden"] for machine in (full, cut))
    assert wide["psnr_db_float64"] > narrow["psnr_db_float64"] + 1
    assert narrow["max_error_float64"] > wide["max_error_float64"] > 0
    assert len(formats.table(found).rows) == 2
    formats.write_plot("raster", found, tmp_path / "formats.png")
    assert (tmp_path / "formats.png").stat().st_size > 10_000


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
