"""The garden's plants: grass, a tree, bushes, a hedge, distant trees."""

import numpy as np

from splatcore.model.generate.directions import UP, frames, needles, random_directions, unit
from splatcore.model.generate.garden_ground import CENTRE, grass_colour, ground_height, on_path
from splatcore.model.generate.garden_splats import Part, deal, join, refine, share_out, splats
from splatcore.model.generate.spreading import sunflower

GRASS_RADIUS = 18.0
BLADES_MOST = 120_000  # maximum of grass blades; further Gaussians make blades finer

TREE_PLACE = np.array([-2.35, 0, 1.25])
LEAVES_MOST = 40_000
FAR_TREES = 52

FORKS = ((6, 1.15, 0.58), (4, 0.9, 0.5), (4, 1.0, 0.42), (3, 1.1, 0.4))
"""Per level of the tree: branches per fork, their spread, their thickness at the end."""

FIRST_TWIG = 3 + 6 + 24  # number of segments without leaves, which come first

BUSHES = np.array(
    [  # x, z, radius, height over radius
        [-1.55, 2.85, 0.42, 1.0], [-3.6, 2.75, 0.50, 1.1], [-3.1, 0.1, 0.36, 0.9],
        [2.95, 2.6, 0.50, 1.1], [3.75, 1.5, 0.55, 1.1], [1.25, 2.85, 0.36, 1.2],
        [-4.4, 1.5, 0.6, 1.1], [4.6, 2.6, 0.6, 1.3],
    ]
)  # fmt: skip


def grass(rng: np.random.Generator, count: int) -> Part:
    """Blades of grass outside the path, one needle each, leaning with a light wind."""
    base = min(count, BLADES_MOST)
    plane, spacing = sunflower(int(1.25 * base) + 8, core=2.6, radius=GRASS_RADIUS)
    plane = plane + CENTRE + rng.normal(0, 0.35, plane.shape) * spacing[:, None]
    off = np.flatnonzero(on_path(*plane.T) < 0.35)
    keep = off[np.linspace(0, len(off) - 1, base).astype(np.int64)]
    (x, z), spacing = plane[keep].T, spacing[keep]
    lean = rng.normal(0, 0.34, (base, 3)) + np.array([0.22, 0, 0.05])
    blade = unit(lean * [1, 0, 1] + [0, -1, 0])
    length = np.clip(0.11 + 0.35 * spacing, 0.1, 0.6) * rng.lognormal(0, 0.25, base)
    width = np.clip(0.085 * spacing, 0.0035, 0.08)
    root = np.stack([x, -ground_height(x, z), z], axis=1)
    tall = rng.random(base) < 0.03  # stalks that stand out of the lawn
    length = np.where(tall, 1.7 * length, length)
    colour = grass_colour(x, z) * rng.uniform(0.9, 2.0, (base, 1)) * [1.05, 1.0, 0.8]
    colour = np.where(tall[:, None], colour * 0.4 + [0.20, 0.18, 0.06], colour)
    scale = np.stack([0.36 * length, width, 0.3 * width], axis=1)
    position = root + blade * 0.42 * length[:, None]
    aim = needles(blade, random_directions(rng, base) * [1, 0.2, 1])
    opacity = np.where(rng.random(base) < 0.75, rng.uniform(0.6, 0.97, base), rng.uniform(0.1, 0.6))
    part = splats(position, scale, aim, opacity, colour, gloss=0.07, leafy=0.85)
    return refine(rng, part, count)


def branches(layout: np.random.Generator) -> np.ndarray:
    """Segments [M, 8] of the tree's wood: start (3), end (3), radius at start and end.

    Sorted by level: trunk pieces, limbs, boughs, twigs. y points down, the foot is at the origin.
    """
    trunk = np.array([[0, 0.1, 0], [0.05, -0.5, 0.02], [-0.03, -0.9, -0.03], [0.05, -1.2, 0]])
    radius = np.array([0.16, 0.115, 0.10, 0.09])
    wood = [np.r_[trunk[i], trunk[i + 1], radius[i], radius[i + 1]] for i in range(3)]
    level = [(trunk[3], np.array([0.05, -1.0, 0]), 0.09, 0.68)]
    for fork, spread, shrink in FORKS:
        grown = []
        for start, direction, thick, length in level:
            turn = layout.random() * 2 * np.pi + 2 * np.pi * np.arange(fork) / fork
            for angle in turn:
                side = np.array([np.cos(angle), layout.normal(-0.12, 0.25), np.sin(angle)])
                wide = spread * layout.uniform(0.45, 1.2)
                way = unit(direction + wide * side + [0, -0.10, 0])
                reach = length * layout.uniform(0.75, 1.2)
                end = start + way * reach
                wood.append(np.r_[start, end, thick * 0.8, thick * shrink])
                grown.append((end, way, thick * shrink, length * 0.72))
        level = grown
    return np.array(wood)


