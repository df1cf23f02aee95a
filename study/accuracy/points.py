"""Errors of the numbers of stages 0 and 1, and of a picture made of them.

Compares the golden model of both stages with the float64 reference on the same packed model. The
reference blends the picture from golden's splats, so it contains only the errors of these stages.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatcore.golden.points import Points, project_points
from splatcore.golden.reference import Splats, areas, pixel_boxes, project, tile_lists
from splatcore.golden.reference_tiles import rasterize
from splatcore.model.generate.hard import HARD
from splatcore.sim.frame.metric import psnr
from splatcore.sim.frame.shot import Shot, View
from splatcore.spec.camera import Camera
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import DEFAULT, PAPER, Config
from splatcore.spec.convention import SPLATCORE, Convention
from splatcore.spec.depth import whole_depth
from splatcore.spec.error import InputError
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import COLOURS

SMALL_EXPONENT = 5
"""Exponents of at most this many bits have FP16's rules and PAPER's unit of the screen."""

Fields = dict[str, np.ndarray]
"""Arrays [M] by name.

u, v, half_width, half_height: pixels
depth: scene units
conic_a, conic_c: 1/pixel²
shear, red, green, blue: no unit
"""

Progress = Callable[[str], None]  # called with the name of the step that begins


def with_width(text: str, config: Config = DEFAULT) -> Config:
    """Return a machine whose stages 0 and 1 compute with `text` = "exponent/fraction" bits."""
    try:
        exponent, fraction = map(int, text.split("/"))
        if not (4 <= exponent <= 10 and 3 <= fraction <= 23):
            raise ValueError
    except ValueError:
        raise InputError(
            f"--width '{text}': is not EXPONENT/FRACTION bits, like 7/16 (4 … 10 and 3 … 23)"
        ) from None
    small = exponent <= SMALL_EXPONENT
    rules = {"subnormal": small, "overflow": "infinity" if small else "saturate"}
    arithmetic = Float(exponent, fraction, **rules)
    unit = PAPER.screen_exponent if small else config.screen_exponent
    depth = replace(arithmetic, signed=False)
    name = f"{exponent}/{fraction}"
    return replace(config, name=name, arithmetic=arithmetic, depth=depth, screen_exponent=unit)


MACHINES = (PAPER, *map(with_width, ("5/10", "7/10", "7/13")), DEFAULT, with_width("8/20"))
"""Machines that are compared by default."""


def width_of(config: Config) -> str:
    """Number format of a machine's stages 0 and 1 as "exponent/fraction" bits."""
    return f"{config.arithmetic.exponent}/{config.arithmetic.fraction}"


def heading(config: Config) -> str:
    """A machine's name, with its width below unless the name is the width."""
    return config.name if config.name == width_of(config) else f"{config.name}\n{width_of(config)}"


@dataclass(frozen=True, eq=False)
class Reference:
    """Exact results: the float64 reference on a packed model."""

    model: PackedModel
    camera: Camera

    @cached_property
    def splats(self) -> Splats:
        return project(self.model.gaussians(), self.camera)[0]

    @cached_property
    def depth(self) -> np.ndarray:
        """Camera z [N] of all Gaussians."""
        return self.model.position @ self.camera.rotation[2] + self.camera.translation[2]

    @cached_property
    def image(self) -> np.ndarray:
        return picture(self.splats, self.camera)

    @property
    def axis_ratio(self) -> float | None:
        """Largest ratio of a visible Gaussian's axes; None if infinite, 0 if none is visible."""
        factor = self.model.factor[self.splats.index]
        axes = np.linalg.svd(factor, compute_uv=False)  # [M, 3], largest first
        volume = np.abs(np.diagonal(factor, axis1=1, axis2=2).prod(axis=1))  # of all three, exact
        if not volume.all():
            return None
        return float((axes[:, 0] ** 2 * axes[:, 1] / volume).max(initial=0))

    @property
    def screen_ratio(self) -> float:
        """Largest ratio of a splat's axes on the screen, blur included; 0 without splats."""
        xx, xy, yy = self.splats.covariance.T
        mean, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        a, b, c = self.splats.conic.T  # its determinant has lost no digits to cancellation
        smallest = 1 / ((a + c) / 2 + np.hypot((a - c) / 2, b))
        return float(np.sqrt((mean + half) / smallest).max(initial=0))


