"""Sweep of stage 3's number formats: error on exact inputs against gates per lane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from splatcore.eda.gates.synth import area
from splatcore.golden.exact import as_packed, entries_of, features_of
from splatcore.golden.raster import Entries, rasterize
from splatcore.golden.reference import Splats, project, render
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.frame.shot import View
from splatcore.spec.config import DEFAULT, FORMATS, Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.raster import block_count

EXACT_TITLE = "8-bit pictures on exact inputs, against the float64 reference"

SWEEP = {field: format.tried for field, format in FORMATS.items()}
"""Formats of stage 3, each with the values to try in addition to DEFAULT's."""


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


def raster_errors(views: dict[str, View]) -> dict:
    """Measure all variants on all views.

    Returns {machine: {"gates", "scenes": {scene: {psnr_db_float64, max_error_float64,
    contributions}}}}.
    """
    found = {name: {"scenes": {}} for name in machines()}
    for title, view in views.items():
        splats, entries, image = exact_view(view)
        for name, config in machines().items():
            features = features_of(config, splats)
            raster = rasterize(config, features, entries, image.shape[1::-1])
            error = raster.pixels / 255 - image
            found[name]["scenes"][title] = {
                "psnr_db_float64": psnr_of_square(max(float(np.mean(error**2)), 1e-20)),
                "max_error_float64": float(np.abs(error).max()),
                "contributions": raster.counts["contributions"],
            }
    with progress_bar("synthesising lanes") as advance:
        for done, (name, config) in enumerate(machines().items()):
            advance(done, len(found))
            found[name]["gates"] = lane_gates(config)
    return found


def raster_table(found: dict) -> Table:
    """Table of gates per lane, PSNR of the pictures and largest error in steps of 1/255."""
    names = [Path(scene).name.split(".")[0] for scene in found["DEFAULT"]["scenes"]]
    columns = [Column("stage 3"), Column("gates per lane", digits=0)]
    columns += [Column(f"{name}\ndB, max", digits=1) for name in names]
    rows = []
    for name, facts in found.items():
        cells = (
            f"{result['psnr_db_float64']:.2f}, {result['max_error_float64'] * 255:.1f}"
            for result in facts["scenes"].values()
        )
        rows.append([name, facts["gates"], *cells])
    return Table("raster", EXACT_TITLE, columns, rows)


def write_raster_plot(path: str | Path, found: dict):
    """Plot the lowest PSNR of all scenes against gates per lane, one line per format."""
    figure = Figure((9, 6), 150, layout="constrained")
    axes = figure.subplots()

    def point(name: str) -> tuple[float, float]:
        facts = found[name]
        return facts["gates"], min(result["psnr_db_float64"] for result in facts["scenes"].values())

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
    write_figure(path, figure)
