"""The differentiable renderer against a dense one in torch, finite differences, the reference.

The call of gsplat for a CUDA device is tested with a stand-in; gsplat's own pictures are not.
"""

import inspect
from dataclasses import replace

import numpy as np
import pytest
import torch

from splatcore.golden.reference import render as reference
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.model.gradients.differentiable import _render_cuda, render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import ALPHA_MIN, NEAR_PLANE, SPLATCORE
from splatcore.spec.scene import Gaussians
from tb.helpers.dense_splatting import PARAMETERS, dense_render
from tb.helpers.scenes import random_scene
from tb.helpers.splatting_scenes import CASES, loss, scene, tensors, view

EXACT = 3e-8
"""Relative error in float64: the kernels' exponential is within 4e-10; 1.7e-8 is the worst seen,
where terms of a sum over pixels cancel."""

SINGLE = 1e-4  # relative error in float32: needles reach 3.4e-5, the rest 1e-5

REACHED = {
    "opaque": "opaque", "dark": "dark", "slanted": "slanted", "faint": "faint", "ended": "ended",
    "one pixel": "slanted",
}  # fmt: skip
"""Clamp or threshold that each scene must reach."""


def gradients(arrays, camera, kind=torch.float64, renderer=render, antialiased=False):
    """Render; return the picture and the gradients of its loss by name."""
    leaves = tensors(arrays, kind, gradient=True)
    found = renderer(**leaves, camera=camera, antialiased=antialiased)
    loss(found).backward()
    return found, {name: leaf.grad.numpy() for name, leaf in leaves.items()}


def check_against_dense(arrays, camera, antialiased=False):
    """Check picture and gradients against the dense renderer; return both renderers' results."""
    dense, wanted = gradients(arrays, camera, renderer=dense_render, antialiased=antialiased)
    found, gradient = gradients(arrays, camera, antialiased=antialiased)
    assert float((found.image - dense.image).detach().abs().max()) < EXACT
    for key in PARAMETERS:
        assert worst(gradient[key], wanted[key]) < EXACT, key
    return found, dense, wanted


