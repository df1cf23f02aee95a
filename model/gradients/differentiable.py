"""Differentiable rendering: Gaussians as torch tensors to a picture, with gradients.

On a CUDA device `gsplat` rasterizes; on a CPU the numba kernels beside this file do. Both follow
`spec.convention`, as far as gsplat has a switch for it (see `_render_cuda`).
"""

from dataclasses import dataclass

import numpy as np
import torch
from numba import get_num_threads

from splatcore.model.gradients import rendering_points, rendering_tiles
from splatcore.model.gradients.rendering_points import RED
from splatcore.spec.camera import Camera
from splatcore.spec.convention import SPLATCORE, TILE, Convention


@dataclass(frozen=True, eq=False)
class Rendered:
    """A picture and who is in it."""

    image: torch.Tensor  # [H, W, 3] RGB, not clipped
    transmittance: torch.Tensor  # [H, W]
    visible: np.ndarray  # [M] indices of the visible Gaussians


def render(
    position: torch.Tensor,
    factor: torch.Tensor,
    opacity: torch.Tensor,
    sh: torch.Tensor,
    camera: Camera,
    shift: torch.Tensor | None = None,
    convention: Convention = SPLATCORE,
) -> Rendered:
    """Render Gaussians: position [N, 3], factor [N, 3, 3] (Σ = A·Aᵀ), opacity [N], harmonics
    [N, (degree+1)², 3], all of one floating type and device, in which everything is computed.

    `shift` [N, 2] (pixels) moves the splats' centres; its gradient is that of the centres, which
    densification looks at. Gradients are zero where alpha or a colour is clamped, and do not know
    that a pixel may pass 1/255 or end: as everywhere in 3DGS.
    """
    if shift is None:
        shift = torch.zeros_like(position[:, :2])
    if position.is_cuda:
        image, rest, visible = _render_cuda(
            position, factor, opacity, sh, camera, shift, convention
        )
    else:
        found = []
        image, rest = _Render.apply(
            position, factor, opacity, sh, shift, camera, convention, found.append
        )
        visible = found[0]
    background = image.new_tensor(convention.background)
    return Rendered(image + rest[..., None] * background, rest, visible)


def _render_cuda(position, factor, opacity, sh, camera, shift, convention):
    """gsplat's picture. Of the convention it takes near plane and blur; its alpha is clamped at
    0.999, its splats end at 3.33 standard deviations, and its Jacobian's limits differ for a
    principal point off the centre. Its centres' gradient goes to `shift`, which must be zero."""
    from gsplat import rasterization

    view = np.eye(4)
    view[:3, :3], view[:3, 3] = camera.rotation, camera.translation
    intrinsics = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
    image, alpha, found = rasterization(
        position, None, None, opacity, sh,
        position.new_tensor(view)[None], position.new_tensor(intrinsics)[None],
        camera.width, camera.height, near_plane=convention.near_plane,
        eps2d=convention.covariance_blur, sh_degree=int(np.sqrt(sh.shape[1])) - 1, packed=False,
        covars=factor @ factor.transpose(1, 2),
    )  # fmt: skip
    if shift.requires_grad and found["means2d"].requires_grad:
        found["means2d"].register_hook(lambda gradient: setattr(shift, "grad", gradient[0]))
    visible = (found["radii"][0] > 0).all(-1).nonzero()[:, 0]
    return image[0], 1 - alpha[0, ..., 0], visible.cpu().numpy()


