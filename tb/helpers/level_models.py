"""Models with levels of detail for tests, and models with other records in them."""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.config import Config
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import CHUNK, REACH, chunk_count
from splatcore.spec.packed import PackedModel
from tb.helpers.clouds import cloud
from tb.helpers.model_bits import with_checksum


@cache
def clouds(
    config: Config, chunks: int, spread: float = 1.0, size: float = 1.0
) -> tuple[PackedModel, PackedModel]:
    """A cloud of `chunks` chunks without levels, and with them. size: factor of the Gaussians'"""
    scene = cloud(1, chunks * CHUNK - 30, degree=1, spread=spread)
    scene = replace(scene, scale=size * scene.scale)
    plain, _ = pack(scene, config, quality="compact")
    return plain, with_levels(plain, config)[0]


def views(count: int) -> list[Camera]:
    """Cameras around and inside of a cloud, narrow and wide."""
    rng, sizes = np.random.default_rng(0), [(64, 48), (640, 100), (48, 400)]
    found = []
    for k in range(count):
        place, at = rng.normal(size=3) * rng.choice([0.5, 2, 5, 30]), rng.normal(size=3) * 2
        found.append(look_at(place, at, *sizes[k % 3], rng.choice([5.0, 60.0, 140.0])))
    return found


def edited(model: PackedModel, **fields: np.ndarray | int) -> np.ndarray:
    """The model's bytes with other codes [C] in fields of its records."""
    image, start = model.image.copy(), model.layout.chunks
    rows = image[start : model.layout.positions]
    count, stride = len(model.levels["jump"]), model.format.header_stride
    rows = rows[: count * stride].reshape(count, stride)[:, : LEVEL.size]
    codes = LEVEL.unpack(np.ascontiguousarray(rows))
    for field, values in fields.items():
        codes[field][...] = values
    rows[:] = LEVEL.pack(codes)
    return image


def with_records(model: PackedModel, **fields: np.ndarray | int) -> PackedModel:
    """The model with other codes [C] in fields of its records."""
    return with_checksum(edited(model, **fields), "edited")


LIMIT = 2.0**-6
"""Largest error with which `STRAIGHT` draws a group of `at_depth_one`, at one pixel."""

STRAIGHT = Camera(64, 48, 64.0, 32.0, 32.0, 24.0, np.eye(3), np.zeros(3), lod_pixels=1.0)


def at_depth_one(model: PackedModel, **fields: np.ndarray | int) -> PackedModel:
    """The model with all spheres' nearest points at depth 1 of `STRAIGHT`.

    fields: codes [C] of groups
    """
    centre = np.zeros((chunk_count(model.count), 3))
    centre[:, 2] = 1.5 * 2.0 ** -model.value("position_exponent")
    coarse = model.levels["error"] > 0
    fields = {name: np.where(coarse, codes, 0) for name, codes in fields.items()}
    radius = int(REACH.encode(0.5))
    return with_records(model, centre=LEVEL["centre"].encode(centre), radius=radius, **fields)


def ties(model: PackedModel) -> PackedModel:
    """The model with errors of groups equal to `LIMIT`, or the next smaller ones."""
    limit, last = int(REACH.encode(LIMIT)), model.levels["last"] > 0
    of = np.cumsum(np.append(True, last[:-1]))  # number of the chunk's group
    return at_depth_one(model, error=limit - (of % 3 == 0))
