"""Hard cases of faint splats: many of them, one behind the other."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    HEIGHT,
    WIDTH,
    behind_pixel,
    hard_case,
    sh_of_colour,
    spread,
    together,
)
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.scene import Scene

FOG, FOG_ALPHA = 5_000, 1.2 * ALPHA_MIN
LAYERS = 92
EACH, SHARE = 2.0**-11, (0.95, 1.05)
"""Decrease of T that is just too faint, and the shares of it of a black and of a white layer."""

DIM = 0.9, 0.7  # opacities of two layers that reduce T to 0.03, just below 1/32
WIDE = 20.0  # standard deviations of a layer, in widths of the view


def layers(colours: np.ndarray, opacity: np.ndarray, depth: np.ndarray) -> Scene:
    """Splats far larger than the view, one behind the other, with colours [N, 3]."""
    count = len(depth)
    place = behind_pixel((WIDTH - 1) / 2, (HEIGHT - 1) / 2, depth)
    scale = np.tile(WIDE * depth[:, None], (1, 3)) * [1, 1, 1e-4]
    turn = np.tile([1.0, 0, 0, 0], (count, 1))
    return Scene(place, scale, turn, opacity, sh_of_colour(colours))


def dimming(depths: tuple[float, float]) -> Scene:
    """Two grey layers behind which T is just below 1/32."""
    return layers(np.full((2, 3), 0.4), np.array(DIM), np.array(depths))


@hard_case("a fog of 5,000 splats of alpha just above 1/255 behind T of 1/32, bright before black")
def fog(rng: np.random.Generator) -> Scene:
    scene = spread(rng, FOG, np.sort(rng.uniform(3, 30, FOG)), pixels=(8.0, 30.0))
    white = sh_of_colour(np.where(np.arange(FOG)[:, None] < FOG // 2, 1.0, 0.0) * np.ones(3))
    return together(dimming((2.0, 2.5)), replace(scene, opacity=np.full(FOG, FOG_ALPHA), sh=white))


@hard_case(
    "black and white layers in turn at T of 1/32: black ones are just too faint, white ones not"
)
def alternating_layers(rng: np.random.Generator) -> Scene:
    depth = np.linspace(3, 12, LAYERS)
    white = np.arange(LAYERS) % 2
    taken = EACH * np.array(SHARE)[white]
    before = (1 - DIM[0]) * (1 - DIM[1]) - np.cumsum(taken * white) + taken * white
    colours = white[:, None] * np.ones(3) - rng.uniform(0, 0.01, (LAYERS, 3)) * white[:, None]
    return together(dimming((2.0, 2.5)), layers(colours, taken / before, depth))
