"""Golden model of stages 0 and 1: packed model and camera to projected Gaussians.

Stage 0 skips chunks and culls points at the near plane. Stage 1 computes x and y of the other
points, culls them at the guard band and projects the rest (`golden.project`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.golden.batches import in_batches
from splatcore.golden.program import Values, run
from splatcore.golden.project import project
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.depth import finer, narrowed
from splatcore.spec.frame import FrameConstants, frame_constants
from splatcore.spec.memory import CHUNK, EXTENT_SHIFT
from splatcore.spec.microprogram import culling, program
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import CORNER_STEPS, CORNERS

RAY = ("ray_x", "ray_y", "ray_z")
"""Names of the vector from the camera to a point, world axes."""

SHARED = ("margin_x", "margin_y", "chunk_reach")
"""Values of a chunk that its points share."""


@dataclass(frozen=True, eq=False)
class Points:
    """A model's Gaussians after each step of stages 0 and 1, in stored order."""

    frame: FrameConstants
    chunks: Values  # [C] values of the chunk program
    read: np.ndarray  # [C] chunks whose points are read
    culled: Values  # [N] values of the cull program, for the points of these chunks
    placed: Values  # [K] values of the place program, for the points that stage 0 kept
    projected: Values  # [M] values of the projection
    points: np.ndarray  # [N] Gaussians in `culled`
    front: np.ndarray  # [K] Gaussians in `placed`
    inside: np.ndarray  # [L] Gaussians that enter the projection
    index: np.ndarray  # [M] Gaussians in `projected`: `inside`; without culling, those in front


