"""Building blocks of the garden: unlit Gaussians; joining, distributing and refining them.

Everything is in the PLY frame of 3DGS (y points down), so a height h is y = −h. Functions are
vectorised over N points, and random only by the generator that they are given.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from splatcore.spec.scene import batches


@dataclass(frozen=True, eq=False)
class Part:
    """N Gaussians before lighting."""

    position: np.ndarray  # [N, 3] scene units
    scale: np.ndarray  # [N, 3] standard deviations along the frame's axes, scene units
    frame: np.ndarray  # [N, 3, 3] rotation; column 0 runs along the splat, column 2 is the normal
    opacity: np.ndarray  # [N] in [0, 1]
    albedo: np.ndarray  # [N, 3] linear RGB
    gloss: np.ndarray  # [N] strength of the sun's reflection, in display units
    leafy: np.ndarray  # [N] 0 (solid, lit from its normal's side) … 1 (light passes through)
    glow: np.ndarray  # [N] bool: shows its albedo regardless of the light (sky)

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index) -> "Part":
        return Part(*(getattr(self, f.name)[index] for f in fields(self)))


def splats(position, scale, frame, opacity, albedo, gloss=0.0, leafy=0.0, glow=False) -> Part:
    """A `Part` of len(position) Gaussians; the other arguments are broadcast to that number."""
    count = len(position)
    shapes = ((3,), (3,), (3, 3), (), (3,), (), ())
    values = zip((position, scale, frame, opacity, albedo, gloss, leafy), shapes, strict=True)
    spread = [np.broadcast_to(value, (count, *shape)).astype(np.float64) for value, shape in values]
    return Part(*spread, np.full(count, glow))


def join(parts: Iterable[Part], count: int) -> Part:
    """The `count` Gaussians of all `parts`, in order; each part is copied as soon as it is made."""
    arrays, end = {}, 0
    for part in parts:
        for name, some in vars(part).items():
            if name not in arrays:
                arrays[name] = np.empty((count, *some.shape[1:]), some.dtype)
            arrays[name][end : end + len(part)] = some
        end += len(part)
    return Part(**arrays)


def refine(rng: np.random.Generator, part: Part, count: int) -> Part:
    """Replace the Gaussians of a part by `count` smaller ones that together look alike.

    A Gaussian is replaced by k samples from it, each 1/√k as large, so that the mixture keeps the
    original's variance. Samples stay within 1.6 standard deviations, which keeps edges crisp. If
    `count` is below len(part), the tail of the part is dropped.
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


def quaternions(frame: np.ndarray) -> np.ndarray:
    """Unit quaternions [N, 4] (w, x, y, z) of rotations [N, 3, 3].

    The rows of the symmetric matrix 4·q·qᵀ are multiples of q; the row with the largest diagonal
    element is free of cancellation (Shepperd 1978).
    """
    found = np.empty((len(frame), 4))
    for some in batches(len(frame)):
        found[some] = _quaternions(frame[some])
    return found


def _quaternions(frame: np.ndarray) -> np.ndarray:
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


def deal(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Assign splats to M objects in order; `number` [M]: splats of each object.

    Returns the object of each splat, and its rank there, both [sum of `number`].
    """
    which = np.repeat(np.arange(len(number)), number)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)


def share_out(count: int, weight: np.ndarray) -> np.ndarray:
    """Divide `count` in proportion to `weight` [M] into integers [M] (largest remainder method)."""
    weight = np.asarray(weight, np.float64)
    exact = count * weight / weight.sum()
    whole = np.floor(exact).astype(np.int64)
    rest = np.argsort(whole - exact, kind="stable")[: count - whole.sum()]
    whole[rest] += 1
    return whole
