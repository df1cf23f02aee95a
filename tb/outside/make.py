"""Render the scenes with gsplat's CPU path, in float64, and store the results.

Run `python -m tb.outside.make` with the extra `[outside]`, which installs torch.

gsplat's torch path needs a CUDA kernel, which lists the Gaussians that touch each pixel, and the
package nerfacc, which multiplies and sums along the lists. The three stand-ins below replace them
and are the only code of ours: means, covariances, conics, compensations, depths, colours, tile
lists and all alphas and colours that are blended are gsplat's arithmetic.
"""

import sys
from types import ModuleType

import gsplat
import numpy as np
import torch
from gsplat.cuda import _torch_impl as impl
from gsplat.cuda import _wrapper

from splatcore.spec.convention import TILE
from tb.outside.scenes import CASES
from tb.outside.stored import VERSIONS, Case, Stored, save

MARGIN = 1e-9
"""Minimum relative distance of all values from their thresholds, so that rounding in float64
changes no decision."""

Tensor = torch.Tensor


def indices_in_range(
    start: int,
    end: int,  # blocks of 256 Gaussians per tile's list: all, as the lists are short
    transmittances: Tensor,  # [1, H, W]
    means: Tensor,  # [1, N, 2]
    conics: Tensor,  # [1, N, 3]
    opacities: Tensor,  # [1, N]
    width: int,
    height: int,
    tile: int,
    offsets: Tensor,  # [1, rows, columns] begin of each tile's list
    ids: Tensor,  # [M] the tiles' lists, one after the other
) -> tuple[Tensor, Tensor, Tensor]:
    """Stand-in for gsplat's kernel: the pairs that are blended, by pixel, then by depth.

    Follows `rasterize_to_indices_3dgs_kernel`: skips alphas below 1/255; a pixel ends before the
    Gaussian that would bring its transmittance to 1e-4 or below.
    """
    assert start == 0 and bool((transmittances == 1).all()), "one pass expected"
    bounds = [*offsets.flatten().tolist(), len(ids)]
    assert max(np.diff(bounds)) <= end * tile * tile, "one pass expected"
    gaussians, pixels = [], []
    for index in range(len(bounds) - 1):
        row, column = divmod(index, offsets.shape[-1])
        y = torch.arange(row * tile, min((row + 1) * tile, height))
        x = torch.arange(column * tile, min((column + 1) * tile, width))
        pixel = (y[:, None] * width + x).flatten()  # [P]
        listed = ids[bounds[index] : bounds[index + 1]].long()  # [L] near to far
        centre = torch.stack([pixel % width, pixel // width], dim=-1) + 0.5  # [P, 2]
        dx, dy = (means[0, listed] - centre[:, None]).unbind(-1)  # [P, L]
        a, b, c = conics[0, listed].unbind(-1)  # [L]
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = torch.clamp_max(opacities[0, listed] * torch.exp(-sigma), 0.999)
        seen = (sigma >= 0) & (alpha >= 1 / 255)
        following = torch.cumprod(torch.where(seen, 1 - alpha, 1.0), dim=1)
        alive = following > 1e-4  # monotonic along the list, so the first failure ends the pixel
        keep_away(alpha, 1 / 255)
        keep_away(following, 1e-4)
        at, which = torch.nonzero(seen & alive, as_tuple=True)
        pixels.append(pixel[at])
        gaussians.append(listed[which])
    pixels, gaussians = torch.cat(pixels), torch.cat(gaussians)
    order = torch.argsort(pixels, stable=True)
    return gaussians[order], pixels[order], torch.zeros_like(order)


def weight_from_alpha(alphas: Tensor, ray_indices: Tensor, n_rays: int) -> tuple[Tensor, Tensor]:
    """Stand-in for nerfacc: weights [M], and transmittances [M] before each sample.

    alphas: [M] ordered by `ray_indices` [M], then from near to far
    """
    count = torch.bincount(ray_indices, minlength=n_rays)
    first = torch.cumsum(count, dim=0) - count
    rank = torch.arange(len(alphas)) - first[ray_indices]
    table = torch.ones(n_rays, int(count.max()) + 1)
    table[ray_indices, rank + 1] = 1 - alphas
    before = torch.cumprod(table, dim=1)[ray_indices, rank]
    return before * alphas, before


def accumulate(weights: Tensor, values: Tensor | None, ray_indices: Tensor, n_rays: int) -> Tensor:
    """Stand-in for nerfacc: Σ weight·value per ray [n_rays, channels]; values are 1 by default."""
    terms = weights[:, None] * (1.0 if values is None else values)
    return torch.zeros(n_rays, terms.shape[1]).index_add_(0, ray_indices, terms)


def keep_away(value: Tensor, threshold: float):
    """Raise AssertionError if a value is closer to a threshold than `MARGIN`."""
    if value.numel():
        nearest = float((value / threshold - 1).abs().min())
        assert nearest > MARGIN, f"a value is {nearest:.1e} from {threshold:.6g}: use another seed"


def install():
    """Install the stand-ins for gsplat, and set torch to float64."""
    torch.set_default_dtype(torch.float64)
    nerfacc = ModuleType("nerfacc")
    nerfacc.render_weight_from_alpha = weight_from_alpha
    nerfacc.accumulate_along_rays = accumulate
    sys.modules["nerfacc"] = nerfacc
    _wrapper.rasterize_to_indices_in_range = indices_in_range


def colours(case: Case, means: Tensor, view: Tensor) -> Tensor:
    """Colours [1, N, 3], calculated as in `gsplat.rendering.rasterization`."""
    coefficients = torch.from_numpy(case.scene.sh)
    directions = means - torch.inverse(view)[:3, 3]
    values = impl._spherical_harmonics(case.scene.sh_degree, directions, coefficients)
    return torch.clamp_min(values + 0.5, 0.0)[None]


def render(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """gsplat's image [H, W, 3] and final transmittance [H, W], float64."""
    scene, camera = case.scene, case.camera
    means = torch.from_numpy(scene.position)
    view = torch.eye(4)
    view[:3, :3], view[:3, 3] = map(torch.from_numpy, (camera.rotation, camera.translation))
    matrix = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    covariances, _ = impl._quat_scale_to_covar_preci(
        torch.from_numpy(scene.quaternion), torch.from_numpy(scene.scale), compute_preci=False
    )
    size = camera.width, camera.height
    radii, means2d, depths, conics, compensations = impl._fully_fused_projection(
        means, covariances, view[None], matrix[None], *size, near_plane=camera.near,
        calc_compensations=scene.antialiased,
    )  # fmt: skip
    opacities = torch.from_numpy(scene.opacity)[None]
    if compensations is not None:  # as in `gsplat.rendering.rasterization`
        opacities = opacities * compensations
    keep_away(depths, camera.near)
    # gsplat sorts by depth in float32: without ties this is the order in float64.
    kept = depths[(radii > 0).all(dim=-1)].to(torch.float32)
    assert len(torch.unique(kept)) == len(kept), "equal depths: use another seed"
    columns, rows = (-(-side // TILE) for side in size)
    _, keys, ids = impl._isect_tiles(means2d, radii, depths, TILE, columns, rows)
    image, alpha = impl._rasterize_to_pixels(
        means2d,
        conics,
        colours(case, means, view),
        opacities,
        *size,
        TILE,
        impl._isect_offset_encode(keys, 1, columns, rows),
        ids,
        backgrounds=torch.tensor([case.background]),
    )
    return image[0].numpy(), 1 - alpha[0, ..., 0].numpy()


def main():
    versions = {"torch": torch.__version__.split("+")[0], "gsplat": gsplat.__version__}
    assert versions == VERSIONS, f"versions {versions}, but {VERSIONS} are required"
    install()
    for name, make in CASES.items():
        case = make()
        assert case.scene.name == name
        path = save(Stored(case, *render(case), versions))
        print(f"{path.name}: {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
