"""Building blocks of the garden: unlit Gaussians, how they are aimed, spread and made finer.

Everything is in the PLY frame of 3DGS (y points down), so a height h is y = −h. Functions are
vectorised over N points and draw from the generator that they are given, nothing else.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Turn between neighbours of Vogel's sunflower spiral, radians."""

PLASTIC = 1.32471795724474602596
"""Root of x³ = x + 1: the step of the two-dimensional low-discrepancy sequence of M. Roberts."""

COVER = 0.74
"""Standard deviation over spacing at which opaque splats on a sunflower spiral close a surface."""


UP = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Part:
    """N Gaussians before lighting."""

    position: np.ndarray  # [N, 3] scene units
    scale: np.ndarray  # [N, 3] standard deviations along the frame's axes, scene units
    frame: np.ndarray  # [N, 3, 3] rotation; column 0 runs along the splat, column 2 is the normal
    opacity: np.ndarray  # [N] in [0, 1]
    albedo: np.ndarray  # [N, 3] linear RGB; what a `glow` splat shows as it is
    gloss: np.ndarray  # [N] strength of the sun's reflection, in display units
    leafy: np.ndarray  # [N] 0 (solid, lit from its normal's side) … 1 (light passes through)
    glow: np.ndarray  # [N] bool: shows its albedo whatever the light (sky)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index) -> "Part":
        return Part(*(getattr(self, f.name)[index] for f in fields(self)))


def splats(position, scale, frame, opacity, albedo, gloss=0.0, leafy=0.0, glow=False) -> Part:
    """A Part of len(position) Gaussians; every other argument is broadcast to that number."""
    count = len(position)
    values = (position, scale, frame, opacity, albedo, gloss, leafy)
    shapes = ((3,), (3,), (3, 3), (), (3,), (), ())
    spread = [
        np.broadcast_to(value, (count, *shape)).astype(np.float64)
        for value, shape in zip(values, shapes, strict=True)
    ]
    return Part(*spread, np.full(count, glow))


def join(parts: list[Part]) -> Part:
    """The Gaussians of all `parts`, in order."""
    return Part(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Part)))


def refine(rng: np.random.Generator, part: Part, count: int) -> Part:
    """`count` Gaussians that together look like `part`: each is replaced by smaller ones.

    A Gaussian with k copies becomes k draws from it, each 1/√k as large, so that the mixture keeps
    the variance of the original; draws stay within 1.6 standard deviations to keep edges crisp.
    Fewer than len(part) leaves out the tail of `part`.
    """
    if count <= len(part):
        return part[:count]
    parent = np.arange(count) % len(part)
    copies = (count - 1 - parent) // len(part) + 1
    shrink = copies[:, None] ** -0.5
    fine = part[parent]
    draw = np.clip(rng.standard_normal((count, 3)), -1.6, 1.6) * np.sqrt(1 - shrink**2)
    tint = rng.normal(1, 0.08 * np.sqrt(1 - shrink**2), (count, 1))
    moved = fine.position + np.einsum("nij,nj->ni", fine.frame, draw * fine.scale)
    albedo = fine.albedo * np.clip(tint, 0.7, 1.3)
    return replace(fine, position=moved, scale=fine.scale * shrink, albedo=albedo)


