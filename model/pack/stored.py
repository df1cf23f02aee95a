"""The visible Gaussians of a scene in stored order, before rounding."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatcore.model.pack.chunk import Chunks, chunk_positions
from splatcore.model.pack.floaters import find_floaters
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.memory import ABSOLUTE, ModelFormat
from splatcore.spec.scene import ARRAYS, Scene, rotation_matrix, sh_count
from splatcore.spec.threads import in_threads

FLOAT32_MAX = float(np.finfo(np.float32).max)


def keep(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Masks [N] of Gaussians whose numbers fit in float32, and that can reach alpha 1/255."""

    def finite(rows: slice) -> np.ndarray:
        parts = (getattr(scene, name)[rows] for name in ARRAYS)
        within = [(np.abs(part) <= FLOAT32_MAX).all(tuple(range(1, part.ndim))) for part in parts]
        return np.all(within, axis=0)

    found = [np.ones(0, bool), *in_threads(finite, len(scene))]
    return np.concatenate(found), scene.opacity >= ALPHA_MIN


@dataclass(frozen=True, eq=False)
class Stored:
    """The M Gaussians of a model in stored order, not yet rounded; `stored[rows]` makes some of
    them, so that a large scene needs no copy."""

    original: Scene
    index: np.ndarray  # [M] index of each one in the original scene
    position: np.ndarray  # [M, 3] floaters may have been moved
    share: np.ndarray  # [M] factor of scales: below 1 for floaters that were moved, 0 for padding
    chunks: Chunks
    floaters: int  # number of floaters
    moved: int  # number of floaters that are moved nearer
    not_finite: int  # dropped: NaN, Inf or beyond float32
    transparent: int  # dropped: cannot reach alpha 1/255
    scale_max: float = np.inf  # larger scales are clipped

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def scene(self) -> Scene:
        """All Gaussians; padding has opacity 0 and size 0."""
        return self[:]

    def __getitem__(self, rows: slice) -> Scene:
        """Some Gaussians, in float64."""
        return replace(
            self.original,
            position=self.position[rows],
            scale=self.scale(rows),
            quaternion=self.original.quaternion[self.index[rows]],
            opacity=self.opacity(rows),
            sh=self.sh(rows, self.original.sh_degree),
        )

    def scale(self, rows: slice) -> np.ndarray:
        """Standard deviations [n, 3] of some Gaussians."""
        scale = self.original.scale[self.index[rows]] * self.share[rows, None]
        return np.minimum(scale, self.scale_max)

    def factor(self, rows: slice) -> np.ndarray:
        """Factors R·S [n, 3, 3] of some Gaussians."""
        rotation = rotation_matrix(self.original.quaternion[self.index[rows]])
        return rotation * self.scale(rows)[:, None, :]

    def opacity(self, rows: slice) -> np.ndarray:
        """Opacities [n] of some Gaussians."""
        return self.original.opacity[self.index[rows]] * ~self.chunks.padding[rows]

    def sh(self, rows: slice, degree: int) -> np.ndarray:
        """Coefficients [n, (degree+1)², 3] of some Gaussians, in float64."""
        sh = self.original.sh[:, : sh_count(degree)]
        return sh[self.index[rows]].astype(np.float64)


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
    moved, order = int((share < 1).sum()), chunks.order
    share = share[order] * ~chunks.padding
    dropped = int((~finite).sum()), int((finite & ~visible).sum())
    return Stored(
        scene, index[order], position[order], share, chunks, len(floaters.index), moved, *dropped
    )
