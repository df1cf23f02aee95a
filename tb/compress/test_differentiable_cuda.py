"""The call of gsplat for a CUDA device.

gsplat's rasterizer needs such a device, so a stand-in replaces it: it has the same signature, uses
all arguments, and renders with the CPU's kernels. gsplat's own pictures are not tested here.
"""

import inspect

import numpy as np
import pytest
import torch

from splatcore.model.gradients.differentiable import _render_cuda, render
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import NEAR_PLANE, SPLATCORE
from tb.helpers.scenes import random_scene

gsplat = pytest.importorskip("gsplat")

REAL = inspect.signature(gsplat.rasterization)


def stand_in(*arguments, **options):
    """gsplat.rasterization for one camera, not packed, with covariances instead of scales."""
    call = REAL.bind(*arguments, **options)
    call.apply_defaults()
    given = call.arguments
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
def test_the_call(monkeypatch, degree, antialiased):
    """Picture, transmittance, visible Gaussians and centres' gradients equal the CPU's."""
    monkeypatch.setattr(gsplat, "rasterization", stand_in)
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
