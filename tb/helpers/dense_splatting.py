"""3D Gaussian Splatting in its simplest form: every Gaussian at every pixel, gradients by torch.

A slow oracle for the fast renderers, without tiles, boxes, lists, kernels or our own gradients: the
formulas of Kerbl et al. 2023 with the constants of their CUDA rasterizer, in float64.
"""

from dataclasses import dataclass

import numpy as np
import torch

from splatcore.spec.camera import Camera
from splatcore.spec.convention import SPLATCORE

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792,
      0.5462742152960396)  # fmt: skip
C3 = (-0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154,
      -0.4570457994644658, 1.445305721320277, -0.5900435899266435)  # fmt: skip

PARAMETERS = ("position", "factor", "opacity", "sh", "shift")


@dataclass(frozen=True, eq=False)
class Dense:
    """A picture of the dense renderer, and its distance from the thresholds."""

    image: torch.Tensor  # [H, W, 3]
    transmittance: torch.Tensor  # [H, W]
    weight: torch.Tensor  # [N] Σ alpha·T over the pixels
    clamped: dict[str, int]  # number of values clamped, skipped or ended, by kind
    margin: float  # smallest relative distance of a value from its threshold


class Decisions:
    """Comparisons with thresholds; counts their outcomes and keeps the smallest distance."""

    def __init__(self):
        self.counts: dict[str, int] = {}
        self.margin = float("inf")

    def below(self, name: str, value: torch.Tensor, threshold: float, where=True) -> torch.Tensor:
        """value < threshold. where: mask of the values that count."""
        with torch.no_grad():
            below = value < threshold
            matters = torch.as_tensor(where).expand(value.shape)
            self.counts[name] = self.counts.get(name, 0) + int((below & matters).sum())
            if matters.any():
                distance = (value[matters] - threshold).abs().min() / (abs(threshold) or 1.0)
                self.margin = min(self.margin, float(distance))
        return below


def dense_render(
    position, factor, opacity, sh, camera: Camera, shift=None, antialiased: bool = False
) -> Dense:
    """The interface of `model.gradients.differentiable.render`, for float64 tensors."""
    decisions = Decisions()
    turn, move = torch.tensor(camera.rotation), torch.tensor(camera.translation)
    point = position @ turn.T + move
    colour = colours(position - torch.tensor(camera.position), sh, decisions)
    y, x = (torch.tensor(a, dtype=torch.float64) for a in np.mgrid[: camera.height, : camera.width])
    image = torch.zeros(camera.height, camera.width, 3, dtype=torch.float64)
    rest, live = torch.ones_like(x), torch.ones_like(x, dtype=torch.bool)
    weights = [torch.zeros((), dtype=torch.float64)] * len(position)
    for n in np.argsort(point[:, 2].detach().numpy(), kind="stable"):
        if decisions.below("near", point[n, 2], camera.near * (1 + 1e-15)):
            continue
        u, v = centre(point[n], camera)
        if shift is not None:
            u, v = u + shift[n, 0], v + shift[n, 1]
        half = on_screen(point[n], factor[n], camera, decisions)
        blur = SPLATCORE.covariance_blur * torch.eye(2, dtype=torch.float64)
        conic = torch.linalg.inv(half @ half.T + blur)
        offset = torch.stack([x - u, y - v], dim=-1)  # [H, W, 2]
        strength = opacity[n] * (compensation(half) if antialiased else 1)
        free = strength * torch.exp(-0.5 * ((offset @ conic) * offset).sum(-1))
        opaque = ~decisions.below("not opaque", free, SPLATCORE.alpha_max, live)
        decisions.counts["opaque"] = decisions.counts.get("opaque", 0) + int((opaque & live).sum())
        alpha = torch.where(opaque, torch.full_like(free, SPLATCORE.alpha_max), free)
        meets = live & ~decisions.below("faint", alpha, SPLATCORE.alpha_min, live)
        following = rest * (1 - alpha)
        ends = decisions.below("ended", following, SPLATCORE.transmittance_min, meets) & meets
        live, blends = live & ~ends, meets & ~ends
        weight = torch.where(blends, rest * alpha, torch.zeros_like(rest))
        image = image + weight[..., None] * colour[n]
        rest = torch.where(blends, following, rest)
        weights[n] = weight.sum()
    weight = torch.stack(weights) if weights else opacity.clone()
    return Dense(image, rest, weight, decisions.counts, decisions.margin)


def centre(point, camera):
    """Pixel coordinates of a point [3] in camera space."""
    away = SPLATCORE.principal_point_shift + SPLATCORE.pixel_centre
    u = camera.fx * point[0] / point[2] + camera.cx - away
    return u, camera.fy * point[1] / point[2] + camera.cy - away


def compensation(half) -> torch.Tensor:
    """√(det Σ / det(Σ + blur)) of Σ = half·halfᵀ, for half [2, 3].

    Computed from the eigenvalues of Σ (squares of the singular values of `half`), so that no
    digits cancel.
    """
    axes = torch.linalg.svdvals(half)
    return (axes / (axes**2 + SPLATCORE.covariance_blur).sqrt()).prod()


def on_screen(point, factor, camera, decisions) -> torch.Tensor:
    """J·R·factor [2, 3] in pixels, a factor of the splat's covariance."""
    rows = []
    for axis, focal in ((0, camera.fx), (1, camera.fy)):
        side = (camera.width, camera.height)[axis]
        limit = SPLATCORE.frustum_margin * side / (2 * focal)
        slope = point[axis] / point[2]
        if not decisions.below("within", slope.abs(), limit):
            slope = torch.sign(slope.detach()) * limit
            decisions.counts["slanted"] = decisions.counts.get("slanted", 0) + 1
        row = [torch.zeros((), dtype=torch.float64)] * 2 + [-focal * slope / point[2]]
        row[axis] = focal / point[2]
        rows.append(torch.stack(row))
    return torch.stack(rows) @ torch.tensor(camera.rotation) @ factor


def colours(ray, sh, decisions) -> torch.Tensor:
    """RGB [N, 3] ≥ 0 along rays [N, 3] from the camera."""
    x, y, z = (ray / ray.norm(dim=1, keepdim=True)).T[..., None]
    colour = SPLATCORE.colour_offset + C0 * sh[:, 0]
    if sh.shape[1] > 1:
        colour = colour - C1 * y * sh[:, 1] + C1 * z * sh[:, 2] - C1 * x * sh[:, 3]
    if sh.shape[1] > 4:
        forms = (x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y)
        colour = colour + sum(C2[k] * form * sh[:, 4 + k] for k, form in enumerate(forms))
    if sh.shape[1] > 9:
        forms = (
            y * (3 * x * x - y * y), x * y * z, y * (4 * z * z - x * x - y * y),
            z * (2 * z * z - 3 * x * x - 3 * y * y), x * (4 * z * z - x * x - y * y),
            z * (x * x - y * y), x * (x * x - 3 * y * y),
        )  # fmt: skip
        colour = colour + sum(C3[k] * form * sh[:, 9 + k] for k, form in enumerate(forms))
    dark = decisions.below("dark", colour, 0.0)
    return torch.where(dark, torch.zeros_like(colour), colour)
