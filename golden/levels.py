"""Golden model of the choice of levels: which chunks a view needs (`spec.levels`)."""

from dataclasses import replace

import numpy as np

from splatcore.golden.program import run
from splatcore.spec.camera import LOD_MAX, Camera
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants, frame_constants
from splatcore.spec.levels import jumped, wider
from splatcore.spec.memory import chunk_count, chunk_sizes
from splatcore.spec.microprogram import program
from splatcore.spec.packed import PackedModel

RAY = ("ray_x", "ray_y", "ray_z")
"""Names of the vector from the camera to a point, world axes."""

ROUNDS = 16  # of the bisection in `pixels_for`


def cut(config: Config, frame: FrameConstants, model: PackedModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the chunks [C] of the levels that a view needs, and the first chunk [C] of each group
    whose error was tested (`spec.levels`)."""
    levels = model.levels
    if levels is None:
        count = chunk_count(model.count)
        return np.ones(count, bool), np.zeros(count, bool)
    round_ = config.arithmetic.round
    way = levels["centre"].astype(np.int64) - frame.camera  # [C, 3] grid steps
    ray = round_(np.ldexp(way.astype(np.float64), model.value("position_exponent")))
    fields = dict(zip(RAY, ray.T, strict=True)) | {"inward": -round_(levels["radius"])}
    fields["around"] = round_(levels["around"])
    fields["wide"] = wider(config.arithmetic, frame.constants["guard_x"])
    found = run(config, program("level"), frame.constants | fields)
    coarse, out = levels["error"] > 0, np.zeros(len(ray), bool)
    if model.format.position != "absolute" and config.culling == "all":
        out = coarse & (levels["around"] > 0) & (np.abs(found["aside"]) > found["side"])
    enough = coarse & ~out & (round_(levels["error"]) < found["error_max"])
    visited = ~jumped(levels, enough | out)
    first = coarse & np.append(True, levels["last"][:-1] > 0)[: len(coarse)]
    return visited & (enough | ~coarse), visited & first


def pixels_for(config: Config, model: PackedModel, camera: Camera, most: int) -> float:
    """Return about the smallest `Camera.lod_pixels` with which the chunks of the levels that a view
    needs have at most `most` Gaussians, in view or not; `LOD_MAX` if none is enough."""
    sizes = chunk_sizes(model.count)
    exponents = [model.value(f"{name}_exponent") for name in ("position", "factor")]

    def fits(pixels: float) -> bool:
        view = replace(camera, lod_pixels=pixels)
        drawn, _ = cut(config, frame_constants(config, view, *exponents), model)
        return sizes @ drawn <= most

    if fits(0.0):
        return 0.0
    high = 2.0**-10
    while high < LOD_MAX and not fits(high):
        high *= 2
    low = high / 2
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        low, high = (low, middle) if fits(middle) else (middle, high)
    return min(high, LOD_MAX)
