"""Small scenes for gradients: ordinary ones, and ones with many clamps and thresholds."""

from collections.abc import Callable
from functools import cache

import numpy as np
import torch

from splatcore.spec.camera import Camera, look_at
from splatcore.spec.scene import sh_count
from tb.helpers.dense_splatting import PARAMETERS, Dense, dense_render

FAR = 1e-3
"""Minimum relative distance of all values from thresholds, so that finite differences and rounding
in float32 change no decision."""

Arrays = dict[str, np.ndarray]  # parameters by name


def view(width: int = 37, height: int = 21, focal: float = 30.0) -> Camera:
    """An oblique camera with unequal focal lengths and its principal point off centre."""
    camera = look_at(np.array([0.3, -0.4, -2.0]), np.array([0.1, 0.2, 0.5]), width, height, focal)
    fields = camera.rotation, camera.translation, camera.name
    return Camera(width, height, focal, 1.1 * focal, width / 2 + 0.7, height / 2 - 0.4, *fields)


def splats(
    rng, camera: Camera, count=8, degree=1, opacity=(0.2, 0.9), size=(0.5, 4.0), outside=0.0
) -> Arrays:
    """Gaussians of `size` pixels in the view, and beyond it by a share `outside` of its sides."""
    depth = rng.uniform(1.5, 5.0, count)
    share = rng.uniform(-outside, 1 + outside, (2, count))
    x = (share[0] * (camera.width - 1) + 0.5 - camera.cx) / camera.fx * depth
    y = (share[1] * (camera.height - 1) + 0.5 - camera.cy) / camera.fy * depth
    point = np.stack([x, y, depth], axis=1) - camera.translation
    sides = rng.uniform(*size, (count, 1, 3)) * (depth / camera.fx)[:, None, None]
    turned = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return {
        "position": point @ camera.rotation,
        "factor": turned * sides + 0.1 * sides.min() * rng.normal(size=(count, 3, 3)),
        "opacity": rng.uniform(*opacity, count),
        "sh": rng.normal(0, 0.25, (count, sh_count(degree), 3)),
        "shift": rng.uniform(-0.5, 0.5, (count, 2)),
    }


def dark(rng, camera):
    """Gaussians with colours around 0, about half of which are clamped."""
    arrays = splats(rng, camera, 10)
    arrays["sh"][:, 0] += -0.5 / 0.282
    return arrays


def needles(rng, camera, length=100, thickness=0.01):
    """Gaussians of this length and thickness in pixels."""
    arrays = splats(rng, camera, 6)
    turned = np.linalg.qr(rng.normal(size=(6, 3, 3)))[0]
    depth = (arrays["position"] @ camera.rotation.T + camera.translation)[:, 2]
    sides = (length, thickness, thickness)
    arrays["factor"] = turned * (depth / camera.fx)[:, None, None] * sides
    return arrays


MAKERS: dict[str, tuple[Callable, Camera]] = {
    "ordinary": (splats, view()),
    **{
        f"degree {n}": (lambda rng, camera, n=n: splats(rng, camera, 4, n), view())
        for n in (0, 2, 3)
    },
    "opaque": (lambda *a: splats(*a, 6, opacity=(0.992, 1.0), size=(3.0, 8.0)), view()),
    "dark": (dark, view()),
    "slanted": (lambda *a: splats(*a, 12, size=(4.0, 12.0), outside=0.4), view(32, 24, 9.0)),
    "faint": (lambda *a: splats(*a, 10, opacity=(1.02 / 255, 1.6 / 255), size=(1, 9)), view()),
    "ended": (lambda *a: splats(*a, 24, opacity=(0.7, 1.0), size=(3.0, 9.0)), view(21, 17)),
    "needles": (needles, view()),
    "short needles": (lambda *a: needles(*a, 20, 0.1), view()),
    "below a pixel": (lambda *a: splats(*a, 20, opacity=(0.8, 1.0), size=(0.1, 1.0)), view()),
    "larger than the view": (lambda *a: splats(*a, 6, size=(100.0, 1000.0)), view()),
    "whole tiles": (splats, view(48, 16)),
    "one row": (lambda *a: splats(*a, 6, size=(1.0, 4.0)), view(19, 1)),
    "one pixel": (lambda *a: splats(*a, 4, size=(2.0, 6.0)), view(1, 1)),
    "one Gaussian": (lambda *a: splats(*a, 1), view()),
}
"""By name: function of (random numbers, camera), and the camera."""

ANTIALIASED = (
    "ordinary", "opaque", "slanted", "dark", "needles", "short needles", "below a pixel",
    "larger than the view", "one Gaussian",
)  # fmt: skip
"""Scenes that are also rendered with compensated opacities."""

CASES = [(name, False) for name in MAKERS] + [(name, True) for name in ANTIALIASED]
"""Names of scenes, and whether opacities are compensated."""


def scene(name: str, antialiased: bool = False) -> tuple[Arrays, Camera, Dense]:
    """A scene away from all thresholds, its camera and its picture; the arrays are copies."""
    arrays, camera, dense = _first(name, antialiased)
    return {key: array.copy() for key, array in arrays.items()}, camera, dense


@cache
def _first(name: str, antialiased: bool) -> tuple[Arrays, Camera, Dense]:
    """The first random scene of a kind that is away from all thresholds."""
    make, camera = MAKERS[name]
    for seed in range(400):
        arrays = make(np.random.default_rng(seed), camera)
        dense = dense_render(**tensors(arrays), camera=camera, antialiased=antialiased)
        if dense.margin > FAR:
            return arrays, camera, dense
    raise AssertionError(f"{name}: every scene is at a threshold")


def tensors(arrays: Arrays, kind=torch.float64, gradient: bool = False) -> dict[str, torch.Tensor]:
    """Convert parameters to tensors that are leaves for autograd."""
    return {
        name: torch.tensor(arrays[name], dtype=kind, requires_grad=gradient) for name in PARAMETERS
    }


def loss(found, seed: int = 1) -> torch.Tensor:
    """A loss: a random projection of picture and transmittance, with a deviation of about 1."""
    rng = np.random.default_rng(seed)
    image = torch.tensor(rng.normal(size=found.image.shape), dtype=found.image.dtype)
    rest = torch.tensor(rng.normal(size=found.transmittance.shape), dtype=found.image.dtype)
    return (image * found.image).sum() + (rest * found.transmittance).sum()
