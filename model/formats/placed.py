"""Scenes as parts of a larger one: moved by a node's transform, joined to a single scene."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.formats.file import input_error
from splatcore.model.formats.harmonics import turn_of
from splatcore.spec.scene import Scene, joined, without_zero

UNEVEN = 1e-4
"""Largest accepted relative difference of a transform's scales: transforms have rounded numbers."""


def placed(scene: Scene, matrix: np.ndarray, where: object) -> Scene:
    """Move a scene by a rotation or reflection, a uniform scale and a translation.

    matrix: [4, 4], maps points (x, y, z, 1)
    where: name of the transform for messages

    Raises InputError for a transform that makes other shapes of Gaussians: shear, scales that
    differ by axis.
    """
    if np.array_equal(matrix, np.eye(4)):
        return scene
    rotation, size = _parts(matrix, where)
    # M and −M act alike on a covariance; one of them has a quaternion.
    turn = _quaternion(rotation * np.linalg.det(rotation).round())
    return replace(
        scene,
        position=scene.position @ matrix[:3, :3].T + matrix[:3, 3],
        scale=scene.scale * size,
        quaternion=_product(turn, without_zero(scene.quaternion)),
        sh=turn_of(rotation, scene.sh_degree) @ scene.sh.astype(np.float64),
    )


def _parts(matrix: np.ndarray, where: object) -> tuple[np.ndarray, float]:
    """The rotation or reflection [3, 3] and the uniform scale of a transform."""
    if not np.isfinite(matrix).all():
        raise input_error(where, "transform has numbers beyond float64")
    linear = matrix[:3, :3]
    if matrix[3].tolist() != [0, 0, 0, 1]:
        raise input_error(where, "transform is not affine")
    left, sizes, right = np.linalg.svd(linear)
    if not sizes[2] > 0:
        raise input_error(where, "transform has a scale of 0")
    if sizes[0] - sizes[2] > UNEVEN * sizes[0]:
        lengths = np.linalg.norm(linear, axis=0)
        lean = np.abs((linear.T @ linear / np.outer(lengths, lengths)) - np.eye(3)).max()
        kind = "shear" if lean > UNEVEN else "a scale that is not uniform"
        shown = " × ".join(f"{length:.4g}" for length in lengths)
        raise input_error(where, f"transform with {kind} ({shown}) is not supported")
    return left @ right, float(np.cbrt(np.prod(sizes)))


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """The unit quaternion (w, x, y, z) of a rotation matrix."""
    from scipy.spatial.transform import Rotation  # takes a quarter of a second

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def _product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The quaternion product left·right, [4] and [N, 4]: right rotates first."""
    w, x, y, z = left
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return right @ matrix.T


def merged(scenes: Sequence[Scene]) -> Scene:
    """One scene of all Gaussians, with name, mark and assumed axes of the first.

    Notes are listed once each. If only some scenes are antialiased, none is, with a note.
    """
    if len(scenes) == 1:
        return scenes[0]
    notes = tuple(dict.fromkeys(note for scene in scenes for note in scene.notes))
    marked = sum(scene.antialiased for scene in scenes)
    if 0 < marked < len(scenes):
        notes += (f"{marked} of {len(scenes)} parts are marked antialiased; rendered without",)
        return replace(joined(scenes), notes=notes, antialiased=False, mark="")
    return replace(joined(scenes), notes=notes)
