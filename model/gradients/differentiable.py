"""Differentiable rendering: Gaussians as torch tensors in, a picture with gradients out.

`gsplat` rasterizes on a CUDA device, the numba kernels of this folder on a CPU. Both follow
`spec.convention`, gsplat as far as its options allow (see `_render_cuda`).
"""

from dataclasses import dataclass

import numpy as np
import torch
from numba import get_num_threads

from splatcore.model.gradients import rendering_points
from splatcore.model.gradients.drawn import Drawn, to_image, to_tiles
from splatcore.spec.camera import Camera
from splatcore.spec.convention import SPLATCORE


@dataclass(frozen=True, eq=False)
class Rendered:
    """A picture, and which Gaussians are in it."""

    image: torch.Tensor  # [H, W, 3] RGB over black, not clipped
    transmittance: torch.Tensor  # [H, W]
    visible: np.ndarray  # [M] indices of the visible Gaussians


def render(
    position: torch.Tensor,
    factor: torch.Tensor,
    opacity: torch.Tensor,
    sh: torch.Tensor,
    camera: Camera,
    shift: torch.Tensor | None = None,
    antialiased: bool = False,
) -> Rendered:
    """Render Gaussians; all tensors have one floating type and device, used for all computation.

    position: [N, 3] scene units
    factor: [N, 3, 3] A, with covariance A·Aᵀ
    opacity: [N]
    sh: [N, (degree+1)², 3] harmonics
    shift: [N, 2] pixels, added to the splats' centres; densification needs its gradient
    antialiased: compensate opacities for the blur, as for `spec.scene.Gaussians` with this mark

    As in 3DGS, gradients are zero where alpha or a colour is clamped, and ignore the thresholds at
    which a splat is skipped or a pixel ends.
    """
    if shift is None:
        shift = torch.zeros_like(position[:, :2])
    if position.is_cuda:
        return _render_cuda(position, factor, opacity, sh, camera, shift, antialiased)
    found, parameters = [], (position, factor, opacity, sh, shift)
    image, rest = _Render.apply(*parameters, camera, antialiased, found.append)
    return Rendered(image, rest, found[0])


def _render_cuda(position, factor, opacity, sh, camera, shift, antialiased) -> Rendered:
    """Render by gsplat; the gradient of the splats' centres goes to `shift`, which must be zero.

    Of the convention, gsplat follows only the blur. It clamps alpha at 0.999, cuts splats at 3.33
    standard deviations, and limits the Jacobian differently if the principal point is off centre.
    For the compensation it computes the determinant as a difference in float32, which is inexact
    for needles.
    """
    from gsplat import rasterization

    view = np.eye(4)
    view[:3, :3], view[:3, 3] = camera.rotation, camera.translation
    intrinsics = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
    image, alpha, found = rasterization(
        position, None, None, opacity, sh,
        position.new_tensor(view)[None], position.new_tensor(intrinsics)[None],
        camera.width, camera.height, near_plane=camera.near,
        eps2d=SPLATCORE.covariance_blur, sh_degree=int(np.sqrt(sh.shape[1])) - 1, packed=False,
        covars=factor @ factor.transpose(1, 2),
        rasterize_mode="antialiased" if antialiased else "classic",
    )  # fmt: skip
    if shift.requires_grad and found["means2d"].requires_grad:
        found["means2d"].register_hook(lambda gradient: shift.backward(gradient[0]))
    visible = (found["radii"][0] > 0).all(-1).nonzero()[:, 0]
    return Rendered(image[0], 1 - alpha[0, ..., 0], visible.cpu().numpy())


class _Render(torch.autograd.Function):
    """The numba kernels as a torch operation; `on_visible` is called with the visible indices."""

    @staticmethod
    def forward(context, position, factor, opacity, sh, shift, camera, antialiased, on_visible):
        arrays = [tensor.detach().numpy() for tensor in (position, factor, opacity, sh, shift)]
        drawn = Drawn(arrays, camera, antialiased)
        on_visible(drawn.index)
        context.save_for_backward(position, factor, sh)
        context.drawn = drawn
        image = np.stack([to_image(drawn.colour[:, k], camera) for k in range(3)], axis=2)
        return torch.from_numpy(image), torch.from_numpy(to_image(drawn.state[0], camera))

    @staticmethod
    def backward(context, to_image_, to_rest):
        drawn = context.drawn
        position, factor, sh = (tensor.contiguous().numpy() for tensor in context.saved_tensors)
        planes = [to_tiles(to_image_[..., k].numpy(), drawn.camera) for k in range(3)]
        gradient = drawn.backward(np.stack(planes, axis=1), to_tiles(to_rest.numpy(), drawn.camera))
        shapes = (3,), (3, 3), (), sh.shape[1:], (2,)
        found = [np.zeros((len(position), *shape), position.dtype) for shape in shapes]
        rendering_points.project_backward(
            drawn.index, position, factor, sh, drawn.view, drawn.splats, gradient,
            get_num_threads(), *found,
        )  # fmt: skip
        return *map(torch.from_numpy, found), None, None, None
