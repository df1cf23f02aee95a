"""Needles far longer than the screen is wide: all digits of the covariance's determinant cancel."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    WIDTH,
    HardCase,
    spread,
    straight_camera,
)

COUNT = 100
LENGTHS = 30, 30 * WIDTH
THIN = 1e-5


def long_needles() -> HardCase:
    """Needles of up to thousands of pixels, 1e5 times as long as thick, in all directions."""
    long = np.geomspace(*LENGTHS, COUNT)[:, None] * DEPTH / FOCAL
    scene = replace(spread(np.random.default_rng(0), COUNT), scale=long * [1, THIN, THIN])
    return HardCase(scene, straight_camera(), "lengths up to 30 times the screen's width")
