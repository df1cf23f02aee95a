"""A scene as stored in files, and the Gaussians that renderers take."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from splatcore.spec.error import InputError

ARRAYS = ("position", "scale", "quaternion", "opacity", "sh")
"""Fields of a `Scene` with one row per Gaussian."""

BATCH = 1 << 14
"""Gaussians that are worked on at a time: their intermediate arrays stay in a core's cache."""


LARGE = 1 << 20
"""Larger scenes are packed by samples: of vectors for codebooks, of columns for coded files."""


def batches(count: int) -> Iterator[slice]:
    """Yield the slices of at most `BATCH` rows that make up `count` rows."""
    return (slice(first, min(first + BATCH, count)) for first in range(0, count, BATCH))


def sh_count(degree: int) -> int:
    """Return the number of spherical-harmonics coefficients per channel up to `degree`."""
    return (degree + 1) ** 2


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N Gaussians in world space: the input of every renderer of this project. Arrays are float64;
    `sh` may be float32, and is converted before it is computed with.

    factor: R·S of a scene file or the lower-triangular L of a packed model; the covariance is
        factor @ factor.T
    sh: real spherical-harmonics coefficients in the order of 3DGS (degree 0, then 1: −y, z, −x, …);
        colour = Σ sh·basis + 0.5
    antialiased: every renderer multiplies opacities by √(det Σ / det(Σ + blur)), Σ a splat's 2D
        covariance (`spec.convention`)
    """

    position: np.ndarray  # [N, 3] scene units
    factor: np.ndarray  # [N, 3, 3] scene units
    opacity: np.ndarray  # [N] in [0, 1]
    sh: np.ndarray  # [N, (degree+1)², 3] RGB
    antialiased: bool = False

    def __len__(self) -> int:
        return len(self.position)

    @property
    def finite(self) -> np.ndarray:
        """Whether all numbers of a Gaussian are finite [N]."""
        found = np.isfinite(self.position).all(1) & np.isfinite(self.opacity)
        return found & np.isfinite(self.factor).all((1, 2)) & np.isfinite(self.sh).all((1, 2))

    def decoded(self, index) -> "Gaussians":
        """Return the Gaussians that a numpy index selects, as `Scene` and packed models do."""
        return self[index]

    def __getitem__(self, index) -> "Gaussians":
        """Return the Gaussians that a numpy index (slice, mask or integers) selects."""
        arrays = (self.position, self.factor, self.opacity, self.sh)
        return Gaussians(*(array[index] for array in arrays), self.antialiased)


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene in the PLY frame of 3DGS with every activation applied (exp, sigmoid).

    Arrays are float64. `sh` may be float32, the numbers of a file; it is converted to float64, a
    batch at a time, before it is computed with.

    quaternion: not necessarily normalised (`gaussians` normalises it); zero is the identity, as in
        the original
    notes: lines about anything odd in the file, for the user
    antialiased: trained with opacity compensation, and rendered with it
    mark: the source of `antialiased`, empty if nothing states it
    assumed_axes: axes by which the file was read if it does not state them, else empty

    NaN and Inf may occur; packing drops and counts them.
    """

    position: np.ndarray  # [N, 3] scene units
    scale: np.ndarray  # [N, 3] standard deviations, scene units, ≥ 0
    quaternion: np.ndarray  # [N, 4] (w, x, y, z)
    opacity: np.ndarray  # [N] in [0, 1]
    sh: np.ndarray  # [N, (degree+1)², 3] RGB
    name: str = ""
    notes: tuple[str, ...] = field(default=())
    antialiased: bool = False
    mark: str = ""
    assumed_axes: str = ""

    def __post_init__(self):
        count = len(self.position)
        shapes = {"position": (3,), "scale": (3,), "quaternion": (4,), "opacity": ()}
        for name, shape in shapes.items():
            array = np.ascontiguousarray(getattr(self, name), np.float64)
            if array.shape != (count, *shape):
                raise InputError(f"{self.name}: {name} has shape {array.shape}")
            object.__setattr__(self, name, array)
        sh = np.asarray(self.sh)
        sh = np.ascontiguousarray(sh, np.float32 if sh.dtype == np.float32 else np.float64)
        if sh.ndim != 3 or len(sh) != count or sh.shape[1] not in (1, 4, 9, 16):
            raise InputError(f"{self.name}: sh has shape {sh.shape}")
        object.__setattr__(self, "sh", sh)

    def __len__(self) -> int:
        return len(self.position)

    @property
    def sh_degree(self) -> int:
        return int(np.sqrt(self.sh.shape[1])) - 1

    def __getitem__(self, index) -> "Scene":
        """Return the Gaussians that a numpy index (slice, mask or integers) selects."""
        return replace(self, **{name: getattr(self, name)[index] for name in ARRAYS})

    def with_sh_degree(self, degree: int) -> "Scene":
        """Return the scene with the coefficients above `degree` dropped."""
        return replace(self, sh=self.sh[:, : sh_count(degree)])

    def decoded(self, index) -> Gaussians:
        """Return the Gaussians that a numpy index selects as the input of a renderer."""
        return self[index].gaussians()

    def gaussians(self) -> Gaussians:
        """Return the input of a renderer: factor = rotation matrix · diag(scale)."""
        factor = np.moveaxis(np.empty((3, len(self), 3)), 1, 0)  # in memory row by row of matrices
        for rows in batches(len(self)):
            rotation = rotation_matrix(self.quaternion[rows])  # [n, 3, 3]
            np.multiply(rotation, self.scale[rows, None, :], out=factor[rows])
        return Gaussians(self.position, factor, self.opacity, self.sh, self.antialiased)


def joined(scenes: Sequence[Scene]) -> Scene:
    """Join scenes into one; all but the arrays is the first one's, harmonics that a scene lacks are
    0."""
    if len(scenes) == 1:
        return scenes[0]
    arrays = {name: np.concatenate([getattr(each, name) for each in scenes]) for name in ARRAYS[:4]}
    most = max(scene.sh.shape[1] for scene in scenes)
    kind = np.result_type(*(scene.sh.dtype for scene in scenes))
    sh, end = np.zeros((len(arrays["position"]), most, 3), kind), 0
    for scene in scenes:
        sh[end : end + len(scene), : scene.sh.shape[1]] = scene.sh
        end += len(scene)
    return replace(scenes[0], **arrays, sh=sh)


def without_zero(quaternion: np.ndarray) -> np.ndarray:
    """Return quaternions [N, 4] (w, x, y, z), with no rotation, (1, 0, 0, 0), for those of norm
    0."""
    with np.errstate(over="ignore"):
        norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(norm == 0, [1.0, 0, 0, 0], quaternion)


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return rotation matrices [N, 3, 3] of quaternions [N, 4] (w, x, y, z), normalised first."""
    with np.errstate(over="ignore", invalid="ignore"):  # infinite ones give NaN
        norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
        w, x, y, z = (quaternion / np.where(norm == 0, 1.0, norm)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
