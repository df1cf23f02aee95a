"""The report's section of a frame's work: culling, early termination, density of tiles."""

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Canvas

from splatcore.sim.common import paper
from splatcore.sim.report.page import MILLION, THOUSAND, Column, Item, Table, plotted
from splatcore.sim.report.results import Results
from splatcore.sim.report.scenes import VIEW, count_of
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError

MAPS_IN_A_ROW = 3

MAP_HEIGHT = 1.62
"""Inches of a row of maps with their titles."""


def percent(share: float | None) -> float | None:
    """A share in percent."""
    return None if share is None else 100 * share


COUNTS = {"gaussians": THOUSAND, "projected": THOUSAND, "splats": THOUSAND, "tile_pairs": MILLION}
"""Counts of a view and their units."""

RATES = ("near_rate", "culling_rate", "early_termination_rate", "pe_utilisation")

PAPER = (paper.CULLED, None, paper.TERMINATED, paper.PES_BUSY)
"""Its rates of compressed models, in that order."""

PAPER_UNCOMPRESSED = (paper.CULLED_UNCOMPRESSED, None, paper.TERMINATED_UNCOMPRESSED, None)


def rates(results: Results) -> Iterator[Item]:
    """Counts and rates of each view, the paper's rates first."""
    facts, found = results.rows("work")
    nothing = [None] * len(COUNTS)
    rows = [
        ["the paper, compressed", "", *nothing, *map(percent, PAPER)],
        ["the paper, uncompressed", "", *nothing, *map(percent, PAPER_UNCOMPRESSED)],
    ]
    for row in found:
        counts = [row[key] / unit for key, unit in COUNTS.items()]
        rows.append([row["scene"], row["camera"], *counts, *(percent(row[key]) for key in RATES)])
    means = [100 * sum(row[key] for row in found) / len(found) for key in RATES]
    rows.append(["mean of ours", count_of(found), *nothing, *means])
    yield Table(
        "work",
        f"Work of a frame, {facts['size']}. Behind: Gaussians whose centre is not beyond the near "
        "plane, which is what the paper's culling is about. Not projected: also those beside the "
        "image (guard band). Pairs: of splats and tiles. Ended early: those of them that are not "
        "blended any more, because all pixels of the tile have ended. PEs busy: of stage 1, in all "
        "cycles of the frame. The paper's rates are averages over its own scenes and views.",
        [
            *VIEW, Column("Gaussians", "k", 0, none=""),
            Column("projected", "k", 0, none=""), Column("splats", "k", 0, none=""),
            Column("pairs", "M", 2, none=""), Column("behind", "%", 1),
            Column("not projected", "%", 1), Column("ended early", "%", 1),
            Column("PEs busy", "%", 1),
        ],
        rows, ("work",), frozenset({0, 1, len(rows) - 1}),
    )  # fmt: skip


def density(results: Results) -> Iterator[Item]:
    """Maps of how many splats reach each tile, each scene's densest view, all on one scale."""
    facts, found = results.rows("work")
    densest: dict[str, tuple[str, np.ndarray]] = {}
    for row in found:
        name = f"{row['scene']} {row['camera']}"
        tiles = np.array(facts["density"][name])
        if tiles.ndim != 2 or not tiles.size:
            raise InputError(f"{facts.file}: density.{name}: is no table of tiles")
        if row["scene"] not in densest or tiles.mean() > densest[row["scene"]][1].mean():
            densest[row["scene"]] = name, tiles
    maps = dict(densest.values())
    rows = math.ceil(len(maps) / MAPS_IN_A_ROW)
    most = max(int(tiles.max()) for tiles in maps.values())
    norm = LogNorm(1, max(2, most))

    def draw(figure: Canvas):
        grid = figure.subplots(rows, MAPS_IN_A_ROW, squeeze=False).ravel()
        for axes in grid:
            axes.set_axis_off()
        for axes, (name, tiles) in zip(grid, maps.items(), strict=False):
            shown = axes.imshow(
                np.ma.masked_equal(tiles, 0), cmap="viridis", norm=norm, interpolation="nearest"
            )
            axes.set_title(name, fontsize=8, loc="left")
        bar = figure.colorbar(
            shown, ax=list(grid), orientation="horizontal", shrink=0.6, aspect=45, pad=0.02
        )
        bar.set_label(f"splats in a tile of {TILE}×{TILE} pixels")
        bar.ax.xaxis.set_major_formatter("{x:,g}")

    yield plotted(
        "density",
        f"Length of each tile's list, {facts['size']}, the densest view of each "
        f"scene, on one logarithmic scale up to {most:,}; tiles without a splat are white. "
        f"The paper's map of bicycle has about {paper.LIST:,} in most tiles and up to "
        f"{paper.LIST_MAX:,}.",
        f"Heat maps of {len(maps)} views.",
        0.9 + MAP_HEIGHT * rows, draw, "work",
    )  # fmt: skip


BLOCKS = (rates, density)
