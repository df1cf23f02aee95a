"""Binning by the original renderer's 3σ square: radius, tiles and pairs against exact squares."""

import numpy as np
import pytest

from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.golden.bin import Binned, splat_codes
from splatcore.golden.pipeline import render
from splatcore.golden.points import project_points
from splatcore.golden.program import run
from splatcore.golden.reference import project
from splatcore.golden.reference import render as reference
from splatcore.hdl.binning.bin import Bin
from splatcore.sim.frame.metric import difference
from splatcore.spec.config import DEFAULT, PAPER, Config
from splatcore.spec.convention import ORIGINAL, SIGMA_EXTENT, SPLATCORE, TILE
from splatcore.spec.frame import fixed_constants
from tb.helpers.bin_frames import Ellipses, Frame, bin_frame, found_tiles, pairs
from tb.helpers.bin_splats import KINDS, conic, splats
from tb.helpers.configs import MACHINES
from tb.helpers.scene_frames import scene_frame, with_counts

SQUARE = MACHINES["SQUARE_HD"]

RADIUS_ERROR = 3  # half steps of the arithmetic

RATIO_MAX = 1.05
"""Largest ratio of tiles found to tiles of the exact square: for splats of thousands of pixels, the
unit is some pixels."""


def radii(covariance: np.ndarray) -> np.ndarray:
    """Return the squares' half sides [N] for covariances [N, 3] xx, xy, yy."""
    xx, xy, yy = covariance.T
    return SIGMA_EXTENT * np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))


def covariances(conic: np.ndarray) -> np.ndarray:
    """Return covariances [N, 3] xx, xy, yy of conics [N, 3] A, B, C."""
    a, b, c = conic.T
    return np.stack([c, -b, a], axis=1) / (a * c - b * b)[:, None]


def square_tiles(centre: np.ndarray, radius: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return tiles [N, 4] x0, x1, y0, y1 with a pixel's centre in the square; x1 < x0 if none.

    centre: [N, 2], pixels
    radius: [N], pixels
    size: image width and height, pixels
    """
    last = np.array(size) - 1
    low = np.ceil(np.maximum(centre - radius[:, None], 0))
    high = np.floor(np.minimum(centre + radius[:, None], last))
    boxes = np.stack([low // TILE, high // TILE], axis=2).reshape(-1, 4).astype(np.int64)
    boxes[(low > high).any(axis=1)] = [0, -1, 0, -1]
    return boxes


def found_boxes(config: Config, frame: Frame, found: Binned) -> np.ndarray:
    """Return the boxes [N, 4] of the tiles that binning found, which must fill their box."""
    boxes = np.tile(np.array([1 << 30, -1, 1 << 30, -1]), (len(frame), 1))
    splat, row, column = found_tiles(config, frame, found)
    for k, tile in enumerate((column, row)):
        np.minimum.at(boxes[:, 2 * k], splat, tile)
        np.maximum.at(boxes[:, 2 * k + 1], splat, tile)
    count = np.bincount(splat, minlength=len(frame))
    boxes[count == 0] = [0, -1, 0, -1]
    assert (areas(boxes) == count).all()
    return boxes


def areas(boxes: np.ndarray) -> np.ndarray:
    """Return the number of tiles in boxes [N, 4]."""
    return (boxes[:, 1] - boxes[:, 0] + 1) * (boxes[:, 3] - boxes[:, 2] + 1)


def compare_squares(
    config: Config, frame: Frame, found: Binned,
    centre: np.ndarray | None = None, radius: np.ndarray | None = None,
    splats: np.ndarray | None = None,
) -> tuple[int, int]:  # fmt: skip
    """Return the number of touching squares and tiles, and of squares with a missing tile.

    centre: [M, 2], pixels; by default from the splats' own conics
    radius: [M], pixels; likewise
    splats: [M], their numbers in the frame; by default all
    """
    if centre is None:
        ellipses = Ellipses.of(config, frame.splats)
        centre, radius = ellipses.centre, radii(covariances(ellipses.conic))
    boxes = found_boxes(config, frame, found)
    boxes = boxes if splats is None else boxes[splats]
    exact = square_tiles(centre, radius, (frame.width, frame.height))
    lacking = (exact[:, [0, 2]] < boxes[:, [0, 2]]) | (exact[:, [1, 3]] > boxes[:, [1, 3]])
    return int(areas(exact).sum()), int((lacking.any(axis=1) & (areas(exact) > 0)).sum())


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("config", [SQUARE, MACHINES["SQUARE"]], ids=["HD", "TINY"])
def test_no_tile_of_the_square_is_missing(config, kind):
    for smaller in (0, 11):
        size = (config.width_max - smaller, config.height_max - 2 * smaller)
        frame = Frame(splats(config, kind, 1000, size, seed=smaller), *size)
        found = bin_frame(config, frame)
        exact, missing = compare_squares(config, frame, found)
        assert exact > 200 and missing == 0
        assert exact <= pairs(found) <= exact * RATIO_MAX


def test_missing_tile_is_detected():
    frame = Frame(splats(SQUARE, "tiny", 300, (640, 400)), 640, 400)
    found = bin_frame(SQUARE, frame)
    assert compare_squares(SQUARE, frame, found)[1] == 0
    single = np.flatnonzero(np.bitwise_count(found.entries["mask"]) == 1)
    found.entries["mask"][single[0]] = 0
    assert compare_squares(SQUARE, frame, found)[1] == 1


@pytest.mark.parametrize("name, count", with_counts(["flowers.spz", "skull.sog"]))
def test_against_reference(name, count):
    """No tile of the reference's squares is missing; pairs are within 5 % of the original's.

    The original renderer rounds the radius up to whole pixels.
    """
    _, model, camera, _ = scene_frame(name, count)
    points = project_points(SQUARE, model, camera)
    frame = Frame(splat_codes(SQUARE, points.projected), camera.width, camera.height)
    found = bin_frame(SQUARE, frame)
    drawn, counts = project(model.gaussians(), camera, ORIGINAL)
    assert abs(pairs(found) / counts["pairs_3sigma"] - 1) < 0.05
    drawn = drawn[np.isin(drawn.index, points.index)]
    splats = np.searchsorted(points.index, drawn.index)
    exact, missing = compare_squares(
        SQUARE, frame, found, drawn.centre, radii(drawn.covariance), splats
    )
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
