"""How far stage 1's numbers are from exact ones, and what that does to the picture.

The twin of stages 0 and 1 against the float64 reference on the same packed model. The picture is
blended by the reference from the twin's splats, so that nothing but the points' errors is in it.
"""

from dataclasses import replace

import numpy as np

from golden.points import CHANNELS, Points, project_points
from golden.reference import Splats, project, tile_boxes
from golden.reference_tiles import bin_splats, rasterize
from spec.camera import Camera
from spec.config import DEFAULT, Config
from spec.convention import SPLATCORE
from spec.error import InputError
from spec.number import Float
from spec.packed import PackedModel

WIDTHS = ("7/10", "7/13", "7/16", "8/20")
"""Exponent/fraction bits of stages 0 and 1 that are compared; 7/16 is DEFAULT."""


def with_width(text: str, config: Config = DEFAULT) -> Config:
    """A machine whose stages 0 and 1 compute with "exponent/fraction" bits."""
    try:
        exponent, fraction = map(int, text.split("/"))
        arithmetic = Float(exponent, fraction, subnormal=False)
        depth = Float(exponent, fraction, signed=False, subnormal=False)
        if not 3 <= fraction <= 23:
            raise ValueError
    except ValueError:
        raise InputError(f"--width '{text}': is not EXPONENT/FRACTION bits, like 7/16") from None
    return replace(config, name=text, arithmetic=arithmetic, depth=depth)


def splats_of(config: Config, model: PackedModel, points: Points) -> Splats:
    """The twin's splats in depth order, as the reference's rasterizer wants them."""
    value, index = points.projected, points.index
    steps = 2.0**config.screen_fraction
    centre = [
        (np.rint(value[f"slope_{axis}"] * steps) + points.frame.principal[k]) / steps
        for k, axis in enumerate("xy")
    ]
    across, shear = value["across"], value["shear"]
    conic = [across, -shear * across, value["along"] + shear**2 * across]
    covariance = [value["xx"], value["xy"], value["yy"]]
    if model.format.sh_degree:
        colour = np.stack([value[channel] for channel in CHANNELS], axis=1)
    else:
        colour = model.colour[index]
    opacity = model.opacity[index]
    splats = Splats(
        index, np.stack(centre, 1), config.depth.round(value["z"]), np.stack(covariance, 1),
        np.stack(conic, 1), opacity, 2 * np.log(255 * opacity), np.maximum(colour, 0),
    )  # fmt: skip
    return splats[np.argsort(splats.depth, kind="stable")]


def picture(splats: Splats, camera: Camera) -> np.ndarray:
    """The reference rasterizer's image [H, W, 3] of splats in depth order."""
    boxes = tile_boxes(splats, camera, SPLATCORE)
    lists = bin_splats(
        splats.centre, splats.conic, splats.reach, boxes, camera.width, camera.height, True
    )
    return rasterize(lists, splats, camera.width, camera.height, SPLATCORE)[0]


def field_errors(found: Splats, exact: Splats) -> dict[str, dict[str, float]]:
    """RMS and maximum of each field's error over the Gaussians that both hold.

    Pixels for u and v; of the rest the error relative to the exact value, of shear (xy over yy)
    relative to √(xx / yy), of colours in units of full scale.
    """
    _, a, b = np.intersect1d(found.index, exact.index, return_indices=True)
    found, exact = found[a], exact[b]
    xx, xy, yy = exact.covariance.T
    errors = {
        "u": found.centre[:, 0] - exact.centre[:, 0],
        "v": found.centre[:, 1] - exact.centre[:, 1],
        "depth": found.depth / exact.depth - 1,
        "conic_a": found.conic[:, 0] / exact.conic[:, 0] - 1,
        "conic_c": found.conic[:, 2] / exact.conic[:, 2] - 1,
        "shear": (found.covariance[:, 1] / found.covariance[:, 2] - xy / yy) / np.sqrt(xx / yy),
        "half_width": found.extent[:, 0] / np.maximum(exact.extent[:, 0], 1e-9) - 1,
        "half_height": found.extent[:, 1] / np.maximum(exact.extent[:, 1], 1e-9) - 1,
        "colour": (found.colour - exact.colour).reshape(-1),
    }
    return {
        name: {"rms": float(np.sqrt(np.mean(e**2))), "max": float(np.abs(e).max(initial=0))}
        for name, e in errors.items()
    }


def measure(config: Config, model: PackedModel, camera: Camera, exact: Splats) -> dict:
    """A width's errors by field, PSNR and largest error of its picture, and what was projected."""
    points = project_points(config, model, camera)
    splats = splats_of(config, model, points)
    image, reference = (np.clip(picture(s, camera), 0, 1) for s in (splats, exact))
    error = image - reference
    return {
        "fields": field_errors(splats, exact),
        "psnr_db": float(-10 * np.log10(np.mean(error**2))) if error.any() else None,
        "max_error": float(np.abs(error).max()),
        "projected": len(points.index),
        "visible": len(exact),
        "lost": len(np.setdiff1d(exact.index, points.index)),
    }


def exact_splats(model: PackedModel, camera: Camera) -> Splats:
    """The reference's splats."""
    return project(model.gaussians(), camera)[0]
