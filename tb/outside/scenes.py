"""The scenes that gsplat renders, from seeded generators.

Each is small; image sizes are no multiples of a tile, fx ≠ fy, and cameras are rotated about all
axes.
"""

from dataclasses import replace

import numpy as np

from splatcore.spec.camera import Camera, look_at
from splatcore.spec.scene import Scene, sh_count
from tb.outside.stored import Case


def exact(array: np.ndarray) -> np.ndarray:
    """Round to float32, returned as float64."""
    return np.asarray(array, np.float32).astype(np.float64)


def build(rng, name: str, position, scale, opacity, degree: int, detail: float) -> Scene:
    """A scene with random quaternions, which are not normalised.

    position, scale: [N, 3]
    opacity: [N]
    detail: standard deviation of the spherical harmonics above degree 0; it is 1 for degree 0, so
        that some colours are negative
    """
    count = len(position)
    quaternion = rng.normal(size=(count, 4))
    sh = rng.normal(size=(count, sh_count(degree), 3))
    sh[:, 1:] *= detail
    arrays = (exact(array) for array in (position, scale, quaternion, opacity, sh))
    return Scene(*arrays, name=name)


def cloud() -> Case:
    """A general scene: a cloud of Gaussians of all sizes and opacities, SH of degree 3."""
    rng = np.random.default_rng(1)
    count = 800
    position = rng.normal(size=(count, 3))
    scale = np.exp(rng.normal(-3.1, 0.8, size=(count, 3)))
    opacity = 1 / (1 + np.exp(-rng.normal(0.5, 2.0, size=count)))
    scene = build(rng, "cloud", position, scale, opacity, 3, 0.25)
    camera = look_at((1.6, -1.1, -3.1), (0.1, 0.05, 0.0), 131, 89, 118.0, (0.1, 1.0, 0.05))
    return Case(scene, replace(camera, fy=103.0))


def needles() -> Case:
    """Axis ratios up to 1e4, lengths from far below a pixel to the whole screen, nearly opaque.

    One pixel in twenty ends early. Some Gaussians are flat (a scale of 0), some have opacity 1,
    others an opacity just above or below 1/255.
    """
    rng = np.random.default_rng(2)
    count = 700
    position = rng.uniform(-1.5, 1.5, size=(count, 3))
    longest = 10 ** rng.uniform(-3.0, 0.15, size=(count, 1))
    scale = longest * 10 ** -rng.uniform(0.4, 4.0, size=(count, 3))
    scale[:, 0] = longest[:, 0]
    scale[::50, 2] = 0.0
    opacity = 1 - 0.4 * rng.uniform(size=count) ** 2
    opacity[::9] = 1.0
    opacity[4::40] = rng.uniform(0.8 / 255, 2 / 255, size=opacity[4::40].shape)
    scene = build(rng, "needles", position, scale, opacity, 0, 0.0)
    camera = look_at((-0.7, 1.9, 3.4), (0.0, 0.1, -0.2), 117, 95, 97.0, (-0.2, 1.0, 0.1))
    return Case(scene, replace(camera, fy=109.0))


def near() -> Case:
    """A camera inside its scene: 120° wide, Gaussians behind, at and just beyond the near plane.

    Many centres are outside of 1.3·tan(fov/2), where the Jacobian is clamped, but their splats
    still reach the screen; one splat covers all of it. SH of degree 1, not a black background.
    """
    rng = np.random.default_rng(3)
    amid = rng.uniform((-4.0, -4.0, -0.6), (4.0, 4.0, 3.0), size=(300, 3))
    edge = rng.uniform((-0.3, -0.3, 0.15), (0.3, 0.3, 0.3), size=(60, 3))
    position = np.concatenate([amid, edge, [(0.2, -0.1, 2.2)]])  # [361, 3] camera space
    sizes = np.repeat([-2.2, -3.8, 1.8], [300, 60, 1])  # logarithms
    scale = np.exp(rng.normal(sizes[:, None], 0.6, size=(361, 3)))
    opacity = rng.uniform(0.05, 0.95, size=361)
    opacity[-1] = 0.35
    camera = look_at((5.0, -3.0, 7.0), (4.3, -2.4, 5.5), 107, 91, 31.0, (0.1, 1.0, -0.2))
    camera = replace(camera, fy=34.0)
    scene = build(rng, "near", world(camera, position), scale, opacity, 1, 0.4)
    return Case(scene, camera, background=(0.2, 0.5, 0.8))


def dust() -> Case:
    """Marked as antialiased: round and flat Gaussians from 1/20 of a pixel to a few pixels."""
    rng = np.random.default_rng(4)
    count = 2400
    position = rng.normal(0, 0.75, size=(count, 3))
    scale = 10 ** rng.uniform(-2.8, -1.1, size=(count, 1)) * rng.uniform(0.3, 1, (count, 3))
    scale[::40, 1] = 0.0
    scene = build(rng, "dust", position, scale, rng.uniform(0.3, 1, count), 0, 0.0)
    camera = look_at((-1.3, 0.9, -3.2), (0.05, 0.1, 0.0), 115, 93, 121.0, (0.15, 1.0, -0.1))
    return Case(replace(scene, antialiased=True), replace(camera, fy=108.0))


def fibres() -> Case:
    """Marked as antialiased: needles up to 100 pixels long, down to a thousandth of a pixel thick.

    Compensation lowers the opacity of some to about 1/255 or less; lines are invisible.
    """
    rng = np.random.default_rng(5)
    count = 900
    position = rng.uniform(-1.3, 1.3, size=(count, 3))
    scale = 10 ** rng.uniform(-4.5, -1.5, size=(count, 3))
    scale[:, 0] = 10 ** rng.uniform(-1.2, 0.4, size=count)
    scale[::30, 1:] = 0.0
    opacity = 1 - 0.5 * rng.uniform(size=count) ** 2
    scene = build(rng, "fibres", position, scale, opacity, 1, 0.3)
    camera = look_at((2.1, 1.2, 2.9), (0.0, -0.1, 0.1), 109, 99, 103.0, (0.1, 1.0, 0.2))
    return Case(replace(scene, antialiased=True), replace(camera, fy=95.0), (0.3, 0.1, 0.6))


def world(camera: Camera, position: np.ndarray) -> np.ndarray:
    """Convert camera space [N, 3] to world space [N, 3]."""
    return (position - camera.translation) @ camera.rotation


CASES = {"cloud": cloud, "needles": needles, "near": near, "dust": dust, "fibres": fibres}
