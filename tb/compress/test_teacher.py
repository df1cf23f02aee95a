"""Views and pictures that a scene without photographs learns from."""

from dataclasses import replace

import numpy as np

from splatcore.golden.reference import render
from splatcore.model.cameras.orbit import GAP
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress.teacher import NEARER, teacher_targets, teacher_views
from splatcore.model.generate.generate import generate
from splatcore.spec.camera import look_at
from tb.helpers.compression_scene import nothing

SIZE = (48, 32)


def test_from_all_round():
    """Without cameras the views are `surrounding_views`; broken Gaussians do not matter."""
    scene = generate("garden", 400)
    broken = replace(scene, opacity=np.where(np.arange(400) < 3, np.nan, scene.opacity))
    told = []
    targets = teacher_targets(broken, 5, SIZE, 2, lambda *what: told.append(what))
    wanted = surrounding_views(broken.gaussians(), 5, *SIZE, 2)
    for target, camera in zip(targets, wanted, strict=True):
        assert np.array_equal(target.camera.rotation, camera.rotation)
        assert np.allclose(target.camera.position, camera.position, rtol=1e-12)
    assert [done for _, done, _, _ in told] == [1, 2, 3, 4, 5]


def test_on_the_path_of_cameras():
    """Views as far from the scene as the cameras, with their lens, and none where one is."""
    scene = generate("garden", 400)
    eyes = [np.array([3 * np.sin(a), -1.2, 3 * np.cos(a)]) for a in (0.0, 1.5, 3.0, 4.5)]
    cameras = [look_at(eye, [0, -0.3, 0], 480, 240, 400.0) for eye in eyes]
    views = teacher_views(scene.gaussians(), 20, SIZE, 0, cameras)
    away = [np.linalg.norm(view.position - [0, -0.3, 0]) for view in views]
    whole = np.hypot(3, 0.9)
    assert len(views) == 20 and max(away) / whole < NEARER * 1.01 and whole / min(away) < 1.06
    for view in views:
        assert (view.width, view.height, view.fx, view.fy) == (*SIZE, 40.0, 400 * 32 / 240)
        ahead = [camera.rotation[2] @ view.rotation[2] for camera in cameras]
        assert max(ahead) <= np.cos(GAP)


def test_pictures_are_the_scenes_own():
    """The reference's 8-bit pictures, but for the last bit of single pixels in float32."""
    scene = generate("garden", 400)
    for target in teacher_targets(scene, 3, SIZE, 0, nothing):
        apart = np.abs(target.image - render(scene.gaussians(), target.camera).pixels.astype(int))
        assert apart.max() <= 1 and apart.mean() < 0.01 and target.image.std() > 10
