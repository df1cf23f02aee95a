"""The point half of the machine, composed: packed model and camera to projected Gaussians."""

from dataclasses import dataclass

import numpy as np

from golden.cull import chunk_constants, cull, scaled_offsets
from golden.place import place
from golden.program import Values, run
from spec.camera import Camera
from spec.config import Config
from spec.error import InputError
from spec.frame import FrameConstants, frame_constants
from spec.memory import CHUNK
from spec.microprogram import projection
from spec.packed import PackedModel

AXES = "xyz"
CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class Points:
    """What stages 0 and 1 make of a model's Gaussians, in stored order."""

    frame: FrameConstants
    chunks: Values  # [C] of the chunk program
    culled: Values  # [N] fields and depth of all points
    placed: Values  # [K] of the place program, for what stage 0 kept
    projected: Values  # [M] of the projection, for what the guard band kept
    front: np.ndarray  # [K] which Gaussians
    index: np.ndarray  # [M] which Gaussians


def project_points(config: Config, model: PackedModel, camera: Camera) -> Points:
    """Stages 0 and 1 on a whole model with chunk positions."""
    if model.format.position != "chunk":
        raise InputError(f"{model.name}: absolute positions are not supported by the twins yet")
    frame = frame_constants(
        config, camera, model.value("position_exponent"), model.value("factor_exponent")
    )
    headers = model.chunks
    chunks = chunk_constants(config, frame, headers["origin"].astype(np.int64), headers["reach"])
    of = np.arange(len(model)) // CHUNK
    points = scaled_offsets(config, model.offsets, headers["shift"][of].astype(np.int64))
    points |= {name: values[of] for name, values in chunks.items() if np.ndim(values)}
    depth, kept = cull(config, frame, points, points["chunk_reach"])
    points["z"] = depth

    front = np.flatnonzero(kept)
    placed, inside = place(config, frame, _take(points, front))
    index = front[inside]
    fields = _take(points, index) | {axis: placed[axis][inside] for axis in "xy"}
    fields |= attribute_fields(config, model, index)
    projected = run(
        config, projection(model.format.sh_degree, config.skip_zeros), frame.constants | fields
    )
    return Points(frame, chunks, points, placed, projected, front, index)


def _take(values: Values, index: np.ndarray) -> Values:
    return {name: array[index] for name, array in values.items()}


def attribute_fields(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """The projection's fields that come from the attributes of Gaussians `index` [M]."""
    round_ = config.arithmetic.round
    fields: Values = {"attenuation": model.attributes["opacity"][index].astype(np.float64)}
    factor = np.ldexp(model.factor[index], -model.value("factor_exponent"))
    for row in range(3):
        fields |= {f"l{row}{k}": round_(factor[:, row, k]) for k in range(row + 1)}
    if model.format.sh_degree:
        colour, slopes = round_(model.colour[index]), round_(model.slopes[index])
        for c, channel in enumerate(CHANNELS):
            fields[f"colour_{channel}"] = colour[:, c]
            fields |= {f"g_{channel}_{axis}": slopes[:, c, k] for k, axis in enumerate(AXES)}
    return fields
