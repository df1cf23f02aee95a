"""Error budget of a picture: the error of each part of packing and of the machine, and of all.

A part's error is the error of a picture in which only that part is inexact. Parts of packing are
measured against the reference's picture of the scene as trained, parts of the machine against its
picture of the packed model. Only the part "8 bits" is rounded to 8 bits:

    positions … degree 3   the scene with that part of its Gaussians packed
    arithmetic             golden's splats of stages 0 and 1, blended in float64 in exact order
    depth keys             exact splats in the order of golden's keys
    too faint              exact splats without those that the machine's faintness rule drops
    raster                 exact splats through golden's stage 3, without that rule and with
                           unrounded sums
    8 bits                 the exact picture, rounded
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from splatcore.golden.bin import keys
from splatcore.golden.exact import entries_of, features_of
from splatcore.golden.points import Points, project_points
from splatcore.golden.raster import rasterize
from splatcore.golden.reference import render as render_reference
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.plot import legend_below, side_by_side
from splatcore.sim.common.table import Table, shown
from splatcore.sim.frame.budget import part_by_part
from splatcore.sim.frame.choose import Progress
from splatcore.sim.frame.engines import golden
from splatcore.sim.frame.metric import LEVELS, against, difference
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.frame.shot import View, judge
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.raster import faint_rule
from splatcore.spec.scene import Gaussians
from splatcore.study.accuracy.points import Reference, drawn_splats, fields_of, picture
from splatcore.study.results.fields import columns, facts
from splatcore.study.results.frames import BudgetPart, BudgetRow

WHOLES = ("packing", "machine", "scene")
"""Groups of parts; "scene" is everything together."""

SUM = "sum of the parts"

TITLES = {"packing": "all of packing", "machine": "all of the machine", "scene": "everything"}


def budgets(config: Config, views: dict[str, View]) -> list[dict]:
    """Measure the `budget` of each view."""
    rows = []
    for name, view in views.items():
        with progress_bar(name) as advance:

            def progress(step: str, name: str = name, advance=advance):
                advance(0, None, f"{name}: {step}")

            rows.append(budget(config, view, progress))
    return rows


def budget(config: Config, view: View, progress: Progress = str) -> dict:
    """Measure a view's error budget.

    Returns the view, the packing of its scene, the errors of its 8-bit pictures, and rows of
    `error` in `parts`. Raises InputError for a packed model.
    """
    shot = view.open(config)
    camera, original = shot.camera, shot.source.unpacked
    shot.check_fits()
    progress("packing")
    found, model = shot.packed, shot.model
    progress("golden model")
    frame = golden(shot)
    metrics = judge(frame, shot) | {"packing": difference(shot.reference, shot.truth)}
    scene, whole = exact_picture(shot.source.gaussians, camera), Reference(model, camera)
    rows = []
    for name, gaussians in part_by_part(original, model):
        progress(name)
        rows.append(error(name, "packing", exact_picture(gaussians, camera), scene))
    for name, image in machine_parts(config, whole, project_points(config, model, camera)):
        progress(name)
        rows.append(error(name, "machine", image, whole.image))
    sums = [in_sum([row for row in rows if of in (row["of"], "scene")], of) for of in WHOLES]
    pixels = frame.pixels / LEVELS
    pairs = {"packing": (whole.image, scene), "machine": (pixels, whole.image)}
    pairs["scene"] = pixels, scene
    rows += sums + [error(TITLES[of], of, *pairs[of]) for of in WHOLES]
    rows.sort(key=lambda row: WHOLES.index(row["of"]))
    return facts(BudgetRow(
        scene=Path(view.scene).name, camera=view.camera or camera.name,
        size=[camera.width, camera.height], quality=found.quality,
        bytes_per_gaussian=model.bytes_per_gaussian, parts=with_shares(rows),
        **against(metrics),
    ))  # fmt: skip


def exact_picture(gaussians: Gaussians, camera: Camera) -> np.ndarray:
    """Render the reference's picture [H, W, 3], 0 … 1, unrounded."""
    return render_reference(gaussians, camera).image.clip(0, 1)


