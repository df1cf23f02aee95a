"""Errors of pictures on exact inputs, by the number formats of stages 2 and 3.

"raster" changes one format of stage 3 at a time, and has the gates per lane; "sort" orders the
entries by depth keys of fewer bits.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from splatcore.eda.gates.synth import area
from splatcore.golden.exact import as_packed, entries_of, features_of
from splatcore.golden.raster import Entries, rasterize
from splatcore.golden.reference import Splats, project, render
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table, shown
from splatcore.sim.frame.metric import LEVELS, psnr
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.frame.shot import View
from splatcore.spec.config import DEFAULT, FORMATS, Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.raster import block_count
from splatcore.study.accuracy.keys import EXACT_ORDER, WAYS, Keys, reordered

SWEEP = {field: format.tried for field, format in FORMATS.items()}
"""Formats of stage 3, each with the values to try in addition to DEFAULT's."""

Made = tuple[np.ndarray, dict]  # 8-bit pixels [H, W, 3], and further values of the result


def machines() -> dict[str, Config]:
    """DEFAULT and its variants with one field changed, by name."""
    changes = [(field, value) for field, values in SWEEP.items() for value in values]
    changed = {f"{name} {value}": replace(DEFAULT, **{name: value}) for name, value in changes}
    return {"DEFAULT": DEFAULT} | changed


def lane_gates(config: Config) -> float:
    """NAND2-equivalents per lane: the increment of a second blending lane and its share of E."""
    one, two = (area(Blend(config, block_count(config), lanes)) for lanes in (1, 2))
    return two - one + area(Evaluate(config, 0)) / BLOCK**2


def exact_view(view: View) -> tuple[Splats, Entries, np.ndarray]:
    """Exact splats of a view, their sorted entries and the reference's image [H, W, 3], 0 … 1.

    The splats are those of the Gaussians that a packed model keeps. No format of stage 3 changes
    the entries.
    """
    shot = view.open()
    gaussians, camera = as_packed(shot.source.gaussians), shot.camera
    splats, _ = project(gaussians, camera)
    image = np.clip(render(gaussians, camera).image, 0, 1)
    return splats, entries_of(DEFAULT, splats, camera), image


def by_machine(config: Config, splats: Splats, entries: Entries, size: tuple[int, int]) -> Made:
    """The picture of a machine with other formats of stage 3."""
    raster = rasterize(config, features_of(config, splats), entries, size)
    return raster.pixels, {"contributions": raster.counts["contributions"]}


def by_keys(keys: Keys, splats: Splats, entries: Entries, size: tuple[int, int]) -> Made:
    """The picture in the order of other keys."""
    entries, share = reordered(keys, splats, entries)
    pixels = rasterize(DEFAULT, features_of(DEFAULT, splats), entries, size).pixels
    return pixels, {"changed_places": share}


def errors(views: dict[str, View], variants: Mapping[str, object], made: Callable) -> dict:
    """Measure all variants on all views.

    made: `by_machine` or `by_keys`
    Returns {variant: {"scenes": {scene: {psnr_db_float64, max_error_float64, …}}}}.
    """
    found = {name: {"scenes": {}} for name in variants}
    done, total = 0, len(views) * len(variants)
    with progress_bar("rendering", total) as advance:
        for title, view in views.items():
            splats, entries, image = exact_view(view)
            for name, variant in variants.items():
                advance(done, total)
                done += 1
                pixels, more = made(variant, splats, entries, image.shape[1::-1])
                found[name]["scenes"][title] = {
                    "psnr_db_float64": psnr(pixels / LEVELS, image),
                    "max_error_float64": float(np.abs(pixels / LEVELS - image).max()), **more,
                }  # fmt: skip
    return found


def sort_errors(views: dict[str, View]) -> dict:
    """Measure all `WAYS`, with the share of `changed_places`."""
    return errors(views, WAYS, by_keys)


def raster_errors(views: dict[str, View]) -> dict:
    """Measure all `machines`, with the `contributions` and, for each machine, its "gates"."""
    found = errors(views, machines(), by_machine)
    with progress_bar("synthesising lanes") as advance:
        for done, (name, config) in enumerate(machines().items()):
            advance(done, len(found))
            found[name]["gates"] = lane_gates(config)
    return found


