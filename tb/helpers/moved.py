"""Scenes moved by matrices: an oracle of dense algebra and scipy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation

from splatcore.spec.scene import Scene
from tb.helpers.harmonics import harmonics

DIRECTIONS = np.random.default_rng(5).normal(size=(30, 3))


def covariance(scene: Scene) -> np.ndarray:
    factor = scene.gaussians().factor
    return factor @ factor.transpose(0, 2, 1)


def colours(scene: Scene, directions: np.ndarray) -> np.ndarray:
    return np.einsum("dk,nkc->ndc", harmonics(directions, scene.sh_degree), scene.sh)


def check_moved(found: Scene, scene: Scene, linear: np.ndarray, shift: np.ndarray, bound=1e-5):
    """Check that a scene is another one after p → linear·p + shift, both in the axes of PLY."""
    assert np.abs(found.position - (scene.position @ linear.T + shift)).max() < bound
    assert np.abs(covariance(found) - linear @ covariance(scene) @ linear.T).max() < bound
    assert np.abs(found.opacity - scene.opacity).max() < bound
    before, after = colours(scene, DIRECTIONS), colours(found, DIRECTIONS @ linear.T)
    assert np.abs(before - after).max() < bound


def transform(seed: int, size: float, mirror: bool = False) -> np.ndarray:
    """A random matrix [4, 4] of a rotation or reflection, a uniform scale and a shift."""
    rng, matrix = np.random.default_rng(seed), np.eye(4)
    matrix[:3, :3] = size * Rotation.random(rng=rng).as_matrix() * (-1 if mirror else 1)
    matrix[:3, 3] = rng.normal(size=3)
    return matrix
