"""Pixels with alpha: the golden model against the float reference, and against its own pixels
without alpha."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.choose import finest
from splatcore.spec.camera import Camera
from splatcore.spec.colour import background_codes
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.pixel import alpha_code
from tb.helpers.bounds import RULE
from tb.helpers.machines import garden

MACHINE = replace(DEFAULT, name="ALPHA", rgba=True)

LEVELS, RMS = 3.0, 0.6
"""Maximum error of alpha, and its RMS, in levels of 255, against the reference with the faintness
rule; against 3DGS's rule it is 2^−dark of 255 more."""

CASES = ("antialiased_edge_on", "fog", "needles", "saturated_colours", "empty")

COLOUR = (0.2, 0.6, 1.0)


@cache
def needles() -> tuple[PackedModel, Camera]:
    case = HARD["needles"](0)
    return pack(case.scene, MACHINE)[0], case.camera


def frame(background=(0, 0, 0), rgba: bool = True) -> np.ndarray:
    """Return the golden model's pixels."""
    return render(MACHINE, *needles(), background, rgba).pixels


@pytest.mark.parametrize("bits", [12, 16, 20])
def test_code(bits):
    """Rounded to nearest for every T, with both ends exact."""
    rest = np.arange(1 << bits)
    code = alpha_code(replace(DEFAULT, transmittance=bits), rest)
    taken = (1 << bits) - 1 - rest
    assert (2 * abs(255 * taken - (code << bits)) <= 1 << bits).all()
    assert code[-1] == 0 and code[0] == 255 and (np.diff(code) <= 0).all()
    assert abs(code - 255 * (1 - rest / (1 << bits))).max() <= 0.5 + 255 / (1 << bits)


def errors(pixels: np.ndarray, reference: np.ndarray) -> np.ndarray:
    return pixels[..., 3] - 255 * reference[..., 3]


@pytest.mark.parametrize("name", CASES)
def test_against_the_reference(name):
    case = HARD[name](0)
    model, _ = pack(case.scene, MACHINE, quality=finest(case.scene, MACHINE))
    pixels = render(MACHINE, model, case.camera, rgba=True).pixels
    for rule, more in ((RULE, 0), (SPLATCORE, 255 * 2.0**-MACHINE.faint.dark)):
        exact = render_reference(model.gaussians(), case.camera, rule, rgba=True)
        assert np.array_equal(exact.image[..., 3], 1 - exact.transmittance)
        error = errors(pixels, exact.image)
        assert abs(error).max() <= LEVELS + more
        assert more or np.sqrt(np.mean(error**2)) <= RMS


def test_no_background():
    """A background changes nothing with alpha; the colour is the picture's on black."""
    codes = background_codes(MACHINE, COLOUR)
    pixels, black = frame(), frame(rgba=False)
    assert np.array_equal(pixels, frame(codes))
    assert np.array_equal(pixels[..., :3], black)
    assert not np.array_equal(black, frame(codes, rgba=False))
    model, camera = needles()
    coloured = replace(SPLATCORE, background=COLOUR)
    one, other = (
        render_reference(model.gaussians(), camera, rule, rgba=True).image
        for rule in (SPLATCORE, coloured)
    )
    assert np.array_equal(one, other) and one.shape == pixels.shape


def test_over_a_background():
    """The picture over a background is the machine's own with that background, to roundings."""
    pixels, own = frame().astype(float), frame(background_codes(MACHINE, COLOUR), rgba=False)
    over = pixels[..., :3] + (255 - pixels[..., 3:]) * COLOUR
    assert np.abs(np.minimum(over, 255) - own).max() <= 2
    assert np.ptp(pixels[..., 3]) > 100


def test_other_machines_are_refused():
    with pytest.raises(InputError, match="preset DEFAULT: rgba is false"):
        render(DEFAULT, garden(DEFAULT, 10), needles()[1], rgba=True)
