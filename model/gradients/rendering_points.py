"""Projection of Gaussians to splats for optimisation, and its gradients, compiled by numba.

Follows `spec.convention`; the gradients are the chain rule applied to the reference renderer's
formulas. With p = R·x + t, slopes s = p.xy / p.z, the Jacobian J and M = J·R·A (2×3) of a factor A,
the splat's covariance is Σ = M·Mᵀ + blur and its conic K = Σ⁻¹, so dΣ = −K·dK·K, dM = 2·dΣ·M,
dA = (J·R)ᵀ·dM. Opacities of antialiased scenes are multiplied by √(D / E) with
D = det(M·Mᵀ) = |m₀ × m₁|² and E = det Σ. Parallel over Gaussians, one thread for each.
"""

import numpy as np
from numba import njit, prange

from splatcore.spec.camera import Camera
from splatcore.spec.colour import SH_C0, SH_C1
from splatcore.spec.convention import SPLATCORE

C2 = np.sqrt(np.array([15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi))
C3 = np.sqrt(np.array([35 / 8, 105, 21 / 8, 7 / 4, 21 / 8, 105 / 4, 35 / 8]) / (4 * np.pi))
"""Constants of the harmonics of degrees 2 and 3 (Sloan 2008, appendix A2)."""

U, V, A, B, C, OPACITY, RED, GREEN, BLUE, REACH, WIDE, HIGH = range(12)
"""Columns of a splat: centre (pixels), conic (1/pixel²), opacity, colour, the largest quadratic
form with alpha ≥ alpha_min, and the half sides (pixels) of the box around it."""

FARTHEST = 1e18
"""Limit on a splat's centre and the sides of its box, in pixels: as integers they fit in int64."""

GRADIENTS = 9  # columns with gradients: the first ones, on which the picture depends smoothly


def view_numbers(camera: Camera, antialiased: bool = False) -> np.ndarray:
    """Camera and convention as the vector [28] that the kernels read as `view`: R, t, centre,
    intrinsics, limits, and whether opacities are compensated for the blur."""
    limit = SPLATCORE.frustum_margin * np.array(camera.tan_half_fov)
    shift = SPLATCORE.principal_point_shift + SPLATCORE.pixel_centre
    return np.concatenate([
        camera.rotation.reshape(-1), camera.translation, camera.position,
        (camera.fx, camera.fy, camera.cx - shift, camera.cy - shift), limit,
        (camera.near, SPLATCORE.covariance_blur, SPLATCORE.alpha_min,
         SPLATCORE.colour_offset, camera.width, camera.height, antialiased),
    ])  # fmt: skip


@njit(cache=True)
def _projected(position, factor, view, point, slope, rows, m):
    """Compute camera coordinates `point` [3], clamped `slope` [2], J·R in `rows` [2, 3] and M in
    `m` [2, 3]; return True if the Gaussian is beyond the near plane."""
    for i in range(3):
        point[i] = view[9 + i]
        for j in range(3):
            point[i] += view[3 * i + j] * position[j]
    z = point[2]
    if not z > view[21]:
        return False
    for i in range(2):
        focal, limit = view[15 + i], view[19 + i]
        slope[i] = min(max(point[i] / z, -limit), limit)
        for j in range(3):
            rows[i, j] = focal / z * (view[3 * i + j] - slope[i] * view[6 + j])
    for i in range(2):
        for j in range(3):
            m[i, j] = 0.0
            for k in range(3):
                m[i, j] += rows[i, k] * factor[k, j]
    return True


@njit(cache=True)
def _cross(m):
    """The 2×2 minors of M, m₀ × m₁."""
    return (
        m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1],
        m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2],
        m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0],
    )


