"""The float64 reference renderer: 3D Gaussian Splatting by its formulas, without number formats.

Everything else in this project is measured against it. From scene to image: `project` Gaussians to
splats, bin splats to tiles (`tile_lists`, depth-ordered), blend them (`rasterize`), count.
Source of the formulas: Kerbl et al. 2023 (3DGS) and Zwicker et al. 2001 (EWA splatting).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcore.golden.batches import in_batches
from splatcore.golden.reference_tiles import WORK, TileLists, bin_splats, count_rows, rasterize
from splatcore.spec.camera import Camera
from splatcore.spec.convention import SIGMA_EXTENT, SPLATCORE, TILE, Convention
from splatcore.spec.decoded import Decoded
from splatcore.spec.packed import Drawn
from splatcore.spec.scene import Gaussians

C0 = np.sqrt(1 / (4 * np.pi))
C1 = np.sqrt(3 / (4 * np.pi))
C2 = np.sqrt(np.array([15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi))
C3 = np.sqrt(np.array([35 / 8, 105, 21 / 8, 7 / 4, 21 / 8, 105 / 4, 35 / 8]) / (4 * np.pi))
"""Constants of the harmonics of degree 0 … 3."""

COUNTS = ("gaussians", "not_finite", "near_culled", "pairs_3sigma", "visible")
"""Counts of `project`."""

Progress = Callable[[int, int], None]  # called with (tiles done, tiles in all)


@dataclass(frozen=True, eq=False)
class Splats:
    """Gaussians projected to the image, in pixels, sorted by depth (ties by storage order)."""

    index: np.ndarray  # [M] each splat's Gaussian
    centre: np.ndarray  # [M, 2] u, v; the centre of pixel (x, y) is at u = x, v = y
    depth: np.ndarray  # [M] camera z, scene units
    covariance: np.ndarray  # [M, 3] xx, xy, yy with the blur added, square pixels
    conic: np.ndarray  # [M, 3] inverse covariance A, B, C: Q = A·dx² + 2·B·dx·dy + C·dy²
    opacity: np.ndarray  # [M] compensated for the blur if the Gaussians are `antialiased`
    reach: np.ndarray  # [M] largest Q at which alpha ≥ alpha_min: 2·ln(opacity / alpha_min)
    colour: np.ndarray  # [M, 3] RGB ≥ 0

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, keep) -> "Splats":
        return Splats(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    @cached_property
    def extent(self) -> np.ndarray:
        """Half-widths [M, 2] of the box around the pixels with alpha ≥ alpha_min."""
        return np.sqrt(np.maximum(self.reach, 0)[:, None] * self.covariance[:, [0, 2]])

    @property
    def radius(self) -> np.ndarray:
        """Half-width [M] of the original renderer's square: ⌈3·√λmax⌉."""
        xx, xy, yy = self.covariance.T
        largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
        return np.ceil(SIGMA_EXTENT * np.sqrt(largest))


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered frame."""

    # [H, W, 3] linear RGB, not clipped; [H, W, 4] with alpha, the colour premultiplied
    image: np.ndarray
    transmittance: np.ndarray  # [H, W] weight of the background
    tile_list: np.ndarray  # [⌈H/16⌉, ⌈W/16⌉] splats in each tile's list
    counts: dict[str, int | float]  # amounts of work by name, see `docs/json.md`

    @property
    def pixels(self) -> np.ndarray:
        """The 8-bit `image`: clipped to [0, 1], rounded to nearest."""
        return np.rint(np.clip(self.image, 0, 1) * 255).astype(np.uint8)


def render(
    gaussians: Drawn,
    camera: Camera,
    convention: Convention = SPLATCORE,
    progress: Progress | None = None,
    rgba: bool = False,
) -> Frame:
    """Render one frame; Gaussians that hold NaN or Inf are left out and counted.

    gaussians: world space, scene units
    camera: the view
    convention: the renderer's choices
    progress: called with the number of tiles done and of all tiles
    rgba: with alpha = 1 − T, and without background
    Returns the image in linear RGB or RGBA, float64.
    """
    splats, counts = project(gaussians, camera, convention)
    lists = tile_lists(splats, camera, convention)
    found = rasterize(lists, splats, camera.width, camera.height, convention, progress)
    work = {name: int(found.work[name].sum()) for name in WORK.names}
    lengths = np.diff(lists.start)
    counts |= {
        "pairs": int(lengths.sum()),
        "pairs_after_termination": work["pairs"],
        "blocks": work["blocks"],
        "contributions": work["contributions"],
        "tile_rows": count_rows(splats.centre, splats.extent, camera.width, camera.height),
        "tile_list_mean": float(lengths.mean()),
        "tile_list_p99": float(np.percentile(lengths, 99)),
        "tile_list_max": int(lengths.max()),
        "pixels_ended": work["ended"],
    }
    image, through = found.image, found.transmittance
    if rgba:
        image = np.concatenate([image, 1 - through[..., None]], axis=2)
    else:
        image += through[..., None] * np.asarray(convention.background, np.float64)
    return Frame(image, through, lengths.reshape(tile_grid(camera)), counts)


def tile_grid(camera: Camera) -> tuple[int, int]:
    """Return the rows and columns of tiles that cover the image."""
    return -(-camera.height // TILE), -(-camera.width // TILE)


def project(
    gaussians: Drawn, camera: Camera, convention: Convention = SPLATCORE
) -> tuple[Splats, dict[str, int | float]]:
    """Project Gaussians into splats, batch by batch.

    gaussians: world space, scene units
    camera: the view
    convention: the renderer's choices
    Returns the visible splats in depth order, and the numbers of Gaussians dropped at each step.
    """

    def work(batch: slice) -> tuple[Splats, np.ndarray]:
        with np.errstate(all="ignore"):  # NaN, and overflows, which are counted as not finite
            splats, counts = _visible(gaussians.decoded(batch), camera, convention)
        splats.index[:] += batch.start
        return splats, counts

    found, counts = zip(*in_batches(work, len(gaussians)), strict=True)
    counts = dict(zip(COUNTS, np.sum(counts, axis=0).tolist(), strict=True))
    parts = {name: [getattr(part, name) for part in found] for name in Splats.__dataclass_fields__}
    del found
    order = np.argsort(np.concatenate(parts["depth"]), kind="stable")
    # A field's parts are gone before those of the next one are joined.
    return Splats(*(np.concatenate(parts.pop(name)).take(order, 0) for name in [*parts])), counts


def _visible(
    some: Gaussians | Decoded, camera: Camera, convention: Convention
) -> tuple[Splats, list[int]]:
    """Return the visible splats of some Gaussians, in their order, and `COUNTS`."""
    finite = some.finite
    point = some.position @ camera.rotation.T + camera.translation  # [N, 3]
    index = np.flatnonzero(finite & (point[:, 2] > camera.near))
    dropped = [len(some) - finite.sum(), finite.sum() - len(index)]
    point, front = point[index], some[index]
    depth = point[:, 2]
    centre = point[:, :2] / depth[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    centre -= convention.principal_point_shift + convention.pixel_centre
    covariance, conic, compensation = covariance_and_conic(front.factor, point, camera, convention)
    opacity = front.opacity
    if some.antialiased:
        opacity = opacity * compensation
    # Of 0, the compensated opacity of splats without area, it is −inf.
    reach = 2 * np.log(np.maximum(opacity, 0) / convention.alpha_min)
    splats = Splats(index, centre, depth, covariance, conic, opacity, reach, np.zeros_like(point))
    sound = np.isfinite(centre).all(1) & np.isfinite(conic).all(1)
    dropped[0] += len(splats) - sound.sum()
    squares = np.where(sound, areas(square_boxes(splats, camera)), 0)
    if convention.footprint == "exact":
        seen = sound & (opacity >= convention.alpha_min)
        seen &= areas(pixel_boxes(splats, camera)) > 0
    else:
        seen = squares > 0
    splats = splats[np.flatnonzero(seen)]
    splats.colour[:] = colours(some, splats.index, camera, convention)
    return splats, [len(some), *dropped, squares.sum(), len(splats)]


def covariance_and_conic(
    factor: np.ndarray, point: np.ndarray, camera: Camera, convention: Convention
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return 2D covariances, their inverses, and the compensation for the blur.

    factor: [N, 3, 3] world space, scene units
    point: [N, 3] camera coordinates, scene units
    Returns covariance [N, 3] (xx, xy, yy), conic [N, 3] (A, B, C) and compensation [N]:
    √(det(M·Mᵀ) / det(M·Mᵀ + blur·I)), by which `antialiased` opacities are multiplied.

    With M = J·R·factor (2×3, J the Jacobian of the projection, R the camera's rotation) the
    covariance is M·Mᵀ + blur·I. Its determinant is computed as |m₀ × m₁|² + blur·(|m₀|² + |m₁|²) +
    blur² (Lagrange's identity), a sum of squares: needles lose no digits to cancellation. The
    first term is det(M·Mᵀ). Source of the compensation: Yu et al. 2024 (Mip-Splatting).
    """
    limit = convention.frustum_margin * np.array(camera.tan_half_fov)
    z = point[:, 2:]
    slope = np.clip(point[:, :2] / z, -limit, limit)  # [N, 2] X/Z, Y/Z
    focal = np.array([camera.fx, camera.fy])
    jacobian = np.zeros((len(point), 2, 3))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = (focal / z).T
    jacobian[:, :, 2] = -focal * slope / z
    m0, m1 = np.moveaxis(jacobian @ camera.rotation @ factor, 1, 0)  # [N, 3] each
    blur = convention.covariance_blur
    xx, xy, yy = (m0 * m0).sum(1), (m0 * m1).sum(1), (m1 * m1).sum(1)
    sharp, added = (np.cross(m0, m1) ** 2).sum(1), blur * (xx + yy) + blur**2
    determinant = sharp + added
    compensation = np.sqrt(1 / (1 + added / sharp))  # 0 for no area, 1 where squares overflow
    xx, yy = xx + blur, yy + blur
    covariance = np.stack([xx, xy, yy], axis=1)
    conic = np.stack([yy, -xy, xx], axis=1) / determinant[:, None]
    return covariance, conic, compensation


