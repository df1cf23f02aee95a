"""Binning by the original renderer's 3σ square: radius, pairs, picture; tiles: `test_bin`."""

import numpy as np
import pytest

from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.golden.pipeline import render
from splatcore.golden.points import project_points
from splatcore.golden.program import run
from splatcore.golden.reference import project
from splatcore.golden.reference import render as reference
from splatcore.hdl.binning.bin import Bin
from splatcore.sim.frame.metric import difference
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.frame import fixed_constants
from tb.helpers.bin_frames import Frame, Outlines, bin_frame, compare_tiles, pairs, radii
from tb.helpers.bin_splats import conic
from tb.helpers.configs import MACHINES
from tb.helpers.scene_frames import scene_frame, with_counts

SQUARE = MACHINES["SQUARE_HD"]

RADIUS_ERROR = 3  # half steps of the arithmetic


@pytest.mark.parametrize("config", [SQUARE, PAPER], ids=lambda config: config.name)
def test_radius(config):
    """Radii of all shapes, of circles, and of near circles, whose (xx − yy)² is lost."""
    rng, pixel = np.random.default_rng(0), 2.0**config.screen_exponent
    long, thin = np.exp(rng.uniform(-4, 6, 20_000)), np.exp(rng.uniform(-8, 0, 20_000))
    angle = rng.uniform(-np.pi, np.pi, len(long))
    c, s, blur = np.cos(angle), np.sin(angle), 0.3
    xx, yy = (long**2 * (p**2 + (thin * q) ** 2) + blur for p, q in ((c, s), (s, c)))
    xy = long**2 * c * s * (1 - thin**2)
    little = blur * 2.0 ** -rng.integers(0, 30, len(long))
    xx, yy = np.append(xx, blur + little), np.append(yy, np.full_like(little, blur))
    xy = np.append(xy, little * rng.choice([-0.5, 0, 0.5], len(little)))
    inputs = {name: value / pixel**2 for name, value in (("xx", xx), ("xy", xy), ("yy", yy))}
    inputs |= fixed_constants(config) | {"attenuation": np.zeros(len(xx))}
    inputs = {name: config.arithmetic.round(value) for name, value in inputs.items()}
    exact = radii(np.stack([inputs[name] for name in ("xx", "xy", "yy")], axis=1))
    found = run(config, conic("3sigma"), inputs)
    error = (found["radius"] / exact - 1) / config.arithmetic.epsilon
    assert np.abs(error).max() < RADIUS_ERROR
    assert (found["spread"] == 0).sum() == 0 < (inputs["xx"] == inputs["yy"]).sum()


@pytest.mark.parametrize("name, count", with_counts(["flowers.spz", "skull.sog"]))
def test_against_reference(name, count):
    """No tile of the reference's squares is missing; pairs are within 5 % of the original's.

    The original renderer rounds the radius up to whole pixels.
    """
    _, model, camera, _ = scene_frame(name, count)
    points = project_points(SQUARE, model, camera)
    frame = Frame(points.codes, camera.width, camera.height)
    found = bin_frame(SQUARE, frame)
    drawn, counts = project(model.gaussians(), camera, ORIGINAL)
    assert abs(pairs(found) / counts["pairs_3sigma"] - 1) < 0.05
    drawn = drawn[np.isin(drawn.index, points.index)]
    splats = np.searchsorted(points.index, drawn.index)
    squares = Outlines(drawn.centre, drawn.conic, drawn.reach, radii(drawn.covariance))
    exact, missing = compare_tiles(SQUARE, frame, found, squares, splats)
    assert missing == 0 and exact <= pairs(found)
    assert len(drawn) > 0.95 * len(found.kept)


def test_picture_is_the_original_renderers():
    """It is closer to the reference with squares than with exact tiles: their edges are visible."""
    _, model, camera, _ = scene_frame("garden", None)
    pixels = render(SQUARE, model, camera).pixels
    original, exact = (
        difference(pixels, reference(model.gaussians(), camera, convention).pixels)
        for convention in (ORIGINAL, SPLATCORE)
    )
    assert original.psnr_db > 50 and original.psnr_db > exact.psnr_db


@pytest.mark.slow
def test_size_and_depth():
    """A machine with squares contains only the logic that squares need."""
    found, exact = gates(Bin(SQUARE)), gates(Bin(DEFAULT))
    assert exact.nand2 < 48_500 and exact.memory_bits < 18_000 * 8
    assert exact.speed_depth <= DEPTH_MAX
    assert found.nand2 < 0.6 * exact.nand2 and found.memory_bits < exact.memory_bits
    assert found.speed_depth <= DEPTH_MAX