@njit(cache=True)
def _conic(m, view, sigma, conic):
    """Compute Σ = M·Mᵀ + blur in `sigma` (xx, xy, yy) and its inverse in `conic` (A, B, C); return
    the factor that compensates the opacity for the blur, 1 without antialiasing.

    The determinant is a sum of squares (Lagrange's identity), so needles keep their precision.
    """
    blur = view[22]
    xx = m[0, 0] ** 2 + m[0, 1] ** 2 + m[0, 2] ** 2
    yy = m[1, 0] ** 2 + m[1, 1] ** 2 + m[1, 2] ** 2
    xy = m[0, 0] * m[1, 0] + m[0, 1] * m[1, 1] + m[0, 2] * m[1, 2]
    x, y, z = _cross(m)
    sharp = x * x + y * y + z * z
    determinant = sharp + blur * (xx + yy) + blur * blur
    sigma[0], sigma[1], sigma[2] = xx + blur, xy, yy + blur
    conic[0], conic[1], conic[2] = (
        sigma[2] / determinant, -xy / determinant, sigma[0] / determinant
    )  # fmt: skip
    return np.sqrt(sharp / determinant) if view[27] else 1.0


@njit(cache=True)
def basis_of(x, y, z, count, basis):
    """Compute the first `count` harmonics in direction (x, y, z) in `basis`."""
    basis[0] = SH_C0
    if count > 1:
        basis[1], basis[2], basis[3] = -SH_C1 * y, SH_C1 * z, -SH_C1 * x
    if count > 4:
        xx, yy, zz = x * x, y * y, z * z
        basis[4], basis[5] = C2[0] * x * y, -C2[1] * y * z
        basis[6], basis[7] = C2[2] * (2 * zz - xx - yy), -C2[3] * x * z
        basis[8] = C2[4] * (xx - yy)
        if count > 9:
            basis[9], basis[10] = -C3[0] * y * (3 * xx - yy), C3[1] * x * y * z
            basis[11] = -C3[2] * y * (4 * zz - xx - yy)
            basis[12] = C3[3] * z * (2 * zz - 3 * xx - 3 * yy)
            basis[13] = -C3[4] * x * (4 * zz - xx - yy)
            basis[14], basis[15] = C3[5] * z * (xx - yy), -C3[6] * x * (xx - 3 * yy)


@njit(cache=True)
def basis_gradient(x, y, z, count, slope):
    """Compute the derivatives of the harmonics along x, y, z in `slope` [count, 3]."""
    slope[:count] = 0.0
    if count > 1:
        slope[1, 1], slope[2, 2], slope[3, 0] = -SH_C1, SH_C1, -SH_C1
    if count > 4:
        slope[4, 0], slope[4, 1] = C2[0] * y, C2[0] * x
        slope[5, 1], slope[5, 2] = -C2[1] * z, -C2[1] * y
        slope[6, 0], slope[6, 1], slope[6, 2] = -2 * C2[2] * x, -2 * C2[2] * y, 4 * C2[2] * z
        slope[7, 0], slope[7, 2] = -C2[3] * z, -C2[3] * x
        slope[8, 0], slope[8, 1] = 2 * C2[4] * x, -2 * C2[4] * y
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        slope[9, 0], slope[9, 1] = -6 * C3[0] * x * y, -3 * C3[0] * (xx - yy)
        slope[10, 0], slope[10, 1], slope[10, 2] = C3[1] * y * z, C3[1] * x * z, C3[1] * x * y
        slope[11, 0], slope[11, 1] = 2 * C3[2] * x * y, -C3[2] * (4 * zz - xx - 3 * yy)
        slope[11, 2] = -8 * C3[2] * y * z
        slope[12, 0], slope[12, 1] = -6 * C3[3] * x * z, -6 * C3[3] * y * z
        slope[12, 2] = 3 * C3[3] * (2 * zz - xx - yy)
        slope[13, 0], slope[13, 1] = -C3[4] * (4 * zz - 3 * xx - yy), 2 * C3[4] * x * y
        slope[13, 2] = -8 * C3[4] * x * z
        slope[14, 0], slope[14, 1] = 2 * C3[5] * x * z, -2 * C3[5] * y * z
        slope[14, 2] = C3[5] * (xx - yy)
        slope[15, 0], slope[15, 1] = -3 * C3[6] * (xx - yy), 6 * C3[6] * x * y