def fields_of(config: Config, model: PackedModel, points: Points) -> Fields:
    """Stage 1's results for each projected Gaussian; some may be infinite or NaN."""
    value, pixel = points.projected, 2.0**config.screen_exponent
    across, shear = value["across"], value["shear"]
    flat = config.colours == "array" and not model.format.sh_degree
    names = COLOURS if flat else CHANNELS
    with np.errstate(over="ignore", invalid="ignore"):  # infinities of FP16
        fields = {
            "u": value["u"] * pixel,
            "v": value["v"] * pixel,
            "depth": whole_depth(config, value["z"], value["z_low"]),
            "conic_a": across / pixel**2,
            "shear": shear,
            "conic_c": (value["along"] + shear * shear * across) / pixel**2,
            "half_width": value["half_width"] * pixel,
            "half_height": value["half_height"] * pixel,
        }
        colours = [np.maximum(value[name], 0) for name in names]
    return fields | dict(zip(CHANNELS, colours, strict=True))


def fields_of_splats(splats: Splats) -> Fields:
    """The fields of the reference's splats."""
    a, b, c = splats.conic.T
    names = ("u", "v", "depth", "conic_a", "shear", "conic_c", "half_width", "half_height")
    arrays = (*splats.centre.T, splats.depth, a, -b / a, c, *splats.extent.T)
    return dict(zip((*names, *CHANNELS), (*arrays, *splats.colour.T), strict=True))


def splats_of(fields: Fields, opacity: np.ndarray, index: np.ndarray) -> Splats:
    """Convert stage 1's results into splats [M] in depth order for the reference's rasterizer.

    The rasterizer uses a covariance only to bound the splat, so it is set such that the bounds
    are the half-widths of the fields.
    """
    reach = 2 * np.log(255 * opacity)
    squares = np.stack([fields["half_width"], fields["half_height"]], 1) ** 2 / reach[:, None]
    conic = [fields["conic_a"], -fields["shear"] * fields["conic_a"], fields["conic_c"]]
    splats = Splats(
        index, np.stack([fields["u"], fields["v"]], 1), fields["depth"],
        np.insert(squares, 1, 0.0, axis=1), np.stack(conic, 1), opacity, reach,
        np.stack([fields[channel] for channel in CHANNELS], axis=1),
    )  # fmt: skip
    return splats[np.argsort(splats.depth, kind="stable")]


def picture(splats: Splats, camera: Camera, convention: Convention = SPLATCORE) -> np.ndarray:
    """Rasterize splats in depth order by the reference: image [H, W, 3], clipped to 0 … 1."""
    lists = tile_lists(splats, camera, convention)
    found = rasterize(lists, splats, camera.width, camera.height, convention)
    return np.clip(found.image, 0, 1)


def field_errors(found: Fields, exact: Fields) -> Fields:
    """Errors [M] of stage 1's fields.

    u and v in pixels, colours of full scale, shear (xy over yy) relative to √(xx / yy), all others
    relative to the exact value.
    """
    errors = {name: found[name] - exact[name] for name in ("u", "v")}
    names = ("depth", "conic_a", "shear", "conic_c", "half_width", "half_height")
    scales = {name: exact[name] for name in names}
    scales["shear"] = np.sqrt(exact["conic_c"] / exact["conic_a"])
    errors |= {name: (found[name] - exact[name]) / scales[name] for name in names}
    errors["colour"] = np.concatenate([found[name] - exact[name] for name in CHANNELS])
    return errors


