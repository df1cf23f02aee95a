"""Every hard case of antialiased scenes really has the property that makes it hard."""

from dataclasses import replace

import numpy as np

from splatcore.golden.reference import project
from splatcore.model.generate.hard import HARD, HardCase
from splatcore.model.generate.hard_colour import ANTIALIASED
from splatcore.spec.convention import ALPHA_MIN


def test_names():
    assert set(ANTIALIASED) == {name for name in HARD if HARD[name](0).scene.antialiased}


def factors(case: HardCase) -> np.ndarray:
    """Share [M] of its opacity that compensation leaves to each splat that stays visible."""
    whole, _ = project(replace(case.scene, antialiased=False).gaussians(), case.camera)
    splats, _ = project(case.scene.gaussians(), case.camera)
    assert case.scene.antialiased and len(splats) <= len(whole)
    stored = case.scene.opacity[splats.index]
    return splats.opacity / stored


def test_antialiased_dust():
    case = HARD["antialiased_dust"](0)
    size = case.scene.scale * 64 / 4  # pixels
    assert size.min() < 0.01 and 0.9 < size.max() <= 1
    kept = factors(case)
    assert len(kept) < 0.7 * len(case.scene) and kept.min() < 0.01 and kept.max() > 0.6


def test_antialiased_needles():
    case = HARD["antialiased_needles"](0)
    assert np.allclose(case.scene.scale[:, 0], 500 * 4 / 64)
    assert np.isclose(case.scene.scale.min(), 0.001 * 4 / 64)
    kept = factors(case)
    assert 0 < len(kept) < len(case.scene) and kept.max() < 0.1


def test_antialiased_edge():
    case = HARD["antialiased_edge"](0)
    splats, _ = project(case.scene.gaussians(), case.camera)
    edge = splats.opacity[splats.index >= 40] / ALPHA_MIN
    assert (edge >= 1).all() and (edge < 1.7).all() and 500 < len(edge) < 1500


def test_antialiased_edge_on():
    case = HARD["antialiased_edge_on"](0)
    kept = factors(case)
    assert kept.min() < 0.1 and np.allclose(case.scene.scale[:, 0] / case.scene.scale[:, 2], 1e5)
    splats, _ = project(replace(case.scene, antialiased=False).gaussians(), case.camera)
    assert len(kept) < 0.6 * len(splats)  # exactly edge-on flakes vanish


def test_antialiased_whole():
    case = HARD["antialiased_whole"](0)
    kept, splats = factors(case), project(case.scene.gaussians(), case.camera)[0]
    assert (kept[splats.index < 8] > 0.999).all() and kept.min() < 0.8
    assert (splats.extent[splats.index < 8] > 64 / 2).all()
