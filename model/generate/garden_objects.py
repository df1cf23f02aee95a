"""The garden's objects: a wooden bench, a picket fence, a stone bird bath."""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.model.generate.directions import frames, random_directions, unit
from splatcore.model.generate.garden_splats import Part, deal, join, share_out, splats
from splatcore.model.generate.spreading import GOLDEN_ANGLE, even_pairs, noise

BENCH_PLACE, BENCH_TURN = np.array([1.95, 0.75]), np.radians(-32.0)
"""Plane point (x, z) and turn about the vertical, radians; without a turn the bench faces −z."""

BATH_PLACE = np.array([-0.55, -0.55])
FENCE_Z = 3.3

FACES = np.array([[0, 1, 2], [0, 2, 1], [1, 2, 0]])
"""Axes of each pair of opposite box faces: two in the face, and its normal."""


@dataclass(frozen=True)
class Box:
    """A plank; its grain runs along the longest axis."""

    middle: tuple[float, float, float]  # (x, height, z), scene units
    half: tuple[float, float, float]  # half sizes along its own axes, scene units
    tilt: float = 0.0  # turn about its own x axis (a leaning backrest), radians


def turned(point: np.ndarray, angle: float) -> np.ndarray:
    """Turn points [..., 3] about the vertical axis by `angle` radians (x towards z)."""
    c, s = np.cos(angle), np.sin(angle)
    return point @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def planks(rng: np.random.Generator, count: int, boxes: list[Box], colour: np.ndarray) -> Part:
    """Flat disks on the faces of boxes, stretched along the grain; they do not cross edges.

    colour: [boxes, 3] linear RGB
    Returns coordinates (x, −height, z), before any turn of the object.
    """
    half = np.array([b.half for b in boxes])
    area = (half[:, FACES[:, 0]] * half[:, FACES[:, 1]]).repeat(2, axis=1)  # [boxes, 6]
    number = share_out(count, area.ravel())
    face, rank = deal(number)
    box, pair, sign = face // 6, face % 6 // 2, 2.0 * (face % 2) - 1
    side = half[box]
    along = np.argmax(side, axis=1)
    axes = FACES[pair]
    swap = axes[:, 1] == along  # the axis of the grain first, if it is in the face
    first, second = np.where(swap, axes[:, 1], axes[:, 0]), np.where(swap, axes[:, 0], axes[:, 1])
    rows = np.arange(count)
    spacing = np.sqrt(4 * area.ravel()[face] / np.maximum(number[face], 1))
    long = np.minimum(2.0 * spacing, 0.25 * side[rows, first])
    short = 0.34 * spacing * np.maximum(2 * spacing / long, 1)
    short = np.minimum(short, 0.45 * side[rows, second])
    spread = even_pairs(number.max(initial=1))[rank] + rng.random((count, 2)) * 0.5
    spread = 1 - 2 * np.abs(2 * np.modf(spread)[0] - 1)
    local = np.zeros((count, 3))
    local[rows, first] = spread[:, 0] * (side[rows, first] - 1.6 * long)
    local[rows, second] = spread[:, 1] * (side[rows, second] - short)
    local[rows, axes[:, 2]] = sign * side[rows, axes[:, 2]]
    tilt = np.array([b.tilt for b in boxes])[box]
    middle = np.array([b.middle for b in boxes])[box]
    grain = local[rows, second] + box * 3.7
    streak = noise(local[rows, first] * 2 + box, grain * 40, seed=51)[:, None]
    albedo = np.asarray(colour)[box] * (0.6 + 0.8 * streak)
    scale = np.stack([long, short, np.full(count, 0.004)], axis=1)
    eye = np.eye(3)
    aim = frames(_leaning(sign[:, None] * eye[axes[:, 2]], tilt), _leaning(eye[first], tilt))
    position = _leaning(local, tilt) + middle * [1, -1, 1]
    return splats(position, scale, aim, rng.uniform(0.86, 1.0, count), albedo, gloss=0.06)


