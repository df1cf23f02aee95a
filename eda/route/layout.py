"""A picture of a routed layout: cells, and wires by layer."""

import io
from pathlib import Path

from PIL import Image

from splatcore.eda.route.lef import Lef
from splatcore.eda.route.routed import Routed
from splatcore.sim.common.output import write

COLOURS = ("#1f4e99", "#d1495b", "#2e8b57", "#e0a100", "#7a4ea3")  # of the layers, lowest first
CELL, FLIP_FLOP = "#eceff1", "#b9cfe4"
INCHES, DOTS_PER_INCH = 6.0, 150
PALETTE = 64  # colours of the file: a third of its bytes


def write_layout(path: Path, title: str, routed: Routed, lef: Lef, flip_flops: set[str]):
    """Write a layout as PNG. flip_flops: kinds of cells that are drawn darker."""
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, Rectangle

    figure = Figure(figsize=(INCHES, INCHES), layout="constrained")
    axes = figure.subplots()
    for dark, colour in ((False, CELL), (True, FLIP_FLOP)):
        boxes = [
            Rectangle((x, y), *lef.sizes[kind])
            for kind, x, y in routed.cells.values()
            if (kind in flip_flops) == dark
        ]
        axes.add_collection(
            PatchCollection(boxes, facecolor=colour, edgecolor="white", linewidth=0.2)
        )
    for layer, colour in zip(lef.layers, COLOURS, strict=False):
        lines = [
            ends for wires in routed.wires.values() for name, *ends in wires if name == layer.name
        ]
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.3, antialiased=False))
    left, bottom, right, top = routed.area
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", title=title)
    axes.set(xlabel="µm", ylabel="µm")
    keys = [Patch(color=CELL, label="logic"), Patch(color=FLIP_FLOP, label="flip-flops")]
    keys += [
        Line2D([], [], color=colour, label=layer.name)
        for layer, colour in zip(lef.layers, COLOURS, strict=False)
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), fontsize=7)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH)
    small = io.BytesIO()
    Image.open(buffer).convert("RGB").quantize(PALETTE, Image.Quantize.MAXCOVERAGE).save(
        small, "PNG", optimize=True
    )
    write(path, small.getvalue())