def unit(vector: np.ndarray) -> np.ndarray:
    """`vector` [..., 3] divided by its length; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length == 0, 1, length)


def frames(normal: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Rotations [N, 3, 3] with column 2 = `normal` [N, 3] and column 0 = `along` [N, 3] made
    perpendicular to it (the world's x or z axis where the two are parallel)."""
    z = unit(np.asarray(normal, np.float64))
    along = np.broadcast_to(along, z.shape)
    x = along - np.sum(along * z, axis=1, keepdims=True) * z
    axis = np.where(np.abs(z[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    other = axis - np.sum(axis * z, axis=1, keepdims=True) * z
    x = unit(np.where(np.linalg.norm(x, axis=1, keepdims=True) > 1e-6, x, other))
    return np.stack([x, np.cross(z, x), z], axis=2)


def needles(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Rotations [N, 3, 3] whose column 0 is `along` [N, 3], column 2 nearly `normal` [N, 3]."""
    side = np.cross(along, normal)
    return frames(np.cross(side, along), along)


def quaternions(frame: np.ndarray) -> np.ndarray:
    """Unit quaternions [N, 4] (w, x, y, z) of rotations [N, 3, 3].

    The rows of the symmetric matrix 4·q·qᵀ are multiples of q; the row with the largest diagonal
    element is the one without cancellation (Shepperd 1978).
    """
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(frame, 0, 2)
    rows = [
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ]
    outer = np.moveaxis(np.array(rows), 2, 0)  # [N, 4, 4]
    largest = np.argmax(np.einsum("nii->ni", outer), axis=1)
    row = outer[np.arange(len(outer)), largest]
    return row / np.linalg.norm(row, axis=1, keepdims=True)


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors [count, 3], uniform over the sphere."""
    return unit(rng.standard_normal((count, 3)))


def sunflower(count: int, core: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a disk that thin out as (1 + r²/core²)^−1.5: plane coordinates [count, 2] and the
    spacing there [count]. `core` and `radius` in scene units.

    Low discrepancy (Vogel's spiral): splats of COVER·spacing leave no hole.
    """
    u = (np.arange(count) + 0.5) / count
    within = 1 - (1 + (radius / core) ** 2) ** -0.5
    falloff = 1 - u * within  # (1 + r²/core²)^−0.5
    r = core * np.sqrt(falloff**-2 - 1)
    angle = np.arange(count) * GOLDEN_ANGLE
    spacing = core * np.sqrt(2 * np.pi * within / (count * falloff**3))
    return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1), spacing


def even_pairs(count: int) -> np.ndarray:
    """Evenly spread points [count, 2] of the unit square, the same for every call."""
    step = np.array([1 / PLASTIC, 1 / PLASTIC**2])
    return np.modf(0.5 + np.arange(1, count + 1)[:, None] * step)[0]


def noise(x: np.ndarray, z: np.ndarray, seed: int, octaves: int = 3) -> np.ndarray:
    """Smooth noise in [0, 1] of plane coordinates in cells (broadcastable arrays).

    Value noise on a 64×64 lattice that repeats; each octave has half the cell and half the weight.
    """
    table = np.random.default_rng(seed).random((64, 64))
    total = np.zeros(np.broadcast(x, z).shape)
    for octave in range(octaves):
        at_x, at_z = (np.asarray(c) * 2.0**octave + 17.3 * octave for c in (x, z))
        i, j = np.floor(at_x).astype(np.int64), np.floor(at_z).astype(np.int64)
        p, q = at_x - i, at_z - j
        p, q = p * p * (3 - 2 * p), q * q * (3 - 2 * q)
        corner = [[table[(i + m) % 64, (j + n) % 64] for n in (0, 1)] for m in (0, 1)]
        low = corner[0][0] * (1 - q) + corner[0][1] * q
        high = corner[1][0] * (1 - q) + corner[1][1] * q
        total += (low * (1 - p) + high * p) * 0.5**octave
    return total / (2 - 0.5 ** (octaves - 1))


def deal(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For `number` [M] of splats on each of M things: which thing each splat is on, and its rank
    there, both [sum of `number`]."""
    which = np.repeat(np.arange(len(number)), number)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)


def share_out(count: int, weight: np.ndarray) -> np.ndarray:
    """Integers [len(weight)] that sum to `count`, in proportion to `weight` (largest remainder)."""
    weight = np.asarray(weight, np.float64)
    exact = count * weight / weight.sum()
    whole = np.floor(exact).astype(np.int64)
    rest = np.argsort(whole - exact, kind="stable")[: count - whole.sum()]
    whole[rest] += 1
    return whole
