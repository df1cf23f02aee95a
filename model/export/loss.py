"""The errors of a scene that a file stores, against the scene that was exported."""

import numpy as np

from splatcore.spec.scene import Scene

UNITS = {
    "position": "scene units",
    "scale": "% of the longest axis",
    "rotation": "degrees",
    "opacity": "0 … 1",
    "colour": "coefficient of degree 0",
    "harmonics": "coefficients from degree 1 on",
}
"""Unit of each field's error."""


def losses(scene: Scene, stored: Scene) -> dict[str, dict[str, float]]:
    """Return the largest error of each field and the root of its mean square, by field.

    scene: as exported
    stored: as read from the file, the same Gaussians in the same order
    """
    apart = np.subtract(stored.sh, scene.sh, dtype=np.float64)
    errors = {
        "position": np.linalg.norm(stored.position - scene.position, axis=1),
        "scale": 100 * _of_longest(stored.scale - scene.scale, scene.scale),
        "rotation": np.degrees(angles(stored.quaternion, scene.quaternion)),
        "opacity": stored.opacity - scene.opacity,
        "colour": apart[:, 0],
        "harmonics": apart[:, 1:],
    }
    return {
        name: {
            "largest": float(np.abs(error).max()),
            "rms": float(np.sqrt(np.mean(np.square(error)))),
        }
        for name, error in errors.items()
        if error.size
    }


def _of_longest(error: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Errors [N, 3] as a share of each Gaussian's longest axis."""
    longest = scale.max(axis=1, keepdims=True)
    return error / np.where(longest > 0, longest, 1)


def angles(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles [N] in radians between rotations by quaternions [N, 4], accurate also near 0."""
    one, other = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (one, other))
    other = other * np.where((one * other).sum(axis=1) < 0, -1, 1)[:, None]
    chord = np.linalg.norm(one - other, axis=1)
    return 4 * np.arcsin(np.minimum(chord / 2, 1))