def sizes(error: np.ndarray) -> dict[str, float | None]:
    """RMS and largest magnitude of errors; None without errors."""
    if not len(error):
        return {"rms": None, "max": None}
    return {"rms": float(np.sqrt(np.mean(error**2))), "max": float(np.abs(error).max())}


def drawn_splats(fields: Fields, points: Points) -> tuple[Splats, np.ndarray, np.ndarray]:
    """Drawable splats in depth order; masks [M] of the finite ones and of the positive definite.

    A splat can be drawn if it is finite and its conic is positive definite.
    """
    finite = np.all([np.isfinite(values) for values in fields.values()], axis=0)
    positive = (points.projected["across"] > 0) & (points.projected["along"] > 0)
    drawn = np.flatnonzero(finite & positive)
    left, index = {name: values[drawn] for name, values in fields.items()}, points.index[drawn]
    opacity = np.exp2(-points.projected["attenuation"][drawn] * OPACITY.step)
    return splats_of(left, opacity, index), finite, positive


def measure(config: Config, exact: Reference, whole: Reference) -> dict:
    """Measure a machine: errors by field, error of the picture, counts of Gaussians.

    exact: the reference on the machine's packed model
    whole: the reference on the scene as packed for DEFAULT

    Splats that are not finite or not positive definite are left out of the picture.
    """
    model, camera = exact.model, exact.camera
    points = project_points(config, model, camera)
    fields, index = fields_of(config, model, points), points.index
    splats, finite, positive = drawn_splats(fields, points)

    true, depth = exact.depth[points.points], points.culled["z"]
    front = (true > camera.near) & np.isfinite(depth)  # of the Gaussians that stage 0 reads
    stage_0 = {"depth_stage_0": depth[front] / true[front] - 1}
    _, a, b = np.intersect1d(index, exact.splats.index, return_indices=True)
    a, b = a[finite[a]], b[finite[a]]
    both = {name: values[a] for name, values in fields.items()}
    errors = stage_0 | field_errors(both, fields_of_splats(exact.splats[b]))

    seen = splats.index[areas(pixel_boxes(splats, camera)) > 0]
    image = picture(splats, camera)
    return {
        "fields": {name: sizes(error) for name, error in errors.items()},
        "psnr_db_machine": psnr(image, exact.image),
        "psnr_db_default_model": psnr(image, whole.image),
        "max_error_machine": float(np.abs(image - exact.image).max()),
        "projected": len(index),
        "visible": len(exact.splats),
        "lost": len(np.setdiff1d(exact.splats.index, index)),
        "gained": len(np.setdiff1d(seen, exact.splats.index)),
        "not_finite": int((~finite).sum()),
        "not_positive": int((finite & ~positive).sum()),
    }


def measure_view(view: View, machines: tuple[Config, ...], progress: Progress) -> dict:
    """Measure all machines on a scene, which is packed once per packed format.

    Machines that do not compensate opacities get the scene without its `antialiased` mark.
    """
    progress("packing")
    begin = time.perf_counter()
    shot = view.open()
    source, camera = shot.source, shot.camera
    sources, references = {True: source, False: source}, {}
    if source.scene is not None and source.scene.antialiased:
        plain = replace(source.scene, antialiased=False)
        sources[False] = replace(source, scene=plain)

    def reference(config: Config, compensates: bool) -> Reference:
        model = Shot(sources[compensates], camera, config).model
        return references.setdefault(id(model), Reference(model, camera))

    whole = reference(DEFAULT, True)
    facts = {
        "hard": view.scene in HARD,
        "camera": view.camera_text or camera.name,
        "size": [camera.width, camera.height],
        "visible": len(whole.splats),
        "axis_ratio": whole.axis_ratio,
        "screen_ratio": whole.screen_ratio,
    }
    facts["machines"] = results = {}
    for config in machines:
        progress(config.name)
        same = config.compensates
        results[config.name] = measure(config, reference(config, same), reference(DEFAULT, same))
    return facts | {"seconds": round(time.perf_counter() - begin, 1)}