def colours(
    gaussians: Drawn, index: np.ndarray, camera: Camera, convention: Convention
) -> np.ndarray:
    """Return the RGB colours [M, 3] ≥ 0 of Gaussians `index` [M], seen from the camera."""
    some = gaussians.decoded(index)
    sh = some.sh.astype(np.float64, copy=False)  # [M, (degree+1)², 3]
    ray = some.position - camera.position
    ray /= np.abs(ray).max(axis=1, keepdims=True)  # the square of a large one would overflow
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    basis = harmonics(ray, int(np.sqrt(sh.shape[1])) - 1)
    return np.maximum(np.einsum("nk,nkc->nc", basis, sh) + convention.colour_offset, 0)


def harmonics(direction: np.ndarray, degree: int) -> np.ndarray:
    """Return the real spherical harmonics [N, (degree+1)²], in the order and with the signs of
    3DGS.

    direction: [N, 3] unit vectors from the camera, world axes
    degree: 0 … 3
    Source: Sloan, "Stupid Spherical Harmonics Tricks" (2008), appendix A2 (Condon–Shortley phase).
    """
    x, y, z = direction.T
    xx, yy, zz = x * x, y * y, z * z
    terms = [np.full_like(x, C0)]
    if degree >= 1:
        terms += [-C1 * y, C1 * z, -C1 * x]
    if degree >= 2:
        terms += [C2[0] * x * y, -C2[1] * y * z, C2[2] * (2 * zz - xx - yy)]
        terms += [-C2[3] * x * z, C2[4] * (xx - yy)]
    if degree >= 3:
        terms += [-C3[0] * y * (3 * xx - yy), C3[1] * x * y * z, -C3[2] * y * (4 * zz - xx - yy)]
        terms += [C3[3] * z * (2 * zz - 3 * xx - 3 * yy), -C3[4] * x * (4 * zz - xx - yy)]
        terms += [C3[5] * z * (xx - yy), -C3[6] * x * (xx - 3 * yy)]
    return np.stack(terms, axis=1)