def _leaning(vector: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Turn plank coordinates [N, 3] (x, height, z) about x by `tilt` [N]; as (x, −height, z)."""
    x, height, z = vector.T
    c, s = np.cos(tilt), np.sin(tilt)
    return np.stack([x, z * s - height * c, height * s + z * c], axis=1)


def moved(part: Part, place: np.ndarray, angle: float) -> Part:
    """Turn a part about the vertical, then shift it by the plane vector `place` (x, z)."""
    position = turned(part.position, angle) + np.array([place[0], 0, place[1]])
    columns = turned(np.moveaxis(part.frame, 1, 2), angle)  # [N, column, 3]
    return replace(part, position=position, frame=np.moveaxis(columns, 2, 1))


def bench(rng: np.random.Generator, count: int) -> Part:
    """A garden bench: four seat planks, three in the leaning back, two sides with arm rests."""
    boxes = [Box((0, 0.47, -0.24 + 0.125 * i), (0.78, 0.016, 0.053)) for i in range(4)]
    back = (0.78, 0.055, 0.014)
    boxes += [Box((0, 0.60 + 0.14 * i, 0.22 + 0.035 * i), back, tilt=0.24) for i in range(3)]
    for x in (-0.68, 0.68):
        boxes += [
            Box((x, 0.33, -0.25), (0.032, 0.34, 0.032)),
            Box((x, 0.48, 0.235), (0.032, 0.50, 0.030), tilt=0.20),
            Box((x, 0.42, -0.03), (0.026, 0.036, 0.24)),
            Box((x, 0.685, -0.06), (0.042, 0.018, 0.27)),
            Box((x, 0.14, 0.0), (0.022, 0.028, 0.22)),
        ]
    tone = np.random.default_rng(rng.integers(2**32)).uniform(0.8, 1.15, (len(boxes), 1))
    wood = planks(rng, count, boxes, tone * np.array([0.40, 0.205, 0.085]))
    return moved(wood, BENCH_PLACE, BENCH_TURN)


def fence(rng: np.random.Generator, count: int) -> Part:
    """White pickets on two rails, with a gap for the path between two posts."""
    layout = np.random.default_rng(rng.integers(2**32))
    gate = (-0.42, 0.72)
    pickets = [x for x in np.arange(-5.6, 5.6, 0.2) if not gate[0] < x < gate[1]]
    boxes = []
    for x in pickets:
        tall = 0.40 + 0.02 * np.sin(1.3 * x) + layout.uniform(-0.012, 0.012)
        boxes.append(Box((x, tall + 0.04, FENCE_Z), (0.058, tall, 0.011)))
        boxes.append(Box((x, 2 * tall + 0.06, FENCE_Z), (0.028, 0.03, 0.011)))
    for low, high in ((-5.65, gate[0]), (gate[1], 5.65)):
        middle, half = (low + high) / 2, (high - low) / 2
        boxes += [Box((middle, h, FENCE_Z + 0.03), (half, 0.035, 0.016)) for h in (0.26, 0.64)]
    boxes += [Box((x, 0.52, FENCE_Z), (0.065, 0.52, 0.065)) for x in gate]
    boxes += [Box((x, 1.06, FENCE_Z), (0.085, 0.022, 0.085)) for x in gate]
    tone = layout.uniform(0.78, 1.0, (len(boxes), 1))
    return planks(rng, count, boxes, tone * np.array([0.70, 0.68, 0.62]))


def revolution(
    rng: np.random.Generator, count: int, profile: np.ndarray, colour: np.ndarray
) -> Part:
    """Disks on a surface of revolution.

    profile: [P, 2] (radius, height); normals point to the right of its direction, which is outwards
        where the profile goes up
    colour: linear RGB
    """
    start, step = profile[:-1], np.diff(profile, axis=0)
    length = np.linalg.norm(step, axis=1)
    area = 2 * np.pi * (start[:, 0] + step[:, 0] / 2) * length
    pick = (np.arange(count) + 0.5) / max(count, 1) * area.sum()
    edge = np.concatenate([[0], np.cumsum(area)])
    piece = np.clip(np.searchsorted(edge, pick, side="right") - 1, 0, len(area) - 1)
    share = ((pick - edge[piece]) / area[piece])[:, None]
    radius, height = (start[piece] + share * step[piece]).T
    angle = np.arange(count) * GOLDEN_ANGLE
    c, s = np.cos(angle), np.sin(angle)
    tangent = unit(np.stack([step[piece, 0], step[piece, 1], np.zeros(count)], axis=1))
    out, rise = tangent[:, 1], -tangent[:, 0]
    normal = np.stack([out * c, -rise, out * s], axis=1)
    size = np.minimum(0.62 * np.sqrt(area.sum() / max(count, 1)), 0.5 * radius + 0.01)
    across = np.minimum(size, 0.5 * length[piece] + 0.004)
    scale = np.stack([size, across, np.full(count, 0.003)], axis=1)
    position = np.stack([radius * c, -height, radius * s], axis=1)
    mottle = noise(7 * c + 20 * height, 7 * s + 9 * height, seed=61)[:, None]
    albedo = colour * (0.75 + 0.5 * mottle)
    aim = frames(normal, np.stack([-s, np.zeros(count), c], axis=1))
    return splats(position, scale, aim, rng.uniform(0.9, 1.0, count), albedo, gloss=0.10)


BATH_PROFILE = np.array(
    [
        [0.27, 0.0], [0.27, 0.05], [0.22, 0.07], [0.21, 0.11], [0.13, 0.15], [0.085, 0.24],
        [0.075, 0.36], [0.10, 0.46], [0.085, 0.54], [0.075, 0.60], [0.12, 0.65], [0.24, 0.68],
        [0.37, 0.745], [0.425, 0.81], [0.44, 0.83], [0.43, 0.85], [0.405, 0.845], [0.36, 0.79],
        [0.22, 0.74], [0.02, 0.73],
    ]
)  # fmt: skip
"""(radius, height) of the bird bath: foot, turned stem, bowl outside, rim, bowl inside."""

WATER_RADIUS, WATER_HEIGHT = 0.385, 0.822


def water(rng: np.random.Generator, count: int) -> Part:
    """Water in the bowl: level, glossy, half transparent, with a few bright ripples."""
    spread = even_pairs(count)
    size = np.minimum(0.75 * WATER_RADIUS * np.sqrt(np.pi / max(count, 1)), 0.4 * WATER_RADIUS)
    r, angle = np.sqrt(spread[:, 0]) * (WATER_RADIUS - size), 2 * np.pi * spread[:, 1]
    x, z = r * np.cos(angle), r * np.sin(angle)
    ripple = noise(x * 9, z * 26, seed=63)[:, None]
    colour = np.array([0.10, 0.17, 0.22]) + np.clip(3 * ripple - 1.3, 0, 1) * [0.20, 0.25, 0.28]
    upward = rng.normal(0, 0.06, (count, 3)) * [1, 0, 1] + [0, -1, 0]
    scale = np.array([1.2 * size, 0.8 * size, 0.002])
    position = np.stack([x, np.full(count, -WATER_HEIGHT), z], axis=1)
    aim = frames(upward, random_directions(rng, count))
    return splats(position, scale, aim, rng.uniform(0.55, 0.85, count), colour, gloss=0.32)


def bird_bath(rng: np.random.Generator, count: int) -> Part:
    """Stone bird bath with water."""
    stone, wet = share_out(count, [0.84, 0.16])
    bowl = revolution(rng, stone, BATH_PROFILE, np.array([0.46, 0.43, 0.385]))
    return moved(join([bowl, water(rng, wet)], count), BATH_PLACE, 0.0)
