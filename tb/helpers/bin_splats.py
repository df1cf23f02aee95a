"""Random splats for binning, computed by stage 1's own steps from a covariance on."""

from functools import cache

import numpy as np

from splatcore.golden.points import splat_codes
from splatcore.golden.program import run
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.convention import COVARIANCE_BLUR, TILE
from splatcore.spec.depth import low_bits
from splatcore.spec.frame import fixed_constants
from splatcore.spec.memory import OPACITY
from splatcore.spec.microprogram import Program, parse
from splatcore.spec.programs import FACTORS, SHAPE
from splatcore.spec.record import Codes

KINDS = ("common", "tiny", "needle", "flat", "huge", "beside", "far", "faint", "vast")
"""Kinds of splats, defined in `splats`."""

FADED = "faded"
"""Another kind, for machines that compensate opacities: some are compensated to invisible."""

NEAREST = 1e-7  # a depth below the smallest near plane, whose key is 0


@cache
def conic(tile_test: str) -> Program:
    """The part of the projection after the covariance."""
    return Program("conic", parse(FACTORS + SHAPE[tile_test]), ())


def between(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    """Numbers [N] with uniformly distributed logarithms."""
    return np.exp(rng.uniform(np.log(low), np.log(high), count))


def splats(config: Config, kind: str, count: int, size: tuple[int, int], seed: int = 0) -> Codes:
    """Random codes [N] of `splat_record` for an image of `size` pixels."""
    rng = np.random.default_rng([seed, (*KINDS, FADED).index(kind)])
    side = max(*size, TILE)
    sigma = {
        "common": (0.3, side / 8), "tiny": (1e-3, 0.5), "needle": (side / 50, side),
        "huge": (side / 4, 4 * side), "vast": (4 * side, 1e5), "far": (1, 3 * side),
    }.get(kind, (0.3, side / 4))  # fmt: skip
    long = between(rng, *sigma, count)
    thin = {"needle": (1e-5, 1e-2), "flat": (1e-4, 1)}.get(kind, (0.05, 1))
    short = long * between(rng, *thin, count)
    angle = rng.uniform(-np.pi, np.pi, count)
    if kind == "flat":  # nearly along an axis of the image
        angle = rng.choice([0, np.pi / 2], count) + rng.normal(0, 0.02, count)
    away = {"beside": 2.0, "far": 8.0, "vast": 4.0}.get(kind, 0.55)
    u, v = (rng.uniform(0.5 - away, 0.5 + away, count) * pixels for pixels in size)
    attenuation = rng.integers(0, 64, count)
    if kind == "faint":
        attenuation = rng.integers((1 << OPACITY.width) - 24, 1 << OPACITY.width, count)
    if kind == FADED:  # around 1/255
        attenuation = rng.choice([250, 255, 255.75, 255.875, 256, 300, 767], count)

    c, s, unit = np.cos(angle), np.sin(angle), 2.0**-config.screen_exponent
    covariance = {
        "xx": (c * long) ** 2 + (s * short) ** 2 + COVARIANCE_BLUR,
        "xy": c * s * (long**2 - short**2),
        "yy": (s * long) ** 2 + (c * short) ** 2 + COVARIANCE_BLUR,
    }
    inputs = {name: value * unit**2 for name, value in covariance.items()}
    inputs |= fixed_constants(config) | {"u": u * unit, "v": v * unit}
    inputs |= {"attenuation": attenuation, "z": between(rng, NEAREST, 1e4, count)}
    inputs |= {name: rng.normal(0.5, 1, count) for name in CHANNELS}
    inputs = {name: config.arithmetic.round(value) for name, value in inputs.items()}
    inputs |= run(config, conic(config.tile_test), inputs)
    low = rng.integers(0, 1 << low_bits(config), count).astype(np.uint64)
    return splat_codes(config, inputs | {"z_low": low})


def together(*parts: Codes) -> Codes:
    """Concatenate splats."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
