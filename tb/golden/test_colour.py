"""The golden model's colours against float64, within an error bound per Gaussian."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.colour import colours, polynomials, rounded
from splatcore.golden.reference import harmonics
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.spec.colour import CHANNELS, FOLDED, LAYOUTS, POLYNOMIAL, unscaled_colour_format
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.memory import CHUNK
from tb.helpers.bounds import HARMONICS
from tb.helpers.clouds import cloud

ERROR = {1: 2, 2: 4, 3: 8}
RMS = {1: 0.5, 2: 0.7, 3: 0.9}
"""Bounds on the error of the polynomials per degree, in steps of `POLYNOMIAL` (measured over two
million directions: at most 1.7, 3.5 and 7.1; RMS 0.4, 0.6 and 0.8)."""

FLOOR = 2.0**-11
"""Bound on the rounding error: seven terms truncated at 2^−14, the colour rounded at 2^−12."""


def directions(count: int, seed: int = 0) -> np.ndarray:
    """Return vectors [count, 3] of length 2^−8 … 2^12, including axes and planes between axes."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, 3))
    ways[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    for axis in range(3):
        ways[6 + 10 * axis : 16 + 10 * axis, axis] = 0
    return ways * 2.0 ** rng.uniform(-8, 12, (count, 1))


def rays(ways: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return rays in stage 1's format, and the unit vectors [N, 3] that they represent."""
    held = DEFAULT.arithmetic.round(ways)
    unit = held / np.linalg.norm(held, axis=1, keepdims=True)
    return {f"ray_{axis}": held[:, k] for k, axis in enumerate("xyz")}, unit


def test_polynomials():
    found, unit = rays(directions(20_000))
    exact = harmonics(unit, 3)
    made = np.concatenate(polynomials(DEFAULT, found), axis=1) * POLYNOMIAL.step
    for degree, bound in ERROR.items():
        own = slice(degree**2, (degree + 1) ** 2)
        errors = made[:, degree**2 - 1 : (degree + 1) ** 2 - 1] - exact[:, own] / FOLDED[degree]
        assert np.abs(errors).max() <= bound * POLYNOMIAL.step
        assert np.sqrt((errors**2).mean()) <= RMS[degree] * POLYNOMIAL.step
        assert np.abs(errors.mean()) <= 0.1 * POLYNOMIAL.step


def check(config, model):
    """Check that a model's colours are exact within the polynomials' bound times its factors."""
    index = np.arange(len(model))
    found, unit = rays(directions(len(model), 1))
    made = colours(config, model.decoded(index), found)
    assert list(made) == list(CHANNELS)
    factors = model.factors
    exact = COLOUR_OFFSET + factors[0][:, 0]
    bound = np.full_like(exact, FLOOR)
    for degree, f in enumerate(factors[1:], 1):
        own = slice(degree**2, (degree + 1) ** 2)
        exact += np.einsum("nk,nkc->nc", harmonics(unit, degree)[:, own] / FOLDED[degree], f)
        bound += np.abs(f).sum(1) * ERROR[degree] * POLYNOMIAL.step
    exact = np.clip(exact, 0, unscaled_colour_format(config).max)
    assert (np.abs(np.stack(list(made.values()), axis=1) - exact) <= bound).all()


@pytest.mark.parametrize("bits", [-2, 0, 1, 4])
def test_rounding(bits):
    """Round to nearest, halves up."""
    total = np.arange(-40, 40)
    assert (rounded(total, bits) == np.floor(total / 2.0**bits + 0.5)).all()


@pytest.mark.parametrize("quality", ["balanced", "faithful"])
@pytest.mark.parametrize("name", HARMONICS)
def test_hard_cases(name, quality):
    check(DEFAULT, pack(HARD[name](0).scene, quality=quality)[0])


def test_no_direction():
    """A Gaussian at the camera's position has no direction: polynomials as of (0, 0, 0)."""
    nowhere = {f"ray_{axis}": np.zeros(1) for axis in "xyz"}
    found = np.concatenate(polynomials(DEFAULT, nowhere), axis=1)[0] * POLYNOMIAL.step
    assert list(found) == [0, 0, 0, 0, 0, -0.5, *9 * [0]]


@pytest.mark.parametrize("quality", ["compact", "balanced", "faithful", "mixed"])
@pytest.mark.parametrize("degree", range(4))
def test_colours(quality, degree):
    scene = cloud(degree, count=5 * CHUNK + 9, degree=degree)
    scene.opacity[:] = 0.5
    scene.sh[::7] *= 20  # clamped at both ends from some directions
    if quality == "mixed":
        kinds = [k for k, layout in enumerate(LAYOUTS) if not (layout.halves and degree < 3)]
        quality = np.resize(kinds, 6)
    config = replace(DEFAULT, sh_degree=degree)
    check(config, pack(scene, config, quality=quality)[0])
    if degree < 3:  # a machine of a higher degree makes the same colours
        check(DEFAULT, pack(scene, config, quality=quality)[0])


def test_steps_at_their_ends():
    """Tiny and huge colours: E, s and the Gaussians' own shifts reach their limits."""
    scene = cloud(9, count=8 * CHUNK, degree=3)
    scene.opacity[:] = 0.5
    size = 2.0 ** np.linspace(-14, 9, len(scene))
    rank = np.argsort(np.argsort(scene.position[:, 2]))
    scene = replace(scene, sh=scene.sh * size[rank][:, None, None])
    model, _ = pack(scene, quality="faithful")
    assert model.chunks["step"].min() == 0 and model.chunks["step"].max() >= 13
    check(DEFAULT, model)