def pixel_boxes(splats: Splats, camera: Camera) -> np.ndarray:
    """Return inclusive pixel ranges [M, 4] x0, x1, y0, y1 of the exact footprints' boxes."""
    low = np.ceil(splats.centre - splats.extent)
    high = np.floor(splats.centre + splats.extent)
    return clip_boxes(low, high, (camera.width - 1, camera.height - 1))


def square_boxes(splats: Splats, camera: Camera) -> np.ndarray:
    """Return inclusive tile ranges [M, 4] of the original renderer's 3σ squares (`getRect`)."""
    rows, columns = tile_grid(camera)
    radius = splats.radius[:, None]
    low = np.trunc((splats.centre - radius) / TILE)
    high = np.trunc((splats.centre + radius + TILE - 1) / TILE) - 1
    return clip_boxes(low, high, (columns - 1, rows - 1))


def clip_boxes(low: np.ndarray, high: np.ndarray, last: tuple[int, int]) -> np.ndarray:
    """Return inclusive ranges [M, 4] x0, x1, y0, y1 cut to 0 … last; empty ones have x1 < x0."""
    low = np.clip(low, 0, np.add(last, 1)).astype(np.int32)
    high = np.clip(high, -1, last).astype(np.int32)
    return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)


def areas(boxes: np.ndarray) -> np.ndarray:
    """Return the number of cells in inclusive ranges [M, 4]; 0 for an empty one."""
    sides = np.maximum(boxes[:, [1, 3]] - boxes[:, [0, 2]] + 1, 0)
    return sides[:, 0].astype(np.int64) * sides[:, 1]


def tile_lists(splats: Splats, camera: Camera, convention: Convention) -> TileLists:
    """Return each tile's list of the splats whose footprint touches it; splats in depth order."""
    exact, size = convention.footprint == "exact", (camera.width, camera.height)
    boxes = pixel_boxes(splats, camera) // TILE if exact else square_boxes(splats, camera)
    return bin_splats(splats, boxes, *size, exact)
