"""Light on the garden, as SH coefficients: a low warm sun with shadows, sky light, haze."""

import numpy as np

from splatcore.model.generate.directions import UP, unit
from splatcore.model.generate.garden_splats import Part
from splatcore.model.generate.spreading import noise
from splatcore.spec.colour import SH_C0, SH_C1
from splatcore.spec.scene import batches, sh_count

SUN = unit(np.array([-0.70, -0.62, -0.36]))
"""Direction towards the sun (y down): from the left, a little behind the viewer."""

SUN_LIGHT = np.array([3.6, 2.95, 2.05])  # linear RGB reflected by a white surface facing the sun
SKY_LIGHT = np.array([0.46, 0.60, 0.82])  # the same for the whole sky
BOUNCE_LIGHT = np.array([0.22, 0.24, 0.12])  # light from the ground on downward surfaces
HAZE = np.array([0.66, 0.76, 0.88])  # linear RGB of the air near the horizon
HAZE_DISTANCE = 90.0  # scene units over which 1 − 1/e of a colour is lost to haze
SHADOW_REACH = 14.0  # scene units around the origin within which shadows are computed

EXPOSURE = 0.85
GAMMA = 2.2
CONTRAST = 0.45


def display(radiance: np.ndarray) -> np.ndarray:
    """Convert linear light ≥ 0 to display values in [0, 1): soft shoulder, gamma, contrast."""
    soft = (1 - np.exp(-EXPOSURE * np.maximum(radiance, 0))) ** (1 / GAMMA)
    return soft + CONTRAST * (soft * soft * (3 - 2 * soft) - soft)


def projected_area(part: Part, direction: np.ndarray) -> np.ndarray:
    """Integral [N] of a splat's opacity over a plane perpendicular to `direction` [3].

    The projection along d has √det = √(det Σ · dᵀΣ⁻¹d), which needs no inverse in the splat's own
    frame.
    """
    local = np.einsum("nij,i->nj", part.frame, direction) ** 2
    s = part.scale**2
    others = np.stack([s[:, 1] * s[:, 2], s[:, 0] * s[:, 2], s[:, 0] * s[:, 1]], axis=1)
    return 2 * np.pi * part.opacity * np.sqrt(np.sum(local * others, axis=1))


def transmittance(part: Part, direction: np.ndarray, cell: float, bias: float) -> np.ndarray:
    """Share [N] of the light from `direction` that reaches each splat past the others.

    cell: side of a cell, scene units
    bias: splats nearer to the light by at most this do not count, scene units

    The plane perpendicular to `direction` is divided into square cells. In each cell, the optical
    depths of the splats nearer to the light add up. The result is averaged over four shifted grids.
    """
    side = unit(np.cross(direction, [0.0, 0.0, 1.0]))
    plane = np.stack([part.position @ side, part.position @ np.cross(direction, side)], axis=1)
    away = -(part.position @ direction)  # distance from the light
    thickness = projected_area(part, direction) / cell**2
    total = np.zeros(len(part))
    span = np.ptp(away) + 2 * bias + 1
    for shift in ((0.0, 0.0), (0.5, 0.25), (0.25, 0.75), (0.75, 0.5)):
        index = np.floor(plane / cell + shift).astype(np.int64)
        index -= index.min(axis=0)
        column = (index[:, 0] * (index[:, 1].max() + 1) + index[:, 1]) * span
        key = column + (away - away.min()) + bias
        order = np.argsort(key)
        column, key = column[order], key[order]  # searching ascending values is much faster
        depth = np.concatenate([[0.0], np.cumsum(thickness[order])])
        first = np.searchsorted(key, column)
        total[order] += np.exp(depth[first] - depth[np.searchsorted(key, key - bias)])
    return total / 4