def tree(rng: np.random.Generator, count: int) -> Part:
    """A tree: bark on trunk, limbs and twigs, leaves on the thinnest two levels."""
    layout = np.random.default_rng(rng.integers(2**32))
    wood = branches(layout)
    bark_count, leaf_count = share_out(count, [0.18, 0.82])
    return join([bark(rng, bark_count, wood), leaves(rng, leaf_count, wood[FIRST_TWIG:])], count)


def bark(rng: np.random.Generator, count: int, wood: np.ndarray) -> Part:
    """Splats on the surface of the segments `wood` [M, 8], stretched along them."""
    start, end, thick = wood[:, :3], wood[:, 3:6], wood[:, 6:]
    length = np.linalg.norm(end - start, axis=1)
    number = share_out(count, length * (thick.mean(axis=1) + 0.004))
    piece, rank = deal(number)
    along = unit(end - start)[piece]
    share = (rank + rng.random(count)) / np.maximum(number[piece], 1)
    radius = thick[piece, 0] + share * (thick[piece, 1] - thick[piece, 0])
    side = frames(along, random_directions(rng, count))[:, :, 0]
    area = 2 * np.pi * radius * length[piece] / np.maximum(number[piece], 1)
    size = np.minimum(1.1 * np.sqrt(area), 0.25 * length[piece])
    width = np.minimum(0.6 * np.sqrt(area), 0.6 * radius)
    middle = start[piece] + along * (share * length[piece])[:, None]
    position = middle + side * (0.85 * radius)[:, None] + TREE_PLACE
    colour = np.array([0.21, 0.145, 0.095]) * rng.uniform(0.55, 1.3, (count, 1))
    scale = np.stack([size, width, 0.15 * width], axis=1)
    return splats(position, scale, frames(side, along), rng.uniform(0.8, 1.0, count), colour)


def leaves(rng: np.random.Generator, count: int, twigs: np.ndarray) -> Part:
    """Leaves around the segments `twigs` [M, 8]: oval disks, about half of them translucent."""
    base = min(count, LEAVES_MOST)
    twig = twigs[rng.integers(len(twigs), size=base)]
    share = rng.uniform(0.1, 1.15, (base, 1))
    droop = np.abs(rng.normal(0, 0.08, (base, 1))) * [0, 1, 0]
    position = twig[:, :3] + share * (twig[:, 3:6] - twig[:, :3]) + droop
    position = position + rng.normal(0, 0.10, (base, 3)) + TREE_PLACE
    size = np.clip(0.050 * np.sqrt(4000 / max(base, 1)), 0.017, 0.3) * rng.lognormal(0, 0.2, base)
    normal = unit(random_directions(rng, base) + np.array([-0.3, -0.75, -0.1]))
    tone = rng.random((base, 1))
    colour = np.array([0.075, 0.165, 0.018]) + tone * [0.16, 0.13, 0.02]
    gold = rng.random(base) < 0.06
    colour[gold] = [0.30, 0.25, 0.04]
    thin = rng.random(base)
    opacity = np.where(thin < 0.45, rng.uniform(0.2, 0.7, base), rng.uniform(0.7, 0.98, base))
    opacity = np.where(thin > 0.95, rng.uniform(0.02, 0.2, base), opacity)
    scale = np.stack([size, 0.52 * size, 0.05 * size], axis=1)
    aim = frames(normal, random_directions(rng, base) - 0.6 * UP)
    part = splats(position, scale, aim, opacity, colour, gloss=0.11, leafy=1.0)
    return refine(rng, part, count)