def machine_parts(
    config: Config, exact: Reference, points: Points
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each part of the machine and a picture [H, W, 3], 0 … 1, with only its error."""
    model, camera = exact.model, exact.camera
    splats = drawn_splats(fields_of(config, model, points), points)[0]
    order = np.lexsort((splats.index, exact.depth[splats.index]))
    yield "arithmetic", picture(splats[order], camera)
    order = np.lexsort((exact.splats.index, keys_of(config, exact, points)))
    yield "depth keys", picture(exact.splats[order], camera)
    rule = replace(SPLATCORE, faint=faint_rule(config))
    yield "too faint", picture(exact.splats, camera, rule)
    yield "raster", raster_picture(config, exact)
    yield "8 bits", np.rint(exact.image * LEVELS) / LEVELS


def keys_of(config: Config, exact: Reference, points: Points) -> np.ndarray:
    """Golden's depth keys [M] of the exact splats.

    A splat that golden does not project gets a key interpolated from its neighbours in depth.
    """
    if not len(points.index):
        return exact.splats.depth
    found = keys(config, points.codes).astype(np.float64)
    depth = exact.depth[points.index]
    order = np.argsort(depth, kind="stable")
    return np.interp(exact.splats.depth, depth[order], found[order])


def raster_picture(config: Config, exact: Reference) -> np.ndarray:
    """Stage 3's unrounded sums of exact splats, 0 … 1, without the faintness rule."""
    config = replace(config, faint=())
    size = exact.camera.width, exact.camera.height
    entries = entries_of(config, exact.splats, exact.camera)
    features = features_of(config, exact.splats)
    sums = rasterize(config, features, entries, size, rounded=False).pixels
    return sums / (LEVELS << config.sum_fraction - 8)


def error(part: str, of: str, image: np.ndarray, truth: np.ndarray) -> dict:
    """A part's squared error, dB and largest error per channel. of: one of `WHOLES`."""
    square, largest = float(np.mean((image - truth) ** 2)), float(np.abs(image - truth).max())
    return row(part, of, square, largest)


def row(part: str, of: str, square: float, largest: float | None) -> dict:
    """A line of the budget."""
    db = psnr_of_square(square)
    return {"part": part, "of": of, "square": square, "psnr_db": db, "max_error": largest}


def in_sum(rows: list[dict], of: str) -> dict:
    """The row of several parts together, with their errors taken as independent."""
    return row(SUM, of, sum(each["square"] for each in rows), None)


def with_shares(rows: list[dict]) -> list[BudgetPart]:
    """Replace squared errors by shares of the whole squared error; None if that is 0."""
    whole = next(each["square"] for each in rows if each["part"] == TITLES["scene"])
    shares = ({"share": each.pop("square") / whole if whole else None} for each in rows)
    return [BudgetPart(**each, **share) for each, share in zip(rows, shares, strict=True)]


def budget_table(found: dict) -> Table:
    """Table of a view's parts and wholes."""
    title = f"{found['scene']} {found['camera']}, packed as {found['quality']}"
    shown = columns(BudgetPart, "part of psnr_db max_error share")
    return Table.of("budget", title, shown, found["parts"])


def budget_line(found: dict) -> str:
    """A view's errors between 8-bit pictures, as other commands print them."""
    whole = (f"{of} {shown(found[f'psnr_db_{of}'], '.2f', none='∞')}" for of in WHOLES)
    return f"8-bit pictures of both, dB: {', '.join(whole)}"


def write_budget_plot(path: str | Path, rows: list[dict]):
    """Plot RMS errors of all parts and wholes, for each view."""
    figure = Figure((9, 2 + 0.12 * len(rows) * len(rows[0]["parts"])), 150, layout="constrained")
    draw_budget(figure, rows)
    write_figure(path, figure)


def draw_budget(figure: Figure, rows: list[dict]):
    """Draw bars of RMS errors, in steps of 1/255, on a logarithmic axis."""
    axes = figure.subplots()
    labels = dict.fromkeys(each["part"] for found in rows for each in found["parts"])
    labels = [label for label in labels if label != SUM]

    def rms(found: dict) -> list[float]:
        known = {each["part"]: each["psnr_db"] for each in found["parts"]}
        decibels = [known.get(label) for label in labels]
        return [np.nan if db is None else LEVELS * 10 ** (-db / 20) for db in decibels]

    side_by_side(axes, labels, {f"{r['scene'].split('.')[0]} {r['camera']}": rms(r) for r in rows})
    axes.set_xscale("log")
    axes.set_xlabel(
        "RMS error of pictures, steps of 1/255, logarithmic\n"
        "(packing: against the scene as trained; machine: against the same packed model)"
    )
    legend_below(figure, axes, 3)