def worst(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference relative to the largest value of the same Gaussian; 0/0 is 0."""
    error = np.abs(found - wanted).reshape(len(wanted), -1).max(1)
    size = np.abs(wanted).reshape(len(wanted), -1).max(1)
    assert (error[size == 0] == 0).all(), "a gradient that has to be 0"
    return float((error[size > 0] / size[size > 0]).max(initial=0))


@pytest.mark.parametrize("name, antialiased", CASES)
def test_equals_the_dense_renderer(name, antialiased):
    arrays, camera, dense = scene(name, antialiased)
    if name in REACHED:
        assert dense.clamped[REACHED[name]] > 0
    found, dense, wanted = check_against_dense(arrays, camera, antialiased=antialiased)
    assert float((found.transmittance - dense.transmittance).detach().abs().max()) < EXACT
    assert (np.abs(wanted["sh"]).max((1, 2)) > 0).sum() >= len(wanted["sh"]) // 2
    found, gradient = gradients(arrays, camera, torch.float32, antialiased=antialiased)
    assert found.image.dtype == torch.float32
    assert float((found.image - dense.image).detach().abs().max()) < SINGLE
    for key in PARAMETERS:
        assert np.abs(gradient[key] - wanted[key]).max() < SINGLE * np.abs(wanted[key]).max(), key


@pytest.mark.slow
@pytest.mark.parametrize("name, antialiased", CASES)
def test_finite_differences(name, antialiased):
    """Gradients against central differences of every parameter; steps are 3e-6 of its largest
    value, finer if a needle's thickness decides its opacity."""
    arrays, camera, _ = scene(name, antialiased)
    _, gradient = gradients(arrays, camera, antialiased=antialiased)
    for key in PARAMETERS:
        found = np.zeros_like(arrays[key])
        fine = antialiased and name == "needles" and key == "factor"
        step = (1e-9 if fine else 3e-6) * np.abs(arrays[key]).max()
        for place in np.ndindex(found.shape):
            values = []
            for sign in (1, -1):
                moved = {**arrays, key: arrays[key].copy()}
                moved[key][place] += sign * step
                with torch.no_grad():
                    found_there = render(**tensors(moved), camera=camera, antialiased=antialiased)
                    values.append(float(loss(found_there)))
            found[place] = (values[0] - values[1]) / (2 * step)
        rounding = 1e-13 / step
        error = np.abs(found - gradient[key]).max()
        assert error < 1e-6 * np.abs(found).max() + rounding, key


def test_another_near_plane():
    """The near plane has an effect, the same as in the dense renderer."""
    arrays, camera, _ = scene("ordinary")
    plain, _ = gradients(arrays, camera)
    found, *_ = check_against_dense(arrays, replace(camera, near=3.0))
    assert not torch.allclose(plain.image, found.image)


def invisible(kind: str, arrays: dict, camera) -> None:
    """Move Gaussian 0 just out of view, or make it just too faint."""
    point = arrays["position"][0] @ camera.rotation.T + camera.translation
    if kind == "near":
        point *= NEAR_PLANE * (1 - 1e-9) / point[2]
    elif kind == "behind":
        point *= -1
    elif kind == "outside":
        point[0] = 40 * point[2]
    arrays["position"][0] = (point - camera.translation) @ camera.rotation
    if kind == "transparent":
        arrays["opacity"][0] = ALPHA_MIN * (1 - 1e-9)


@pytest.mark.parametrize("kind", ["near", "behind", "outside", "transparent"])
def test_invisible_gaussians_have_no_gradient(kind):
    arrays, camera, _ = scene("ordinary")
    invisible(kind, arrays, camera)
    found, gradient = gradients(arrays, camera)
    assert 0 not in found.visible and len(found.visible) > 4
    others, wanted = gradients({key: a[1:] for key, a in arrays.items()}, camera)
    assert torch.equal(found.image, others.image)
    for key in PARAMETERS:
        assert not gradient[key][0].any(), key
        assert np.array_equal(gradient[key][1:], wanted[key]), key


@pytest.mark.parametrize("count", [0, 3])
def test_nothing_visible(count):
    arrays = {key: array[:count] for key, array in scene("ordinary")[0].items()}
    arrays["opacity"][:] = 0.001
    found, gradient = gradients(arrays, view())
    assert found.visible.shape == (0,) and (found.transmittance == 1).all()
    assert found.image.shape == (21, 37, 3) and not found.image.any()
    for key in PARAMETERS:
        assert gradient[key].shape == arrays[key].shape and not gradient[key].any()
    (weights,) = blending_weights(gaussians_of(arrays), [view()])
    assert weights.shape == (count,) and not weights.any()


AT_THRESHOLDS = {"opacity_edge": 64, "transmittance_edge": 64}
"""Hard cases with values exactly at a threshold: pixels that may differ (45 do)."""

IN_SINGLE = {"swinging_harmonics": 1}
"""The same in float32 only: an alpha close to 1/255, decided by its rounding."""


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("name", GENERATORS)
def test_picture_of_the_reference(name, antialiased):
    made = generate(name, 3000 if name == "garden" else None)
    camera = generated_camera(name)
    if name == "garden":
        camera = camera.resized(133, 75)
    gaussians = replace(made.gaussians(), antialiased=antialiased)
    arrays = [gaussians.position, gaussians.factor, gaussians.opacity, gaussians.sh]
    if name == "not_finite":  # the reader drops such Gaussians
        sound = np.all([np.isfinite(a).reshape(len(a), -1).all(1) for a in arrays], axis=0)
        arrays = [a[sound] for a in arrays]
    wanted = reference(gaussians, camera)
    found = render(*(torch.tensor(a) for a in arrays), camera, antialiased=antialiased)
    error = np.abs(found.image.numpy() - wanted.image).max(2)
    error = np.maximum(error, np.abs(found.transmittance.numpy() - wanted.transmittance))
    assert (error > EXACT).sum() <= AT_THRESHOLDS.get(name, 0) and error.max() < ALPHA_MIN
    if antialiased:  # the reference drops splats that reach no pixel centre
        assert len(found.visible) >= wanted.counts["visible"]
    else:
        assert len(found.visible) == wanted.counts["visible"]
    if name == "near_plane":  # in float32 they are on the other side
        return
    arrays = (torch.tensor(a, dtype=torch.float32) for a in arrays)
    single = render(*arrays, camera, antialiased=antialiased)
    error = np.abs(single.image.numpy() - wanted.image).max(2)
    most = {"far_from_origin": 1e-2}.get(name, SINGLE)  # positions need more digits
    others = (AT_THRESHOLDS | IN_SINGLE).get(name, 0)
    assert (error > most).sum() <= others and error.max() < 1e-2


def gaussians_of(arrays, antialiased: bool = False) -> Gaussians:
    """The Gaussians of the parameter arrays."""
    return Gaussians(*(arrays[key] for key in PARAMETERS[:4]), antialiased)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("name", ["ordinary", "opaque", "dark", "ended", "below a pixel"])
def test_blending_weights(name, antialiased):
    arrays, camera, _ = scene(name, antialiased)
    arrays["shift"][:] = 0
    dense = dense_render(**tensors(arrays), camera=camera, antialiased=antialiased)
    for kind, most in ((np.float64, EXACT), (np.float32, SINGLE)):
        (found,) = blending_weights(gaussians_of(arrays, antialiased), [camera], kind)
        assert np.abs(found - dense.weight.numpy()).max() < most * float(dense.weight.max())
    if name == "ended":
        assert not found[dense.weight.numpy() == 0].any()


def test_arrangement_in_memory_does_not_matter():
    arrays, camera, _ = scene("degree 2")
    _, wanted = gradients(arrays, camera)
    leaves = {}
    for key, array in arrays.items():
        wide = torch.full((*array.shape, 2), torch.nan, dtype=torch.float64)
        wide[..., 0] = torch.tensor(array)
        turned = wide[..., 0] if array.ndim == 1 else wide[..., 0].mT.contiguous().mT
        leaves[key] = turned.detach().requires_grad_()
        assert len(array) == 1 or not leaves[key].is_contiguous()
    found = render(**leaves, camera=camera)
    turned = torch.empty(37, 21, 3, dtype=torch.float64).transpose(0, 1)  # transposed in memory
    generator = np.random.default_rng(1)
    turned[:] = torch.tensor(generator.normal(size=found.image.shape))
    rest = torch.tensor(generator.normal(size=found.transmittance.shape))
    torch.autograd.backward([found.image, found.transmittance], [turned, rest])
    for key in PARAMETERS:
        assert np.array_equal(leaves[key].grad.numpy(), wanted[key]), key


@pytest.mark.parametrize("wanted", PARAMETERS)
def test_some_parameters_need_no_gradient(wanted):
    arrays, camera, _ = scene("ordinary")
    leaves = tensors(arrays)
    leaves[wanted].requires_grad_()
    loss(render(**leaves, camera=camera)).backward()
    assert np.array_equal(leaves[wanted].grad.numpy(), gradients(arrays, camera)[1][wanted])
    assert all(leaf.grad is None for key, leaf in leaves.items() if key != wanted)
    assert not render(**tensors(arrays), camera=camera).image.requires_grad


def test_gradient_of_a_part_of_the_result():
    arrays, camera, _ = scene("opaque")
    for part in (lambda found: found.transmittance[3:, ::2].square().sum(),
                 lambda found: found.image[..., 1].mean()):  # fmt: skip
        leaves, dense = tensors(arrays, gradient=True), tensors(arrays, gradient=True)
        part(render(**leaves, camera=camera)).backward()
        part(dense_render(**dense, camera=camera)).backward()
        for key in PARAMETERS:
            wanted = torch.zeros_like(dense[key]) if dense[key].grad is None else dense[key].grad
            assert worst(leaves[key].grad.numpy(), wanted.numpy()) < EXACT, key


def test_shift_may_be_left_out():
    arrays, camera, _ = scene("ordinary")
    arrays["shift"][:] = 0
    leaves = tensors(arrays)
    del leaves["shift"]
    found = render(**leaves, camera=camera)
    assert torch.equal(found.image, render(**tensors(arrays), camera=camera).image)


def stand_in(given: dict) -> tuple[torch.Tensor, torch.Tensor, dict]:
    """gsplat.rasterization for one camera, not packed, with covariances instead of scales: it uses
    all arguments, and renders with the CPU's kernels."""
    assert given["quats"] is None and given["scales"] is None and not given["packed"]
    assert (given["sh_degree"] + 1) ** 2 == given["colors"].shape[1]
    assert given["near_plane"] == NEAR_PLANE
    assert given["eps2d"] == SPLATCORE.covariance_blur
    (view,), (intrinsics,) = given["viewmats"].numpy(), given["Ks"].numpy()
    camera = Camera(
        given["width"], given["height"], intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2],
        intrinsics[1, 2], view[:3, :3], view[:3, 3],
    )  # fmt: skip
    count = len(given["means"])
    means2d = torch.zeros((1, count, 2), dtype=torch.float64, requires_grad=True) * 1.0
    factor = torch.linalg.cholesky(given["covars"])
    drawn = render(
        given["means"], factor, given["opacities"], given["colors"], camera, means2d[0],
        antialiased=given["rasterize_mode"] == "antialiased",
    )  # fmt: skip
    radii = torch.zeros((1, count, 2), dtype=torch.int32)
    radii[0, torch.as_tensor(drawn.visible)] = 3
    found = {"means2d": means2d, "radii": radii}
    return drawn.image[None], (1 - drawn.transmittance)[None, ..., None], found


