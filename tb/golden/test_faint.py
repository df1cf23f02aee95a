"""The faintness rule: bounds on its error, and skipped block visits change no pixel."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.raster import rasterize
from splatcore.golden.reference import project
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.generate import generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.convention import ALPHA_MIN, SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.raster import COLOURS, mark_min
from tb.helpers.bounds import RULE
from tb.helpers.machines import garden

OFF = replace(DEFAULT, faint=())

VALUES = [(5, 11, 9), (1, 2, 2), (4, 9, 4), (3, 16, 16), (6, 13, 9), (2, 8, 5)]


@pytest.mark.parametrize("name", HARD)
def test_error_of_the_rule(name):
    """The error is at most 2^−dark of the colour range, and 0 at pixels whose T stays above."""
    case = HARD[name](0)
    gaussians = case.scene.gaussians()
    own, faint = (render_reference(gaussians, case.camera, rule) for rule in (SPLATCORE, RULE))
    error = np.abs(own.image - faint.image)
    splats, _ = project(gaussians, case.camera)
    assert error.max(initial=0) <= RULE.faint.dark * splats.colour.max(initial=0)
    assert (error[own.transmittance >= RULE.faint.dark] == 0).all()
    assert faint.counts["contributions"] <= own.counts["contributions"]


@pytest.mark.parametrize("name", ["fog", "alternating_layers"])
def test_cases_are_hard(name):
    """In these scenes the rule changes more than rounding does, and saves at least 30 % of work."""
    case = HARD[name](0)
    model, _ = pack(case.scene, DEFAULT)
    pictures = [render(config, model, case.camera) for config in (DEFAULT, OFF)]
    error = np.abs(np.subtract(*(p.pixels.astype(int) for p in pictures))).max()
    assert 2 <= error <= 255 * RULE.faint.dark + 1
    faint, own = (p.raster.counts for p in pictures)
    assert faint["contributions"] < 0.7 * own["contributions"]


def test_fog():
    """Behind T just below 1/32 all Gaussians are barely visible; together they change the image."""
    case = HARD["fog"](0)
    gaussians = case.scene.gaussians()
    assert (gaussians.opacity[2:] == 1.2 * ALPHA_MIN).all() and len(gaussians) == 5_002
    frame, front = (render_reference(part, case.camera) for part in (gaussians, gaussians[:2]))
    assert 0.9 / 32 < front.transmittance.min() < front.transmittance.max() < 1 / 32
    assert np.quantile(frame.transmittance / front.transmittance, 0.9) < 0.3
    assert np.abs(frame.image - front.image).max() > 0.02


def test_alternating_layers():
    """At T just below 1/32, black layers weigh just less than the threshold `taken` and white ones
    just more, provided that the skipped black ones leave T unchanged."""
    case = HARD["alternating_layers"](0)
    z = (case.scene.position @ case.camera.rotation.T + case.camera.translation)[:, 2]
    alpha, left = case.scene.opacity[2:], np.prod(1 - case.scene.opacity[:2])
    black, white = alpha[::2], alpha[1::2]
    before = left * np.concatenate([[1], np.cumprod(1 - white)[:-1]]) / RULE.faint.taken
    assert (np.diff(z) > 0).all() and left < 1 / 32 and len(white) == len(black) == 46
    assert (before * black > 0.9).all() and (before * black < 1).all()
    assert (before * white > 1).all() and (before * white < 1.1).all()


def test_weights_sum_to_one():
    """A pixel's weights sum to 1 whatever is skipped; an ended pixel gets no background."""
    model, camera = garden(DEFAULT, 3_000), generated_camera("garden", 240, 136)
    frame, size = render(DEFAULT, model, camera), (camera.width, camera.height)
    half = 1 << DEFAULT.colour_fraction - 1
    grey = np.full_like(frame.binned.features["red"], half)
    features = frame.binned.features | dict.fromkeys(COLOURS, grey)
    black, same = (
        rasterize(DEFAULT, features, frame.sorted, size, (code,) * 3, rounded=False)
        for code in (0, half)
    )
    full = ((1 << DEFAULT.weight) - 1) << DEFAULT.sum_fraction - DEFAULT.weight - 1
    assert (same.pixels == full).all()
    assert (black.pixels == full).all(2).sum() == black.counts["ended"] > 100


@pytest.mark.parametrize("values", VALUES)
def test_skipped_visits_change_no_pixel(values):
    """The picture is the same if every block is visited, whatever its level."""
    config = replace(DEFAULT, faint=values)
    model, camera = garden(config, 3_000), generated_camera("garden", 240, 136)
    frame, size = render(config, model, camera), (camera.width, camera.height)
    whole = rasterize(config, frame.binned.features, frame.sorted, size, mark_all=True)
    assert np.array_equal(frame.pixels, whole.pixels)
    counts = frame.raster.counts, whole.counts
    assert counts[0]["contributions"] == counts[1]["contributions"]
    assert counts[0]["marked"] < 0.9 * counts[1]["marked"]


def test_levels_leave_blocks_out():
    """Levels skip blocks that have pixels of alpha ≥ 1/255 whose contribution is too faint."""
    model, camera = garden(DEFAULT, 3_000), generated_camera("garden", 240, 136)
    faint, own = (render(config, model, camera).raster.counts for config in (DEFAULT, OFF))
    assert faint["visited"] < 0.95 * own["visited"]
    rule = DEFAULT.faint
    assert len(mark_min(DEFAULT)) == 1 + rule.ends - rule.dark and len(mark_min(OFF)) == 1


@pytest.mark.parametrize(
    ("fields", "why"),
    [({"faint": (5, 11)}, "neither"), ({"faint": (5, 8, 9)}, "dark ≤ ends ≤ taken"),
     ({"faint": (0, 11, 9)}, "1 ≤ dark"), ({"faint": (5, 17, 9)}, "taken ≤ 16"),
     ({"early_termination": False}, "ends pixels")],
)  # fmt: skip
def test_impossible_values_are_refused(fields, why):
    with pytest.raises(InputError, match=f"faint.*{why}"):
        Config(**fields)
