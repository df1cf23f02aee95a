"""The garden's land and sky: ground, earth path with stones, hills and far trees, sky shell."""

import numpy as np

from splatcore.model.generate.directions import UP, frames, random_directions, unit
from splatcore.model.generate.garden_light import HAZE, sky_colour
from splatcore.model.generate.garden_splats import Part, join, refine, share_out, splats
from splatcore.model.generate.spreading import COVER, GOLDEN_ANGLE, even_pairs, noise, sunflower

CENTRE = np.array([0.2, -2.4])
"""Plane point (x, z) around which the ground is finest: between the viewer and the middle."""

GROUND_RADIUS = 90.0
SKY_RADIUS = 160.0
PATH_HALF_WIDTH = 0.40
CLOUD_SEED = 12
CLOUDS = 22

GRASS_DARK, GRASS_LIGHT = np.array([0.045, 0.105, 0.018]), np.array([0.15, 0.25, 0.045])
EARTH_DARK, EARTH_LIGHT = np.array([0.14, 0.082, 0.042]), np.array([0.34, 0.22, 0.125])


def ground_height(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Height of the ground above y = 0 at plane points, scene units."""
    return 0.05 * np.sin(0.9 * x + 0.5) * np.cos(0.7 * z) + 0.02 * np.sin(2.3 * x + 1.7 * z)


def path_offset(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Signed distance along x from the middle of the path, scene units."""
    return x - (0.45 + 0.62 * np.sin(0.72 * z + 1.25) + 0.03 * np.sin(3.1 * z))


def on_path(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """1 on the path, 0 on the grass, smooth between; the path ends behind the fence."""
    ragged = PATH_HALF_WIDTH + 0.16 * (noise(x * 5, z * 5, seed=3) - 0.5)
    inside = np.clip((ragged - np.abs(path_offset(x, z))) / 0.1 + 0.5, 0, 1)
    return inside * np.clip(4.2 - z, 0, 1)


def grass_colour(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Linear RGB [N, 3] of the lawn, with dry and lush patches."""
    patch = noise(x * 0.8, z * 0.8, seed=5)[:, None]
    fine = noise(x * 7, z * 7, seed=6, octaves=2)[:, None]
    colour = GRASS_DARK + (GRASS_LIGHT - GRASS_DARK) * (0.65 * patch + 0.35 * fine)
    dry = np.clip((noise(x * 0.5 + 9, z * 0.5, seed=8)[:, None] - 0.55) * 3, 0, 1)
    return colour + dry * (np.array([0.22, 0.22, 0.06]) - colour) * 0.5


def ground(rng: np.random.Generator, count: int) -> Part:
    """Flat disks from the camera to the horizon: soil under grass, and the bare path."""
    plane, spacing = sunflower(count, core=2.6, radius=GROUND_RADIUS)
    plane = plane + CENTRE + rng.normal(0, 0.12, plane.shape) * spacing[:, None]
    x, z = plane.T
    path = on_path(x, z)[:, None]
    position = np.stack([x, -ground_height(x, z) + 0.03 * path[:, 0], z], axis=1)
    slope = rng.normal(0, 0.10, (count, 3)) * [1, 0, 1] + [0, -1, 0]
    grain = (0.6 * noise(x * 9, z * 9, seed=4) + 0.4 * rng.random(count))[:, None]
    earth = EARTH_DARK + (EARTH_LIGHT - EARTH_DARK) * grain
    colour = grass_colour(x, z) * rng.uniform(0.8, 1.1, (count, 1))
    size = COVER * spacing * rng.uniform(0.92, 1.12, count)
    scale = np.stack([size * 1.08, size, 0.06 * size], axis=1)
    aim, opacity = frames(slope, random_directions(rng, count)), rng.uniform(0.9, 1.0, count)
    return splats(position, scale, aim, opacity, colour + path * (earth - colour))


def pebbles(rng: np.random.Generator, count: int) -> Part:
    """Pebbles on the path, one roundish splat each."""
    z = rng.uniform(-6.5, 3.6, count)
    side = np.clip(rng.normal(0, 0.6, count), -1.15, 1.15) * PATH_HALF_WIDTH
    x = side - path_offset(np.zeros(count), z)
    size = 0.02 * rng.lognormal(0, 0.45, count)
    position = np.stack([x, -ground_height(x, z) + 0.02 - 0.4 * size, z], axis=1)
    grey = rng.uniform(0.14, 0.5, (count, 1)) * [1.0, 0.93, 0.84]
    shape = size[:, None] * rng.uniform([0.6, 0.5, 0.2], [1.0, 0.8, 0.4], (count, 3))
    upward = rng.normal(0, 0.3, (count, 3)) + UP
    aim = frames(upward, random_directions(rng, count))
    return splats(position, shape, aim, rng.uniform(0.6, 1.0, count), grey, gloss=0.05)


def stepping_stones(rng: np.random.Generator, count: int) -> Part:
    """Flagstones along the middle of the path, some with moss: flat disks on their top."""
    layout = np.random.default_rng(rng.integers(2**32))
    centre_z = np.arange(-5.9, 3.6, 0.62) + layout.uniform(-0.06, 0.06, 16)
    centre_x = layout.uniform(-0.09, 0.09, 16) - path_offset(np.zeros(16), centre_z)
    radius = layout.uniform(0.20, 0.27, 16)
    tone = layout.uniform(0.75, 1.1, 16)
    which = np.arange(count) % 16
    rank = np.arange(count) // 16
    r = np.sqrt((rank + rng.random(count)) / (count // 16 + 1))
    angle = rank * GOLDEN_ANGLE + which
    outline = 1 + 0.09 * np.sin(3 * angle + which) + 0.06 * np.sin(5 * angle + 2.4 * which)
    reach = radius[which] * outline
    spacing = radius[which] * np.sqrt(np.pi * 16 / max(count, 16))
    size = np.minimum(0.55 * spacing, 0.4 * radius[which])
    x = centre_x[which] + r * (reach - size) * np.cos(angle) * 1.15
    z = centre_z[which] + r * (reach - size) * np.sin(angle) * 0.85
    top = 0.075 * (1 - 0.6 * r**6)
    position = np.stack([x, -ground_height(x, z) - top + 0.015, z], axis=1)
    rim = 1.6 * r**5
    outward = np.stack([rim * np.cos(angle), -np.ones(count), rim * np.sin(angle)], axis=1)
    mottle = noise(x * 11, z * 11, seed=31)[:, None]
    grey = np.array([0.50, 0.47, 0.42]) * (0.5 + 0.8 * mottle) * tone[which][:, None]
    moss = np.clip((noise(x * 6, z * 6, seed=33)[:, None] - 0.62) * 6, 0, 1)
    scale = np.stack([size, size, 0.08 * size], axis=1)
    aim = frames(outward, random_directions(rng, count))
    albedo = grey + moss * (np.array([0.10, 0.15, 0.03]) - grey) * 0.8
    return splats(position, scale, aim, rng.uniform(0.88, 1.0, count), albedo, gloss=0.10)


def earth(rng: np.random.Generator, count: int) -> Part:
    """The trodden surface of the path: disks much finer than the ground's."""
    spread = even_pairs(count)
    area = 10.2 * 2 * PATH_HALF_WIDTH
    size = min(0.60 * np.sqrt(area / max(count, 1)), 0.3)
    z = -6.6 + 10.2 * spread[:, 0]
    x = (2 * spread[:, 1] - 1) * (1.08 * PATH_HALF_WIDTH - 0.5 * size)
    x = x * (0.9 + 0.3 * noise(z * 2.3, 3 * np.sign(x), seed=35)) - path_offset(0.0, z)
    rut = 0.02 * noise(x * 6, z * 6, seed=36)
    position = np.stack([x, -ground_height(x, z) - rut, z], axis=1)
    grain = 0.65 * noise(x * 8, z * 8, seed=4) + 0.35 * rng.random(count)
    colour = EARTH_DARK + (EARTH_LIGHT - EARTH_DARK) * grain[:, None]
    upward = rng.normal(0, 0.16, (count, 3)) + UP
    scale = size * rng.uniform([0.9, 0.8, 0.06], [1.2, 1.0, 0.1], (count, 3))
    aim = frames(upward, random_directions(rng, count))
    return splats(position, scale, aim, rng.uniform(0.7, 0.98, count), colour)


def path(rng: np.random.Generator, count: int) -> Part:
    """Trodden earth, flagstones and pebbles."""
    flat, stones, small = share_out(count, [0.36, 0.42, 0.22])
    return join([earth(rng, flat), stepping_stones(rng, stones), pebbles(rng, small)], count)


def hills(rng: np.random.Generator, count: int) -> Part:
    """Two ridges of upright disks that close the gap between ground and sky."""
    index = np.arange(count)
    far = index % 3 == 0  # every third splat belongs to the farther, higher ridge
    azimuth = 2 * np.pi * np.modf(index * 0.6180339887)[0]
    distance = np.where(far, 118.0, 84.0)
    rolling = [
        noise(k * np.cos(azimuth) + 20 + k, k * np.sin(azimuth) + 20, seed=41) for k in (5, 9)
    ]
    crest = np.where(far, 5.0 + 16 * rolling[0], 1.0 + 9 * rolling[1])
    skin = 2 * np.pi * distance * np.where(far, 14.0, 6.0)  # area of a ridge seen from inside
    size = np.minimum(0.95 * np.sqrt(skin / (count * np.where(far, 1 / 3, 2 / 3))), 12.0)
    tall = np.minimum(0.5 * size, 0.35 * crest)
    height = rng.random(count) ** 0.8 * np.maximum(crest - tall, 0.5) - 0.5
    position = np.stack([distance * np.sin(azimuth), -height, distance * np.cos(azimuth)], axis=1)
    inward = -unit(position * [1, 0, 1])
    woods = noise(azimuth * 30, height, seed=43)[:, None]
    near = np.array([0.10, 0.17, 0.07]) * (0.6 + 0.9 * woods)
    colour = np.where(far[:, None], near + (HAZE * [0.55, 0.72, 0.95] - near) * 0.72, near * 1.3)
    colour = colour + (HAZE - colour) * 0.22
    scale = np.stack([size, tall, 0.05 * tall], axis=1)
    aim = frames(inward, np.cross(inward, [0, 1, 0]))
    return splats(position, scale, aim, 0.97, colour, glow=True)


def sky(rng: np.random.Generator, count: int) -> Part:
    """The shell of the sky, with soft clouds in front of it."""
    far, soft = share_out(count, [0.7, 0.3])
    return join([shell(rng, far), clouds(rng, soft)], count)


def clouds(rng: np.random.Generator, count: int) -> Part:
    """Heaps of soft translucent puffs with flat grey bases, 120 units away."""
    layout = np.random.default_rng(rng.integers(2**32))
    azimuth = 2 * np.pi * (np.arange(CLOUDS) + layout.uniform(-0.3, 0.3, CLOUDS)) / CLOUDS
    base = layout.uniform(0.13, 0.42, CLOUDS)  # elevation of the flat underside, radians
    width = layout.uniform(0.09, 0.20, CLOUDS) * (0.6 + base)
    puffs = min(count, 200 * CLOUDS)
    finer = min(1.0, 12 * CLOUDS / max(puffs, 1)) ** 0.3
    which = np.arange(puffs) % CLOUDS
    along = np.clip(rng.normal(0, 0.75, puffs), -1.6, 1.6)
    lift = rng.random(puffs) * np.exp(-(along**2)) * 0.6
    turn = azimuth[which] + along * width[which]
    rise = base[which] + (lift + 0.12) * width[which]
    level = np.cos(rise)
    direction = np.stack([level * np.sin(turn), -np.sin(rise), level * np.cos(turn)], axis=1)
    size = 120 * width[which] * rng.uniform(0.2, 0.36, puffs) * finer
    bright = np.clip(0.35 + 1.3 * lift, 0, 1)[:, None]
    colour = np.array([0.95, 1.0, 1.1]) + bright * np.array([1.3, 1.15, 0.95])
    scale = np.stack([size * 1.5, size * 0.62, 0.3 * size], axis=1)
    aim = frames(-direction, np.cross(direction, UP))
    opacity = rng.uniform(0.25, 0.7, puffs)
    return refine(rng, splats(120 * direction, scale, aim, opacity, colour, glow=True), count)


def shell(rng: np.random.Generator, count: int) -> Part:
    """Shell of big flat disks from 7° below the horizon to the zenith, finer near the horizon."""
    u = (np.arange(count) + 0.5) / count
    lowest, slope = (
        -0.12,
        7.0,
    )  # sine of the lowest elevation; its density is 1 + slope times the zenith's
    sine = lowest + (1 - lowest) * (np.expm1(u * np.log1p(slope)) / slope)
    azimuth = np.arange(count) * GOLDEN_ANGLE
    level = np.sqrt(np.maximum(1 - sine**2, 0))
    direction = np.stack([level * np.sin(azimuth), -sine, level * np.cos(azimuth)], axis=1)
    density = count / (2 * np.pi * (1 - lowest)) * slope / np.log1p(slope) / (1 + slope * u)
    size = np.minimum(0.66 * SKY_RADIUS / np.sqrt(density), 0.5 * SKY_RADIUS)
    colour = sky_colour(direction, CLOUD_SEED)
    scale = np.stack([size * 1.05, size, 0.01 * size], axis=1)
    aim = frames(-direction, np.cross(direction, [0, 1, 0.01]))
    opacity = rng.uniform(0.985, 1.0, count)
    return splats(direction * SKY_RADIUS, scale, aim, opacity, colour, glow=True)
