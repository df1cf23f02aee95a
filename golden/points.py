"""Golden model of stages 0 and 1: packed model and camera to projected Gaussians.

Stage 0 skips chunks, those of levels that the view does not need (`spec.levels`) and those out of
view, and culls points at the near plane. Stage 1 computes x and y of the other points, culls them
at the guard band and projects the rest (`golden.project`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.golden.batches import in_batches
from splatcore.golden.codes import decode, encode, round_values
from splatcore.golden.levels import RAY, cut
from splatcore.golden.program import Values, run
from splatcore.golden.project import project
from splatcore.spec.camera import Camera
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.depth import finer, narrowed
from splatcore.spec.frame import FrameConstants, frame_constants
from splatcore.spec.memory import CHUNK, EXTENT_SHIFT, chunk_sizes
from splatcore.spec.microprogram import culling, program
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.point import splat_record
from splatcore.spec.programs import CORNER_STEPS, CORNERS
from splatcore.spec.record import Codes

SHARED = ("margin_x", "margin_y", "chunk_reach")
"""Values of a chunk that its points share."""


CULLED, FRONT, INSIDE, SPLAT = range(4)
"""The last step of a point: culled by stage 0, outside the guard band, projected, a splat."""


@dataclass(frozen=True, eq=False)
class Points:
    """A model's Gaussians after each step of stages 0 and 1, in stored order."""

    frame: FrameConstants
    chunks: Values  # [C] values of the chunk program
    drawn: np.ndarray  # [C] chunks of the levels that the view needs
    tested: np.ndarray  # [C] first chunks of the groups whose error is tested
    read: np.ndarray  # [C] chunks whose points are read
    step: np.ndarray  # [N] uint8, the last step of each point of these chunks
    inside: np.ndarray  # [L] Gaussians that enter the projection
    index: np.ndarray  # [M] Gaussians in `projected`: `inside`; without culling, those in front
    codes: Codes  # [M] of `splat_record`
    projected: Values  # [M] values of the projection
    culled: Values  # [N] values of the cull program, for the points that are read
    placed: Values  # [K] values of the place program, for the points that stage 0 kept

    @property
    def points(self) -> np.ndarray:
        """Gaussians [N] of the chunks that are read."""
        return numbers(np.flatnonzero(self.read), np.arange(len(self.step)))

    @property
    def front(self) -> np.ndarray:
        """Gaussians [K] that stage 0 kept."""
        return numbers(np.flatnonzero(self.read), np.flatnonzero(self.step >= FRONT))


def project_points(
    config: Config, model: PackedModel, camera: Camera, whole: bool = True
) -> Points:
    """Run stages 0 and 1 on a whole model.

    whole: keep the values of the point programs too
    """
    exponents = model.value("position_exponent"), model.value("factor_exponent")
    frame = frame_constants(config, camera, *exponents, model.antialiased)
    chunks, read = chunk(config, frame, model)
    drawn, tested = cut(config, frame, model)
    read &= drawn
    kept, count = np.flatnonzero(read), int(chunk_sizes(model.count) @ read)

    def work(batch: slice) -> tuple[Values | Codes | np.ndarray, ...]:
        points = numbers(kept, np.arange(*batch.indices(count)))
        return _batch(config, frame, model, chunks, points, whole)

    step, inside, index, *fields = zip(*in_batches(work, count), strict=True)
    arrays = map(np.concatenate, (step, inside, index))
    return Points(frame, chunks, drawn, tested, read, *arrays, *map(_joined, fields))


def numbers(chunks: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the Gaussians [M] at some places in the row of all Gaussians of chunks [C]."""
    of, place = np.divmod(places, CHUNK)
    return chunks[of] * CHUNK + place


def _batch(
    config: Config, frame: FrameConstants, model: PackedModel, chunks: Values, points: np.ndarray,
    whole: bool,
) -> tuple[Values | Codes | np.ndarray, ...]:  # fmt: skip
    """Return the fields of `Points` from `step` on for some of the points."""
    fields = rays(finer(config), frame, model, points)
    fields |= {name: chunks[name][points // CHUNK] for name in SHARED}
    culled, kept = cull(config, frame, fields)
    fields |= {name: culled[name] for name in ("z", "z_low", *RAY)}
    fields = _take(fields, kept)
    placed, inside = place(config, frame, fields)
    chosen = points[kept][inside]
    shared = _take(fields, inside) | {axis: placed[axis][inside] for axis in "xy"}
    projected = project(config, frame, model, shared, chosen) | {"z_low": shared["z_low"]}
    seen = np.ones(len(chosen), bool)
    if config.culling == "none":
        seen = shared["z"] > frame.near_plane
        arrays = {name: found for name, found in projected.items() if np.ndim(found)}
        projected |= _take(arrays, seen)
    step = kept.astype(np.uint8)
    step[kept] += inside
    step[np.flatnonzero(step == INSIDE)[seen]] = SPLAT
    values = (projected, culled, placed) if whole else ({}, {}, {})
    return step, chosen, chosen[seen], splat_codes(config, projected), *values


def splat_codes(config: Config, values: Values) -> Codes:
    """Return the codes of `splat_record`, from the values of `golden.project`."""
    found = dict(values)
    for channel in CHANNELS:
        found.setdefault(channel, found.get(f"colour_{channel}"))
    return {
        name: encode(format, found[name])
        if isinstance(format, Float)
        else format.encode(found[name])
        for name, format in splat_record(config).fields
    }


def _joined(batches: Sequence[Values | Codes]) -> Values | Codes:
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
    fields: Values = dict.fromkeys(("chunk_reach", "reach_y"), round_(headers["reach"]))
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
    way = model.stored(index).grid - frame.camera  # [M, 3] grid steps
    way = np.ldexp(way.astype(np.float64), model.value("position_exponent"))
    return {
        f"ray_{axis}": round_values(config.arithmetic, way[:, k]) for k, axis in enumerate("xyz")
    }


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
        codes, low = narrowed(config, encode(fine.arithmetic, values[name]))
        values[name] = decode(config.arithmetic, codes)
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
