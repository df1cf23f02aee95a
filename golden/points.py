"""Golden model of stages 0 and 1 together: packed model and camera to projected Gaussians."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.chunk import chunk
from splatcore.golden.cull import cull, rays
from splatcore.golden.place import place
from splatcore.golden.program import Values
from splatcore.golden.project import project
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants, frame_constants
from splatcore.spec.memory import CHUNK
from splatcore.spec.packed import PackedModel

SHARED = ("margin_x", "margin_y", "chunk_reach")
"""Values of a chunk that its points share."""


@dataclass(frozen=True, eq=False)
class Points:
    """A model's Gaussians after each step of stages 0 and 1, in stored order."""

    frame: FrameConstants
    chunks: Values  # [C] of the chunk program
    read: np.ndarray  # [C] chunks whose points are read
    culled: Values  # [N] of the cull program, for the points of those chunks
    placed: Values  # [K] of the place program, for what stage 0 kept
    projected: Values  # [M] of the projection
    points: np.ndarray  # [N] which Gaussians
    front: np.ndarray  # [K] which Gaussians
    inside: np.ndarray  # [L] which Gaussians are projected
    index: np.ndarray  # [M] which Gaussians' splats are in front: all, if any point was culled


def project_points(config: Config, model: PackedModel, camera: Camera) -> Points:
    """Stages 0 and 1 on a whole model."""
    frame = frame_constants(
        config, camera, model.value("position_exponent"), model.value("factor_exponent")
    )
    chunks, read = chunk(config, frame, model)
    points = np.flatnonzero(read[np.arange(len(model)) // CHUNK])
    fields = rays(config, frame, model, points)
    fields |= {name: chunks[name][points // CHUNK] for name in SHARED}
    culled, kept = cull(config, frame, fields)
    fields["z"] = culled["z"]

    placed, inside = place(config, frame, _take(fields, kept))
    front = points[kept]
    chosen = front[inside]
    shared = _take(_take(fields, kept), inside) | {axis: placed[axis][inside] for axis in "xy"}
    projected = project(config, frame, model, shared, chosen)
    index = chosen
    if config.culling == "none":
        seen = shared["z"] > frame.near_plane
        arrays = {name: found for name, found in projected.items() if np.ndim(found)}
        projected, index = projected | _take(arrays, seen), chosen[seen]
    return Points(frame, chunks, read, culled, placed, projected, points, front, chosen, index)


def _take(values: Values, chosen: np.ndarray) -> Values:
    return {name: array[chosen] for name, array in values.items()}
