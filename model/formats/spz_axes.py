"""The sixteen coordinate systems of SPZ files, and their conversion to the axes of PLY.

Source of names and numbers: github.com/nianticlabs/spz, `include/spz/splat-types.h`. The letters of
a name say where x, y and z point: Left or Right, Down or Up, Front or Back. Half of the systems are
mirrored. We follow the letters; that library's own conversion between systems with y up and with z
up confuses RFD with RBU and LFD with LBU.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from splatcore.model.formats.harmonics import turn_of
from splatcore.spec.scene import Scene

AXES = tuple("LDB RDB LUB RUB LDF RDF LUF RUF LFD RFD LFU RFU LBD RBD LBU RBU".split())
"""Names in the order of their numbers in a file, 1 … 16."""

PLY_AXES = "RDF"
"""The axes of a 3DGS PLY, and of all scenes here: right, down, front."""

SPZ_AXES = "RUB"
"""The axes of an SPZ file that states none, by its specification."""

_WHERE = {"R": (1, 0, 0), "L": (-1, 0, 0), "D": (0, 1, 0), "U": (0, -1, 0)} | {
    "F": (0, 0, 1),
    "B": (0, 0, -1),
}


def matrix(axes: str) -> np.ndarray:
    """The matrix M [3, 3] that converts a point p from these axes to PLY's, M·p; it has one entry
    1 or −1 per row and column."""
    return np.array([_WHERE[letter] for letter in axes], np.float64).T


def turned(scene: Scene, axes: str) -> Scene:
    """Convert a scene from other axes to PLY's.

    A covariance Σ becomes M·Σ·Mᵀ, for M and −M alike. With Q = M or −M, whichever is a rotation, a
    rotation R becomes Q·R·Qᵀ: Q rotates the quaternion's vector, and scales follow their axes.
    """
    to_ply = matrix(axes)
    order, sign = np.abs(to_ply).argmax(axis=1), to_ply.sum(axis=1)
    rotation = sign * np.linalg.det(to_ply).round()
    swapped = any(order != range(3))  # z is up; otherwise only signs change
    turn, sh = _turn(axes, scene.sh_degree), scene.sh
    position = scene.position[:, order] if swapped else scene.position
    quaternion = scene.quaternion[:, [0, *order + 1]] if swapped else scene.quaternion
    return replace(
        scene,
        position=position * sign,
        scale=scene.scale[:, order] if swapped else scene.scale,
        quaternion=quaternion * [1, *rotation],
        sh=turn @ sh.astype(np.float64)
        if swapped
        else sh * np.diag(turn).astype(sh.dtype)[:, None],
    )


@lru_cache
def _turn(axes: str, degree: int) -> np.ndarray:
    return turn_of(matrix(axes), degree)
