"""Training from photographs: it learns, grows and resumes; its loss; errors are reported."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress import train as train_module
from splatcore.model.compress.compress import decibels
from splatcore.model.compress.teacher import pictures
from splatcore.model.compress.train import Training, initial_scene, photograph_loss, ssim, train
from splatcore.model.formats.photographs import Target
from splatcore.model.generate.generate import generate
from splatcore.spec.colour import SH_C0
from splatcore.spec.error import InputError
from tb.helpers.compression_scene import nothing
from tb.helpers.refusal import refused

STEPS = 60


@pytest.fixture(scope="module")
def garden():
    return generate("garden", 500)


@pytest.fixture(scope="module")
def photographs(garden) -> list[Target]:
    return list(pictures(garden, surrounding_views(garden.gaussians(), 5, 80, 60)))


@pytest.fixture(scope="module")
def points(garden):
    colour = np.clip(garden.sh[:, 0] * SH_C0 + 0.5, 0, 1) * 255
    return garden.position[::2], colour[::2].astype(np.uint8)


@pytest.fixture(scope="module", autouse=True)
def often():
    """Densify and keep states within a few steps."""
    with pytest.MonkeyPatch.context() as patch:
        for name, steps in (("REFINE_START", 10), ("REFINE_EVERY", 10), ("KEEP_EVERY", 20)):
            patch.setattr(train_module, name, steps)
        yield


@pytest.fixture(scope="module")
def whole(photographs, points, often, tmp_path_factory):
    """A complete training: the scene, and every progress report."""
    reports, folder = [], tmp_path_factory.mktemp("whole")
    return train(photographs, points, STEPS, 0, folder, lambda *one: reports.append(one)), reports


def test_it_learns_and_grows(photographs, points, whole):
    scene, reports = whole
    start = initial_scene(*points)
    assert decibels(scene, photographs) > decibels(start, photographs) + 2
    assert len(scene) > len(start) and scene.sh_degree == 3
    assert [report[1:3] for report in reports] == [(step + 1, STEPS) for step in range(STEPS)]
    assert np.abs(scene.sh[:, 1:]).max() > 0


def test_it_goes_on_where_it_stopped(photographs, points, whole, tmp_path):
    """Stopped and resumed from its last state, a training ends with the same scene."""

    class Stop(Exception):
        pass

    def stop(phase, done, total, loss):
        if done == 47:
            raise Stop

    with pytest.raises(Stop):
        train(photographs, points, STEPS, 0, tmp_path / "a", stop)
    reports = []
    scene = train(photographs, points, STEPS, 0, tmp_path / "a", lambda *one: reports.append(one))
    assert reports[0][1] == 41  # the last state was kept after 40
    assert np.array_equal(scene.position, whole[0].position)
    assert np.array_equal(scene.sh, whole[0].sh)


def test_another_trainings_state(photographs, points, tmp_path):
    train(photographs, points, 20, 0, tmp_path, nothing)
    with pytest.raises(InputError, match=r"training.pt: belongs to a different training run"):
        train(photographs, points, 30, 0, tmp_path, nothing)
    (tmp_path / "training.pt").write_bytes(b"broken")
    with pytest.raises(InputError, match=r"training.pt: is not a state of training"):
        train(photographs, points, 20, 0, tmp_path, nothing)


def test_nan_in_the_loss(photographs, points, tmp_path, monkeypatch):
    calls = []

    def wrong(picture, wanted):
        calls.append(1)
        return photograph_loss(picture, wanted) * (float("nan") if len(calls) == 26 else 1)

    monkeypatch.setattr(train_module, "photograph_loss", wrong)
    with pytest.raises(InputError, match=r"loss is nan at step 26; the last state is in .*\.pt"):
        train(photographs, points, STEPS, 0, tmp_path, nothing)
    monkeypatch.undo()
    assert torch.load(tmp_path / "training.pt")["step"] == 20


def test_too_few_points(photographs, points):
    refused("3 points are too few", initial_scene, points[0][:3], points[1][:3])


def test_initial_scene(points):
    """Sizes are the RMS distance to the three nearest points; colours are the points'."""
    scene = initial_scene(*points)
    distance = np.linalg.norm(points[0] - points[0][7], axis=1)
    near = np.sort(distance)[1:4]
    assert np.allclose(scene.scale[7], np.sqrt((near**2).mean()))
    assert np.allclose(scene.sh[:, 0] * SH_C0 + 0.5, points[1] / 255)
    assert (scene.opacity == train_module.OPACITY).all() and not scene.sh[:, 1:].any()


def test_harmonics_join_one_after_the_other(photographs, points):
    training = Training(initial_scene(*points), 1.0, 60, 0)
    training.advance(photographs[0])
    assert not training.tensors["shN"].detach().any()
    training.step = 3
    training.advance(photographs[0])
    rest = training.tensors["shN"].detach()
    assert rest[:, :3].any() and not rest[:, 3:].any()


def test_ssim_is_scikits():
    """Pictures are padded, because the two implementations differ at the edges."""
    rng = np.random.default_rng(0)
    first = rng.random((40, 50, 3))
    second = np.clip(first + 0.1 * rng.standard_normal(first.shape), 0, 1)
    wide = [np.pad(image, ((20, 20), (20, 20), (0, 0))) for image in (first, second)]
    found = float(ssim(*map(torch.tensor, wide)))
    exact = structural_similarity(
        *wide, channel_axis=2, data_range=1, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, full=True,
    )[1].mean()  # fmt: skip
    assert abs(found - exact) < 1e-6


def test_gradients_of_the_loss():
    rng = np.random.default_rng(0)
    picture = torch.tensor(rng.random((9, 14, 3)), requires_grad=True)
    wanted = torch.tensor(rng.random((9, 14, 3)))
    assert torch.autograd.gradcheck(lambda image: photograph_loss(image, wanted), (picture,))
    planes = torch.tensor(rng.random((2, 9, 14)), requires_grad=True)
    assert torch.autograd.gradcheck(train_module.blur, (planes,))


def test_planes_are_blurred_alike_on_every_device():
    """The sum of shifted planes, used on CUDA, and its gradient equal the CPU's blur."""
    rng = np.random.default_rng(5)
    weight, found = torch.tensor(rng.random((2, 9, 14))), []
    values = rng.random((2, 9, 14))
    for blur in (train_module.blur, lambda p: train_module.shifted(train_module.shifted(p, 2), 1)):
        planes = torch.tensor(values, requires_grad=True)
        blurred = blur(planes)
        (blurred * weight).sum().backward()
        found.append((blurred.detach(), planes.grad))
    for cpu, cuda in zip(*found, strict=True):
        assert np.allclose(cpu, cuda, rtol=1e-12, atol=1e-14)