def leaf_balls(
    rng: np.random.Generator, count: int, balls: np.ndarray, leaf: float, flat: float
) -> Part:
    """Round crowns of leaves, with big dark splats inside that make them opaque.

    balls: [B, 5] x, z, radius, height over width, share of the leaves
    leaf: size of a splat over √(ball surface / splats of the ball)
    flat: thickness of a splat over its size
    """
    layout = np.random.default_rng(rng.integers(2**32))
    number = share_out(count, balls[:, 4])
    which, _ = deal(number)
    x, z, radius, stretch = balls[which, :4].T
    core_share = np.clip(10 / np.maximum(number, 1), 0.22, 1)[which]
    core = np.modf(np.arange(count) * 0.6180339887)[0] < core_share
    out = random_directions(rng, count)
    reach = radius * np.where(core, 0.55, 0.78 + 0.25 * rng.random(count) ** 0.7)
    position = out * reach[:, None] * np.stack([np.ones(count), stretch, np.ones(count)], axis=1)
    position += np.stack([x, -0.75 * radius * stretch, z], axis=1)
    position[:, 1] = np.minimum(position[:, 1], -0.02 * radius)
    ideal = leaf * radius * np.sqrt(4 * np.pi / np.maximum(number[which], 1))
    size = np.minimum(ideal, 0.16 * radius) * rng.lognormal(0, 0.25, count)
    inner = 1.3 * radius / np.sqrt(core_share * number[which] + 1)
    size = np.where(core, np.minimum(inner, 0.40 * radius), size)
    shade = rng.uniform(0.6, 1.5, count) * np.where(core, 0.6, 1.0)
    thin = rng.random(count)
    opacity = np.where(thin < 0.35, rng.uniform(0.2, 0.7, count), rng.uniform(0.7, 0.99, count))
    opacity = np.where(thin > 0.96, rng.uniform(0.02, 0.2, count), opacity)
    shape = np.where(core[:, None], [1.0, 0.95, 0.8], [1.0, 0.62, flat])
    aim = frames(out + 0.9 * random_directions(rng, count), random_directions(rng, count))
    tone = layout.uniform([0.045, 0.12, 0.018], [0.085, 0.17, 0.04], (len(balls), 3))
    albedo = tone[which] * layout.uniform(0.75, 1.2, (len(balls), 1))[which] * shade[:, None]
    return splats(position, size[:, None] * shape, aim, opacity, albedo, gloss=0.08, leafy=0.9)


def bushes(rng: np.random.Generator, count: int) -> Part:
    """Round bushes in the garden and a hedge behind the fence, some with pink blossoms."""
    layout = np.random.default_rng(rng.integers(2**32))
    x = np.arange(-7.5, 7.6, 0.75)
    hedge = [x, layout.uniform(4.3, 5.2, 21), layout.uniform(0.60, 0.85, 21), np.full(21, 1.15)]
    balls = np.concatenate([BUSHES, np.stack(hedge, axis=1)])
    share = balls[:, 2] ** 2 * np.where(np.arange(len(balls)) < len(BUSHES), 1.6, 1.0)
    base = min(count, LEAVES_MOST)
    part = leaf_balls(rng, base, np.column_stack([balls, share]), leaf=0.34, flat=0.12)
    blossom = (rng.random(base) < 0.05) & (part.scale[:, 0] < 0.12) & (part.position[:, 2] < 3.2)
    part.albedo[blossom] = [0.75, 0.25, 0.36]
    return refine(rng, part, count)


def far_trees(rng: np.random.Generator, count: int) -> Part:
    """Rounded trees and thickets between 14 and 55 units away, all around."""
    layout = np.random.default_rng(rng.integers(2**32))
    azimuth = 2 * np.pi * (np.arange(FAR_TREES) + layout.random(FAR_TREES)) / FAR_TREES
    distance = 14 + 40 * layout.random(FAR_TREES)
    radius = layout.uniform(0.9, 1.7, FAR_TREES) * (1 + distance / 45)
    tall = layout.uniform(0.8, 1.35, FAR_TREES)
    x, z = distance * np.sin(azimuth), distance * np.cos(azimuth)
    balls = np.stack([x, z, radius, tall, np.ones(FAR_TREES)], axis=1)
    part = leaf_balls(rng, min(count, LEAVES_MOST), balls, leaf=0.36, flat=0.6)
    return refine(rng, part, count)
