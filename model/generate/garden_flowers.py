"""Flower beds: daisies, poppies, lavender, marigolds and cosmos, each built from a few splats."""

import numpy as np

from splatcore.model.generate.directions import UP, frames, needles, random_directions, unit
from splatcore.model.generate.garden_ground import ground_height
from splatcore.model.generate.garden_splats import Part, refine, share_out, splats

BEDS = np.array(
    [  # x, z, radius, kind of flower, share
        [-1.10, -0.95, 0.50, 0, 1.2], [-0.05, -0.25, 0.42, 1, 1.0], [-1.35, -0.05, 0.50, 2, 1.1],
        [1.45, -1.15, 0.50, 3, 1.4], [2.35, -0.75, 0.50, 0, 1.0], [2.95, 0.15, 0.45, 1, 0.9],
        [-2.4, 0.85, 0.55, 4, 1.2], [-1.0, 2.75, 0.45, 3, 0.9], [1.6, 2.80, 0.50, 4, 1.0],
        [2.9, 2.5, 0.55, 2, 0.9], [-2.3, -1.5, 0.50, 2, 1.1], [-3.1, -0.9, 0.45, 4, 0.9],
        [2.05, -2.0, 0.40, 4, 1.0], [-2.9, 2.7, 0.55, 0, 0.9],
    ]
)  # fmt: skip

FLOWER_KINDS = np.array(
    [  # petal RGB (linear), centre RGB, petal length, cup angle, height
        [0.85, 0.84, 0.80, 0.80, 0.48, 0.03, 0.065, 0.15, 0.33],  # daisy
        [0.78, 0.055, 0.03, 0.05, 0.03, 0.04, 0.075, 0.75, 0.42],  # poppy
        [0.24, 0.13, 0.62, 0.30, 0.20, 0.60, 0.030, 0.90, 0.48],  # lavender: petals in a spike
        [0.88, 0.50, 0.03, 0.35, 0.14, 0.02, 0.070, 0.35, 0.30],  # marigold
        [0.80, 0.20, 0.38, 0.85, 0.62, 0.20, 0.075, 0.55, 0.36],  # pink cosmos
    ]
)
LAVENDER = 2
FLOWERS_MOST = 1_500
FLOWER_ROLES = 9  # splats of one flower: six petals, centre, stem, one leaf


def flowers(rng: np.random.Generator, count: int) -> Part:
    """Flower beds: every flower has petals, a centre, a stem and a leaf."""
    layout = np.random.default_rng(rng.integers(2**32))
    most = layout.permutation(np.repeat(np.arange(len(BEDS)), share_out(FLOWERS_MOST, BEDS[:, 4])))
    angle, reach = layout.uniform(0, 2 * np.pi, FLOWERS_MOST), layout.random(FLOWERS_MOST) ** 0.5
    sway = layout.normal(0, 0.28, (FLOWERS_MOST, 3)) + np.array([-0.1, 0, -0.25])
    grow = layout.lognormal(0, 0.18, FLOWERS_MOST)
    number = min(FLOWERS_MOST, -(-count // FLOWER_ROLES))
    base = min(count, number * FLOWER_ROLES)
    flower, role = np.arange(base) % number, np.arange(base) // number
    bed = BEDS[most[flower]]
    kind = FLOWER_KINDS[bed[:, 3].astype(np.int64)]
    bigger = (FLOWERS_MOST / number) ** 0.25 * 0.8  # fewer flowers are drawn larger
    x = bed[:, 0] + bed[:, 2] * (reach * np.cos(angle))[flower] * 1.2
    z = bed[:, 1] + bed[:, 2] * (reach * np.sin(angle))[flower] * 0.8
    foot = np.stack([x, -ground_height(x, z), z], axis=1)
    face = unit(sway[flower] + [0, -1, 0])
    rise = (kind[:, 8] * grow[flower])[:, None]
    parts = _flower_parts(rng, role, foot, face, rise, kind, bigger, bed[:, 3] == LAVENDER)
    return refine(rng, parts, count)


def _flower_parts(rng, role, foot, face, rise, kind, bigger, spike) -> Part:
    """Splats of flowers by their `role`: 0 … 5 petals, 6 centre, 7 stem, 8 leaf."""
    count = len(role)
    stem = unit(face * [0.35, 1, 0.35])
    head = foot + stem * rise
    frame = frames(face, [1.0, 0.0, 0.3])
    turn = 2 * np.pi * role / 6 + rng.normal(0, 0.12, count)
    radial = frame[:, :, 0] * np.cos(turn)[:, None] + frame[:, :, 1] * np.sin(turn)[:, None]
    length = kind[:, 6] * bigger * rng.lognormal(0, 0.1, count)
    cup = kind[:, 7] + rng.normal(0, 0.1, count)
    c, s = np.cos(cup)[:, None], np.sin(cup)[:, None]
    petal, inside = c * radial + s * face, c * face - s * radial
    position = head + petal * (0.6 * length)[:, None]
    position = np.where(spike[:, None], position - stem * (0.035 * role)[:, None], position)
    scale = length[:, None] * np.array([0.42, 0.30, 0.04])
    scale = np.where(spike[:, None], length[:, None] * [0.75, 0.5, 0.3], scale)
    along, normal = petal, inside
    colour = kind[:, :3] * rng.uniform(0.75, 1.15, (count, 1))
    centre, stalk, leaf = role == 6, role == 7, role >= 8
    position[centre] = (head + face * 0.012)[centre]
    scale[centre] = (length[:, None] * [0.24, 0.24, 0.12])[centre]
    colour[centre] = kind[centre, 3:6]
    normal = np.where(centre[:, None], face, normal)
    position[stalk] = (foot + stem * 0.5 * rise)[stalk]
    scale[stalk] = (rise * [0.30, 0, 0] + [0, 0.006, 0.004])[stalk]
    along = np.where(stalk[:, None], stem, along)
    out = unit(radial * [1, 0, 1] + [0, -0.7, 0])
    position[leaf] = (foot + out * rise * 0.30)[leaf]
    scale[leaf] = (rise * [0.20, 0.05, 0.01])[leaf]
    along = np.where(leaf[:, None], out, along)
    green = np.array([0.085, 0.17, 0.03]) * rng.uniform(0.6, 1.5, (count, 1))
    colour = np.where((stalk | leaf)[:, None], green, colour)
    opacity = np.where(leaf, rng.uniform(0.35, 0.9, count), rng.uniform(0.8, 0.99, count))
    upright = random_directions(rng, count) + 0.5 * UP
    normal = np.where((stalk | leaf)[:, None], upright, normal)
    return splats(position, scale, needles(along, normal), opacity, colour, gloss=0.06, leafy=0.8)