def project_points(config: Config, model: PackedModel, camera: Camera) -> Points:
    """Run stages 0 and 1 on a whole model."""
    exponents = model.value("position_exponent"), model.value("factor_exponent")
    frame = frame_constants(config, camera, *exponents, model.antialiased)
    chunks, read = chunk(config, frame, model)
    points = np.flatnonzero(read[np.arange(len(model)) // CHUNK])
    found = in_batches(lambda b: _batch(config, frame, model, chunks, points[b]), len(points))
    culled, placed, projected, *numbers = zip(*found, strict=True)
    values = map(_joined, (culled, placed, projected))
    return Points(frame, chunks, read, *values, points, *map(np.concatenate, numbers))


def _batch(
    config: Config, frame: FrameConstants, model: PackedModel, chunks: Values, points: np.ndarray
) -> tuple[Values | np.ndarray, ...]:
    """Return the fields of `Points` from `culled` on, except `points`, for some of the points."""
    fields = rays(finer(config), frame, model, points)
    fields |= {name: chunks[name][points // CHUNK] for name in SHARED}
    culled, kept = cull(config, frame, fields)
    fields |= {name: culled[name] for name in ("z", "z_low", *RAY)}

    placed, inside = place(config, frame, _take(fields, kept))
    front = points[kept]
    chosen = front[inside]
    shared = _take(_take(fields, kept), inside) | {axis: placed[axis][inside] for axis in "xy"}
    projected = project(config, frame, model, shared, chosen) | {"z_low": shared["z_low"]}
    index = chosen
    if config.culling == "none":
        seen = shared["z"] > frame.near_plane
        arrays = {name: found for name, found in projected.items() if np.ndim(found)}
        projected, index = projected | _take(arrays, seen), chosen[seen]
    return culled, placed, projected, front, chosen, index


def _joined(batches: Sequence[Values]) -> Values:
    """Return the values of all batches together; constants are the same in each."""
    return {
        name: np.concatenate([values[name] for values in batches]) if np.ndim(first) else first
        for name, first in batches[0].items()
    }


def _take(values: Values, chosen: np.ndarray) -> Values:
    return {name: array[chosen] for name, array in values.items()}


def chunk(config: Config, frame: FrameConstants, model: PackedModel) -> tuple[Values, np.ndarray]:
    """Return the values of the chunk program, and which chunks [C] are kept.

    The vectors from the camera to a chunk's ends along the world axes are exact on the grid and
    rounded once, then moved apart. A chunk is skipped if the bounds of its points are behind the
    near plane or beyond the guard band: `place` would drop all of them. No chunk is skipped with
    absolute positions, which have no extent, or without culling. With culling at the near plane
    only, the guard band skips no chunk.
    """
    headers, round_ = model.chunks, config.arithmetic.round
    exponent = model.value("position_exponent")
    low = headers["origin"].astype(np.int64) - frame.camera  # [C, 3] grid steps
    shift = headers["shift"].astype(np.int64) + EXTENT_SHIFT
    high = low + ((headers["extent"].astype(np.int64) + 1) << shift)
    ends = [round_(np.ldexp(end.astype(np.float64), exponent)) for end in (low, high)]
    ends = [outward(config.arithmetic, end, up) for up, end in enumerate(ends)]
    fields: Values = {"chunk_reach": round_(headers["reach"])}
    for name, (constant, side) in CORNERS.items():
        falls = frame.constants[constant] < 0
        fields[name] = ends[falls != (side == "most")][:, int(name[-1])]
    values = run(config, program("chunk"), frame.constants | fields)
    if model.format.position == "absolute" or config.culling == "none":
        return values, np.ones(len(low), bool)
    kept = values["z_high"] > frame.near_plane
    for axis in "xy" if config.culling == "all" else "":
        kept &= values[f"{axis}_low"] <= values[f"far_{axis}"]
        kept &= -values[f"{axis}_high"] <= values[f"far_{axis}"]
    return values, kept


def outward(format: Float, values: np.ndarray, up: int) -> np.ndarray:
    """Move values [N] by `CORNER_STEPS` codes; those at an end of the format stay.

    up: 1 upwards, 0 downwards
    """
    codes = format.encode(values).astype(np.int64)
    exponent = codes >> format.fraction & (1 << format.exponent) - 1
    steps = np.where((values >= 0) == up, CORNER_STEPS, -CORNER_STEPS)
    inside = (exponent > 0) & (exponent < (1 << format.exponent) - 2)
    return format.decode((codes + np.where(inside, steps, 0)).astype(np.uint64))


def rays(config: Config, frame: FrameConstants, model: PackedModel, index: np.ndarray) -> Values:
    """Return the vectors [M] from the camera to Gaussians, scene units, world axes.

    index: [M] the Gaussians They are exact on the grid and rounded once, so points near the camera
    are precise, however large their chunk or the scene.
    """
    way = model.grid[index] - frame.camera  # [M, 3] grid steps
    way = np.ldexp(way.astype(np.float64), model.value("position_exponent"))
    return {f"ray_{axis}": config.arithmetic.round(way[:, k]) for k, axis in enumerate("xyz")}


def cull(config: Config, frame: FrameConstants, points: Values) -> tuple[Values, np.ndarray]:
    """Return the values of the cull program, and which points [N] are kept: z + Δz > near plane.

    points: rays [N] in the format `spec.depth.finer`, and the chunk's shared values Δz is the reach
    of the point's chunk if `Config.depth_interval`, else 0. Without culling all points are kept.
    Rays and z are returned narrowed, z with the low bits z_low.
    """
    fine = finer(config)
    values = run(fine, culling(config.depth_interval), frame.constants | points)
    kept = values["farthest" if config.depth_interval else "z"] > frame.near_plane
    for name in (*RAY, "z"):
        codes, low = narrowed(config, fine.arithmetic.encode(values[name]))
        values[name] = config.arithmetic.decode(codes)
    values["z_low"] = low.astype(np.uint64)
    return values, np.full_like(kept, True) if config.culling == "none" else kept


def place(config: Config, frame: FrameConstants, points: Values) -> tuple[Values, np.ndarray]:
    """Return the values of the place program, and which points [M] are kept.

    points: z, rays and the chunk's shared values [M]
    A point is dropped if its own depth is not beyond the near plane (with a depth interval stage 0
    keeps some such points), or if no Gaussian with its chunk's largest reach could touch the image
    from there: |x| > z·guard + margin. This never drops a visible point (`spec.frame`).
    `Config.culling` leaves out the second test or both.
    """
    values = run(config, program("place"), frame.constants | points)
    kept = values["z"] > frame.near_plane
    if config.culling == "none":
        return values, np.full_like(kept, True)
    for axis in "xy" if config.culling == "all" else "":
        kept &= np.abs(values[axis]) <= values[f"bound_{axis}"]
    return values, kept