def shadows(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Shares [N] of the sun's and of the sky's light that reach each splat past the others."""
    count = len(part)
    near = np.linalg.norm(part.position, axis=1) < SHADOW_REACH
    cell = np.clip(0.09 * (20_000 / count) ** 0.5, 0.03, 0.5)
    sun, sky = np.ones(count), np.ones(count)
    if near.any():
        some = part[near]
        sun[near] = transmittance(some, SUN, cell, bias=max(cell, 0.09))
        sky[near] = transmittance(some, UP, 4 * cell, bias=max(cell, 0.09))
    return sun, sky


def illuminated(part: Part, sun: np.ndarray, sky: np.ndarray) -> np.ndarray:
    """Linear RGB [N, 3] that each splat sends to an average viewer; sun, sky: its `shadows`."""
    normal = part.frame[:, :, 2]
    facing = normal @ SUN
    solid, leaf = np.maximum(facing, 0), 0.25 + 0.55 * np.abs(facing)
    direct = sun * (solid + part.leafy * (leaf - solid))
    upward = 0.5 + 0.5 * (normal @ UP)
    upward += part.leafy * (0.6 - upward)
    ambient = upward * (0.2 + 0.8 * sky)
    light = direct[:, None] * SUN_LIGHT + ambient[:, None] * SKY_LIGHT
    light += (1 - upward)[:, None] * BOUNCE_LIGHT
    return part.albedo * light


def sh_coefficients(part: Part, degree: int = 1) -> np.ndarray:
    """SH coefficients [N, (degree+1)², 3] of each splat: lit colour plus the sun's sheen, and 0
    above degree 1; float32 if there are any of these, else float64."""
    sun, sky = shadows(part)
    kind = np.float32 if degree > 1 else np.float64
    sh = np.zeros((len(part), sh_count(degree), 3), kind)
    for rows in batches(len(part)):
        sh[rows, :4] = _sheen(part[rows], sun[rows], sky[rows])[:, : sh.shape[1]]
    return sh


def _sheen(part: Part, sun: np.ndarray, sky: np.ndarray) -> np.ndarray:
    """SH coefficients [N, 4, 3] of degree 1.

    A viewer in direction v sees gloss·(v·r) more light, r the mirror image of the sun in the
    surface. With the renderer's direction d = −v and its basis (−y, z, −x) this is linear in d.
    """
    light = illuminated(part, sun, sky)
    distance = np.linalg.norm(part.position, axis=1)
    haze = (1 - np.exp(-distance / HAZE_DISTANCE))[:, None]
    colour = display(light + (HAZE - light) * haze)
    colour[part.glow] = display(part.albedo[part.glow])
    normal = part.frame[:, :, 2]
    mirror = 2 * (normal @ SUN)[:, None] * normal - SUN  # [N, 3]
    strength = part.gloss * (0.25 + 0.75 * sun)
    sheen = strength[:, None, None] * mirror[:, :, None] * [1.0, 0.96, 0.88]  # [N, axis, RGB]
    sh = np.empty((len(part), 4, 3))
    sh[:, 0] = (colour - 0.5) / SH_C0
    sh[:, 1], sh[:, 2], sh[:, 3] = sheen[:, 1], -sheen[:, 2], sheen[:, 0]
    sh[:, 1:] /= SH_C1
    return sh


def sky_colour(direction: np.ndarray, seed: int) -> np.ndarray:
    """Linear RGB [N, 3] of the sky in unit directions [N, 3]: gradient, glow of the sun, clouds."""
    height = np.clip(-direction[:, 1], 0, 1)[:, None]
    zenith, horizon = np.array([0.06, 0.31, 0.88]), np.array([0.92, 0.98, 0.98])
    colour = horizon + (zenith - horizon) * np.minimum(height / 0.6, 1) ** 0.55
    towards = np.maximum(direction @ SUN, 0)[:, None]
    colour = colour + np.array([0.9, 0.65, 0.35]) * (0.3 * towards**6 + 1.5 * towards**60)
    turn = np.arctan2(direction[:, 0], direction[:, 2]) / (2 * np.pi)
    rise = np.arcsin(height[:, 0])
    field = noise(turn * 64, rise * 18, seed, octaves=4)  # the lattice repeats after one turn
    cover = np.clip((field - 0.50) * 6, 0, 1)[:, None] * np.clip(height * 10 - 0.2, 0, 1)
    under = noise(turn * 64, rise * 18 + 0.45, seed, octaves=3)[:, None]  # more cloud above: shade
    cloud = np.array([2.6, 2.5, 2.4]) - np.array([1.5, 1.4, 1.2]) * np.clip(3 * under - 1.3, 0, 1)
    return colour + (cloud - colour) * 0.5 * cover