@njit(parallel=True, cache=True)
def project(position, factor, opacity, sh, shift, view, threads, splats, depth):
    """Compute splats [N, 12] and depths [N] of all Gaussians; invisible ones get depth 0.

    shift: [N, 2] pixels, added to the centres
    """
    for thread in prange(threads):
        point, slope, rows, m = np.empty(3), np.empty(2), np.empty((2, 3)), np.empty((2, 3))
        sigma, conic, basis = np.empty(3), np.empty(3), np.empty(16)
        for n in range(thread * len(depth) // threads, (thread + 1) * len(depth) // threads):
            depth[n] = 0
            if not opacity[n] >= view[23]:
                continue
            if not _projected(position[n], factor[n], view, point, slope, rows, m):
                continue
            strength = opacity[n] * _conic(m, view, sigma, conic)
            if not strength >= view[23]:
                continue
            u = view[15] * point[0] / point[2] + view[17] + shift[n, 0]
            v = view[16] * point[1] / point[2] + view[18] + shift[n, 1]
            reach = 2 * np.log(strength / view[23])
            wide = min(np.sqrt(reach * sigma[0]), FARTHEST)
            high = min(np.sqrt(reach * sigma[2]), FARTHEST)
            if not max(abs(u), abs(v)) < FARTHEST:
                continue
            if not (u + wide >= 0 and u - wide <= view[25] - 1):
                continue
            if not (v + high >= 0 and v - high <= view[26] - 1):
                continue
            _colour(position[n], sh[n], view, basis, splats[n])
            splats[n, U], splats[n, V] = u, v
            splats[n, A], splats[n, B], splats[n, C] = conic[0], conic[1], conic[2]
            splats[n, OPACITY], splats[n, REACH] = strength, reach
            splats[n, WIDE], splats[n, HIGH] = wide, high
            depth[n] = point[2]


@njit(cache=True)
def _colour(position, sh, view, basis, splat):
    """Compute the splat's colour as seen from the camera."""
    x, y, z = position[0] - view[12], position[1] - view[13], position[2] - view[14]
    length = np.sqrt(x * x + y * y + z * z)
    basis_of(x / length, y / length, z / length, len(sh), basis)
    for channel in range(3):
        colour = view[24]
        for k in range(len(sh)):
            colour += basis[k] * sh[k, channel]
        splat[RED + channel] = max(colour, 0.0)


@njit(parallel=True, cache=True)
def project_backward(
    index, position, factor, sh, view, splats, gradient, threads,
    to_position, to_factor, to_opacity, to_sh, to_shift,
):  # fmt: skip
    """Compute gradients by the Gaussians `index` [M] from those by their splats.

    splats: [M, 12] from `project`
    gradient: [M, 9]

    Gradients of other Gaussians are left unchanged.
    """
    for thread in prange(threads):
        point, slope, rows, m = np.empty(3), np.empty(2), np.empty((2, 3)), np.empty((2, 3))
        scratch, toward = np.empty((2, 3)), np.empty(3)
        basis, slopes, g = np.empty(16), np.empty((16, 3)), np.empty(GRADIENTS)
        for i in range(thread * len(index) // threads, (thread + 1) * len(index) // threads):
            n = index[i]
            g[:] = gradient[i]
            to_shift[n, 0], to_shift[n, 1] = g[U], g[V]
            _projected(position[n], factor[n], view, point, slope, rows, m)
            to_opacity[n] = g[OPACITY] * _covariance_backward(g, m, view, scratch)
            if view[27]:
                _compensation_backward(g[OPACITY] * splats[i, OPACITY], m, view[22], scratch)
            toward[:] = 0  # of the point in camera coordinates
            _shape_backward(rows, factor[n], slope, point, view, scratch, to_factor[n], toward)
            z = point[2]
            for axis in range(2):
                focal = view[15 + axis]
                toward[axis] += g[U + axis] * focal / z
                toward[2] -= g[U + axis] * focal * point[axis] / (z * z)
            for j in range(3):
                to_position[n, j] = (
                    view[j] * toward[0] + view[3 + j] * toward[1] + view[6 + j] * toward[2]
                )
            _colour_backward(
                g, splats[i], position[n], sh[n], view, basis, slopes, to_sh[n], to_position[n]
            )


@njit(cache=True)
def _covariance_backward(g, m, view, to_m):
    """Convert the conic's gradient to M's; return the factor that compensates the opacity."""
    compensation = _conic(m, view, to_m[0], to_m[1])
    a, b, c = to_m[1, 0], to_m[1, 1], to_m[1, 2]
    ga, gb, gc = g[A], g[B] / 2, g[C]
    # −K·G·K of the symmetric matrices
    xx = -(a * (ga * a + gb * b) + b * (gb * a + gc * b))
    xy = -(a * (ga * b + gb * c) + b * (gb * b + gc * c))
    yy = -(b * (ga * b + gb * c) + c * (gb * b + gc * c))
    for j in range(3):
        to_m[0, j] = 2 * (xx * m[0, j] + xy * m[1, j])
        to_m[1, j] = 2 * (xy * m[0, j] + yy * m[1, j])
    return compensation


@njit(cache=True)
def _compensation_backward(pull, m, blur, to_m):
    """Add the gradient of f = √(D / E) to M's; `pull` is the loss's gradient by log f.

    d log f = (dD / D − dE / E) / 2, where E − D = blur·(|m₀|² + |m₁|²) + blur² = B, so that
    1/D − 1/E = B / (D·E) needs no difference; dD by m₀ is 2·m₁ × (m₀ × m₁), by m₁ 2·(m₀ × m₁) × m₀.
    """
    x, y, z = _cross(m)
    sharp, added = x * x + y * y + z * z, blur * blur
    for j in range(3):
        added += blur * (m[0, j] ** 2 + m[1, j] ** 2)
    less = pull * blur / (sharp + added)
    more = pull * added / (sharp * (sharp + added))
    to_m[0, 0] += more * (m[1, 1] * z - m[1, 2] * y) - less * m[0, 0]
    to_m[0, 1] += more * (m[1, 2] * x - m[1, 0] * z) - less * m[0, 1]
    to_m[0, 2] += more * (m[1, 0] * y - m[1, 1] * x) - less * m[0, 2]
    to_m[1, 0] += more * (y * m[0, 2] - z * m[0, 1]) - less * m[1, 0]
    to_m[1, 1] += more * (z * m[0, 0] - x * m[0, 2]) - less * m[1, 1]
    to_m[1, 2] += more * (x * m[0, 1] - y * m[0, 0]) - less * m[1, 2]


@njit(cache=True)
def _shape_backward(rows, factor, slope, point, view, to_m, to_factor, toward):
    """Convert M's gradient to the factor's, and add to the camera point's."""
    for k in range(3):
        for j in range(3):
            to_factor[k, j] = rows[0, k] * to_m[0, j] + rows[1, k] * to_m[1, j]
    z = point[2]
    for axis in range(2):
        focal, limit = view[15 + axis], view[19 + axis]
        scale, tilt = 0.0, 0.0  # of focal/z, and of −focal·slope/z
        for k in range(3):
            to_row = 0.0
            for j in range(3):
                to_row += to_m[axis, j] * factor[k, j]
            scale += to_row * view[3 * axis + k]
            tilt += to_row * view[6 + k]
        toward[2] += focal / (z * z) * (tilt * slope[axis] - scale)
        if abs(point[axis]) <= limit * z:
            toward[axis] -= tilt * focal / (z * z)
            toward[2] += tilt * focal * point[axis] / (z * z * z)


@njit(cache=True)
def _colour_backward(g, splat, position, sh, view, basis, slopes, to_sh, to_position):
    """Convert the colour's gradient to the harmonics', and, by the direction, add to the
    position's."""
    count = len(sh)
    x, y, z = position[0] - view[12], position[1] - view[13], position[2] - view[14]
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    basis_of(x, y, z, count, basis)
    basis_gradient(x, y, z, count, slopes)
    dx, dy, dz = 0.0, 0.0, 0.0
    for channel in range(3):
        if not splat[RED + channel] > 0:  # clamped
            continue
        for k in range(count):
            to_sh[k, channel] = basis[k] * g[RED + channel]
            pull = sh[k, channel] * g[RED + channel]
            dx += slopes[k, 0] * pull
            dy += slopes[k, 1] * pull
            dz += slopes[k, 2] * pull
    along = x * dx + y * dy + z * dz
    to_position[0] += (dx - x * along) / length
    to_position[1] += (dy - y * along) / length
    to_position[2] += (dz - z * along) / length