class _Render(torch.autograd.Function):
    """The numba kernels as an operation of torch."""

    @staticmethod
    def forward(context, position, factor, opacity, sh, shift, camera, convention, tell):
        arrays = [tensor.detach().numpy() for tensor in (position, factor, opacity, sh, shift)]
        view = rendering_points.view_numbers(camera, convention)
        splats, index = _project(arrays, view)
        lists = rendering_tiles.tile_lists(splats, camera.width, camera.height)
        limits = limits_of(convention)
        colour, *drawn = rendering_tiles.blend(splats, lists, camera.width, camera.height, limits)
        tell(index)
        context.save_for_backward(position, factor, sh)
        context.kept = camera, view, limits, splats, index, lists, drawn
        image = np.stack([to_image(colour[:, k], camera) for k in range(3)], axis=2)
        return torch.from_numpy(image), torch.from_numpy(to_image(drawn[0], camera))

    @staticmethod
    def backward(context, to_image_, to_rest):
        camera, view, limits, splats, index, lists, drawn = context.kept
        position, factor, sh = (tensor.contiguous().numpy() for tensor in context.saved_tensors)
        to_colour = np.stack(
            [to_tiles(to_image_[..., k].numpy(), camera) for k in range(3)], axis=1
        )
        gradient = rendering_tiles.blend_backward(
            splats, lists, camera.width, camera.height, limits, drawn, to_colour,
            to_tiles(to_rest.numpy(), camera),
        )  # fmt: skip
        count, kind = len(position), position.dtype
        found = [
            np.zeros((count, *shape), kind) for shape in ((3,), (3, 3), (), sh.shape[1:], (2,))
        ]
        rendering_points.project_backward(
            index, position, factor, sh, view, splats, gradient, get_num_threads(), *found
        )
        return *map(torch.from_numpy, found), None, None, None


def limits_of(convention: Convention) -> np.ndarray:
    """What the kernels of the tiles know of a convention."""
    return np.array([convention.alpha_min, convention.alpha_max, convention.transmittance_min])


def _project(arrays, view) -> tuple[np.ndarray, np.ndarray]:
    """The visible splats in depth order and their Gaussians' indices."""
    arrays = [np.ascontiguousarray(array) for array in arrays]  # else each layout is compiled
    position = arrays[0]
    splats = np.empty((len(position), 12), position.dtype)
    depth = np.empty(len(position), np.float64)
    rendering_points.project(*arrays, view, get_num_threads(), splats, depth)
    index = np.flatnonzero(depth)
    index = index[np.argsort(depth[index], kind="stable")]
    return splats[index], index


def to_image(tiles: np.ndarray, camera: Camera) -> np.ndarray:
    """[tiles, 16, 16] to [H, W]."""
    rows, columns = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = tiles.reshape(rows, columns, TILE, TILE).swapaxes(1, 2)
    return whole.reshape(rows * TILE, columns * TILE)[: camera.height, : camera.width].copy()


def to_tiles(image: np.ndarray, camera: Camera) -> np.ndarray:
    """[H, W] to [tiles, 16, 16], with zeros beyond the image."""
    rows, columns = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = np.zeros((rows * TILE, columns * TILE), image.dtype)
    whole[: camera.height, : camera.width] = image
    tiles = whole.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
    return tiles.reshape(-1, TILE, TILE).copy()


def blending_weights(position, factor, opacity, sh, camera, convention=SPLATCORE):
    """What each Gaussian contributes to a view [N]: Σ over the pixels of alpha·T.

    It is the gradient of the sum of a picture in which every splat is
    white by its colour.
    """
    arrays = [np.asarray(a) for a in (position, factor, opacity, sh)]
    arrays.append(np.zeros((len(position), 2), arrays[0].dtype))
    view, limits = rendering_points.view_numbers(camera, convention), limits_of(convention)
    splats, index = _project(arrays, view)
    lists = rendering_tiles.tile_lists(splats, camera.width, camera.height)
    colour, *drawn = rendering_tiles.blend(splats, lists, camera.width, camera.height, limits)
    to_colour = np.zeros_like(colour)
    to_colour[:, 0] = 1
    gradient = rendering_tiles.blend_backward(
        splats, lists, camera.width, camera.height, limits, drawn, to_colour,
        np.zeros_like(drawn[0]),
    )  # fmt: skip
    weight = np.zeros(len(position))
    weight[index] = gradient[:, RED]
    return weight
