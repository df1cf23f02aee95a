"""Scenes for tests: the real files (SPLATCORE_SCENES) and small random ones."""

from pathlib import Path

import numpy as np
import pytest

from splatcore.sim.frame.source import scene_folder
from splatcore.spec.scene import Scene, sh_count

ROOT = Path(__file__).resolve().parents[2]
SCENES = (ROOT / scene_folder()).resolve()
"""The folder of the real scenes; a relative path starts at the repository root."""

GAUSSIANS = {
    "flowers.spz": (542_104, 2),
    "playbot.spz": (500_000, 2),
    "skull.sog": (94_936, 3),
    "guitar.compressed.ply": (90_854, 0),
    "luma-seal.splat": (101_780, 0),
    "st-peter.sog": (133_618, 0),
    "kitchen.spz": (213_944, 0),
    "leica-sofort-top8192.ply": (8_192, 3),
    "leica-sofort-top8192.sog": (8_192, 3),
    "yashica-t4-top8192.ply": (8_192, 3),
}
"""Gaussians and SH degree by file, from SOURCES.md in the folder."""


REAL = (
    pytest.mark.scenes,
    pytest.mark.skipif(not SCENES.is_dir(), reason="needs the real scenes: set SPLATCORE_SCENES"),
)
"""Marks of tests with real scenes: `scenes`, and skipped without the folder."""


def needs_scenes(test):
    """Decorator of tests with real scenes."""
    scenes, skipped = REAL
    return scenes(skipped(test))


def scene_path(name: str) -> Path:
    """The path of a real scene or camera file."""
    return SCENES / name


def random_scene(count: int, degree: int, seed: int = 0) -> Scene:
    """A scene of `count` Gaussians in a cube of side 4 around the origin."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    return Scene(
        position=rng.uniform(-2, 2, (count, 3)),
        scale=np.exp(rng.uniform(-6, 0, (count, 3))),
        quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        opacity=rng.uniform(0.05, 0.95, count),
        sh=rng.uniform(-0.9, 0.9, (count, sh_count(degree), 3)),
    )
