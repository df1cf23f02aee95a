"""The visible Gaussians of a scene in stored order, before rounding."""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.model.pack.chunk import Chunks, chunk_positions
from splatcore.model.pack.floaters import find_floaters
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.memory import ABSOLUTE, ModelFormat
from splatcore.spec.scene import ARRAYS, Scene

FLOAT32_MAX = float(np.finfo(np.float32).max)


def keep(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Masks [N] of Gaussians whose numbers fit in float32, and that can reach alpha 1/255."""
    finite = np.ones(len(scene), bool)
    for rows in (getattr(scene, name) for name in ARRAYS):
        finite &= (np.abs(rows) <= FLOAT32_MAX).all(tuple(range(1, rows.ndim)))
    return finite, scene.opacity >= ALPHA_MIN


@dataclass(frozen=True, eq=False)
class Stored:
    """The Gaussians of a model in stored order, not yet rounded."""

    scene: Scene  # [M]; padding has opacity 0 and size 0
    index: np.ndarray  # [M] index of each one in the original scene
    chunks: Chunks
    floaters: int  # number of floaters
    moved: int  # number of floaters that are moved nearer


def stored_scene(scene: Scene, format: ModelFormat) -> Stored:
    """Select the Gaussians of a scene that a model stores, and put them in stored order."""
    finite, visible = keep(scene)
    index = np.flatnonzero(finite & visible)
    position = scene.position[index]
    floaters = find_floaters(position, ABSOLUTE.max if format.position == "absolute" else np.inf)
    position[floaters.index] = floaters.position
    chunks = chunk_positions(position, format.stored_bits, floaters.index)
    share = np.ones(len(index))
    share[floaters.index] = floaters.share
    order, shown = chunks.order, ~chunks.padding
    scene = scene[index[order]]
    scale = scene.scale * (share[order] * shown)[:, None]
    scene = replace(scene, position=position[order], scale=scale, opacity=scene.opacity * shown)
    return Stored(scene, index[order], chunks, len(floaters.index), int((share < 1).sum()))
