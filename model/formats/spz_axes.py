"""The sixteen coordinate systems of SPZ files, and scenes turned from them to the axes of PLY.

Source of names and numbers: github.com/nianticlabs/spz, `include/spz/splat-types.h`. A name's
letters say where x, y and z point: Left or Right, Down or Up, Front or Back; half of the systems
are mirrored. Here a name means what its letters say. That library's own conversion between
systems with y and with z up swaps RFD with RBU and LFD with LBU.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.model.formats.harmonics import turn_of
from splatcore.spec.scene import Scene

AXES = tuple("LDB RDB LUB RUB LDF RDF LUF RUF LFD RFD LFU RFU LBD RBD LBU RBU".split())
"""Names in the order of their numbers in a file, 1 … 16."""

PLY_AXES = "RDF"
"""The project's own axes, those of a 3DGS PLY: right, down, front."""

SPZ_AXES = "RUB"
"""The axes of an SPZ that states none, by its specification."""

_WHERE = {"R": (1, 0, 0), "L": (-1, 0, 0), "D": (0, 1, 0), "U": (0, -1, 0)} | {
    "F": (0, 0, 1),
    "B": (0, 0, -1),
}


def matrix(axes: str) -> np.ndarray:
    """M [3, 3] with a 1 or −1 in each row and column: M·p is a point p of these axes in PLY's."""
    return np.array([_WHERE[letter] for letter in axes], np.float64).T


def turned(scene: Scene, axes: str) -> Scene:
    """The scene of arrays in some axes in those of PLY.

    A covariance Σ becomes M·Σ·Mᵀ, which −M gives, too: so of M and −M the rotation Q is taken. A
    rotation R becomes Q·R·Qᵀ: Q turns the quaternion's vector, and scales follow their axes.
    """
    to_ply = matrix(axes)
    order, sign = np.abs(to_ply).argmax(axis=1), to_ply.sum(axis=1)
    rotation = sign * np.linalg.det(to_ply).round()
    swapped = any(order != range(3))  # z is up: only then rows are worth a copy
    position = scene.position[:, order] if swapped else scene.position
    quaternion = scene.quaternion[:, [0, *order + 1]] if swapped else scene.quaternion
    return replace(
        scene,
        position=position * sign,
        scale=scene.scale[:, order] if swapped else scene.scale,
        quaternion=quaternion * [1, *rotation],
        sh=_turned_sh(scene.sh, axes, scene.sh_degree),
    )


def _turned_sh(sh: np.ndarray, axes: str, degree: int) -> np.ndarray:
    """Coefficients [N, K, 3] in the axes of PLY."""
    turn = _turn(axes, degree)
    sign = np.diag(turn)
    return sh * sign[:, None] if (np.abs(sign) == 1).all() else turn @ sh


@cache
def _turn(axes: str, degree: int) -> np.ndarray:
    return turn_of(matrix(axes), degree)