@pytest.mark.parametrize("degree, antialiased", [(0, False), (1, False), (1, True), (3, False)])
def test_the_call_for_cuda(monkeypatch, degree, antialiased):
    """Picture, transmittance, visible Gaussians and centres' gradients equal the CPU's."""
    gsplat = pytest.importorskip("gsplat")
    real = inspect.signature(gsplat.rasterization)

    def rasterization(*arguments, **options):
        call = real.bind(*arguments, **options)
        call.apply_defaults()
        return stand_in(call.arguments)

    monkeypatch.setattr(gsplat, "rasterization", rasterization)
    gaussians = random_scene(40, degree).gaussians()
    camera = look_at(np.array([0.3, -1.0, -5.0]), np.zeros(3), 50, 40, 45.0)
    arrays = (gaussians.position, gaussians.factor, gaussians.opacity, gaussians.sh)
    tensors = [torch.tensor(array) for array in arrays]
    wanted = np.random.default_rng(0).random((40, 50, 3))
    found = []
    for renderer in (render, _render_cuda):
        centre = torch.zeros((1, 40, 2), dtype=torch.float64, requires_grad=True)
        shift = centre[0]  # as in training: a view of the tensor that has the gradient
        drawn = renderer(*tensors, camera, shift, antialiased)
        (drawn.image * torch.tensor(wanted)).sum().backward()
        picture = drawn.image.detach(), drawn.transmittance.detach()
        found.append((*picture, np.sort(drawn.visible), centre.grad))
    for cpu, cuda in zip(*found, strict=True):
        assert np.allclose(cpu, cuda, rtol=1e-5, atol=1e-9)
    assert found[0][3].abs().max() > 0