def table(found: dict) -> Table:
    """Table of PSNR of 8-bit pictures, largest error in steps of 1/255, changed neighbours, gates
    per lane."""

    def cell(result: dict) -> str:
        psnr = shown(result["psnr_db_float64"], ".2f", none="exact")
        changed = result.get("changed_places")
        more = "" if changed is None else f", {changed:.2%}"
        return f"{psnr}, {result['max_error_float64'] * LEVELS:.1f}{more}"

    first, *_ = found.values()
    heading, columns = "{}\ndB, max, changed", [Column("keys")]
    if "gates" in first:
        heading, columns = "{}\ndB, max", [Column("stage 3"), Column("gates per lane", digits=0)]
    names = (Path(scene).name.split(".")[0] for scene in first["scenes"])
    columns += [Column(heading.format(name), digits=0) for name in names]
    rows = [
        [name, *([f["gates"]] if "gates" in f else []), *map(cell, f["scenes"].values())]
        for name, f in found.items()
    ]
    title = "8-bit pictures on exact inputs, against the float64 reference"
    return Table("errors", title, columns, rows)


def draw_raster(figure: Figure, found: dict):
    """Draw the lowest PSNR of all scenes against gates per lane, one line per format."""
    axes = figure.subplots()

    def point(name: str) -> tuple[float, float]:
        results = found[name]["scenes"].values()
        return found[name]["gates"], min(result["psnr_db_float64"] for result in results)

    for number, (field, values) in enumerate(SWEEP.items()):
        settings = sorted({*values, getattr(DEFAULT, field)})
        names = ["DEFAULT" if v == getattr(DEFAULT, field) else f"{field} {v}" for v in settings]
        x, y = zip(*map(point, names), strict=True)
        axes.plot(x, y, marker="o", color=f"C{number}", label=field.replace("_", " "))
        for setting, *place in zip(settings, x, y, strict=True):
            axes.annotate(str(setting), place, textcoords="offset points", xytext=(3, 3), size=7)
    axes.plot(*point("DEFAULT"), marker="*", markersize=16, color="black", linestyle="none")
    axes.set_xlabel("NAND2-equivalents per lane (star: DEFAULT)")
    axes.set_ylabel("lowest PSNR of all scenes against float64, dB, 8-bit output")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.suptitle("Stage 3's formats on exact inputs, against the float64 reference")


def draw_sort(figure: Figure, found: dict):
    """Draw the PSNR lost against the exact order and the changed neighbours, for each way."""
    axes = figure.subplots(1, 2)
    names = [name for name in found if name != EXACT_ORDER]
    for number, (scene, exact) in enumerate(found[EXACT_ORDER]["scenes"].items()):
        results = [found[name]["scenes"][scene] for name in names]
        decibels = [result["psnr_db_float64"] or np.nan for result in results]
        lost = [(exact["psnr_db_float64"] or np.nan) - db for db in decibels]
        shares = [result["changed_places"] or np.nan for result in results]  # 0: no point
        for part, values in zip(axes, (lost, shares), strict=True):
            part.plot(names, values, marker="o", color=f"C{number % 10}", label=scene)
    axes[0].set_title("PSNR lost against the exact order, dB, 8-bit output")
    axes[1].set_title("Share of neighbouring entries that changed places")
    axes[1].set_yscale("log")
    axes[0].legend(frameon=False)
    for part in axes:
        part.tick_params("x", rotation=40)
        part.grid(alpha=0.3)
    figure.suptitle("Order by depth keys of fewer bits, on exact inputs")


class Stage(NamedTuple):
    """Measurement of a stage's formats; its plot, and the plot's size in inches."""

    errors: Callable[[dict[str, View]], dict]
    draw: Callable[[Figure, dict], None]
    inches: tuple[float, float]


STAGES = {
    "sort": Stage(sort_errors, draw_sort, (13, 5.5)),
    "raster": Stage(raster_errors, draw_raster, (9, 6)),
}


def write_plot(stage: str, found: dict, path: str | Path):
    """Plot the errors of a stage."""
    figure = Figure(STAGES[stage].inches, 150, layout="constrained")
    STAGES[stage].draw(figure, found)
    write_figure(path, figure)
