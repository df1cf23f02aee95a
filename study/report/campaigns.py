"""The report's sections on the ablation (frames per second as savings are added) and on the work
per frame: culling, early termination, density of tiles."""

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Canvas

from splatcore.eda import paper
from splatcore.sim.common.plot import legend_below, plain_ticks, side_by_side
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError
from splatcore.study.report.page import MILLION, THOUSAND, Card, Column, Item, Table, plotted
from splatcore.study.report.results import Facts, Results
from splatcore.study.report.scenes import AGAINST_RTL, VIEW, against_rtl, count_of, names

PAPER = "the paper"

View = tuple[str, str]  # scene and camera


def by_view(results: Results) -> tuple[Facts, dict[View, dict[str, Facts]]]:
    """The ablation, and its rows by view and step."""
    facts, rows = results.rows("ablation")
    found: dict[View, dict[str, Facts]] = {}
    for row in rows:
        found.setdefault((row["scene"], row["camera"]), {})[row["step"]] = row
    return facts, found


def gains(values: list[float | None]) -> list[float | None]:
    """The gain of each step over the step before; None if either value is missing.

    The paper has no value for steps of our own: these are skipped in its row.
    """
    found, before = [], None
    for value in values:
        found.append(value / before if value and before else None)
        before = value or before
    return found


def speeds(results: Results) -> Iterator[Item]:
    """Frames per second and gains by step."""
    facts, found = by_view(results)
    steps = [step["name"] for step in facts["steps"]]
    rows = [[PAPER, "", *(step["paper_fps"] for step in facts["steps"])]]
    rows += [[*view, *(_fps(row.get(step)) for step in steps)] for view, row in found.items()]
    yield Table(
        "ablation",
        f"Frames per second at 800 MHz as savings are switched on from left to right, "
        f"{facts['size']}, by the cycle model. The guard band (Gaussians outside the image are "
        "dropped before projection) is a step of our own.",
        [*VIEW, *(Column(step, "FPS", 1) for step in steps)],
        rows, ("ablation",), frozenset({0}),
    )  # fmt: skip
    factors = [[*row[:2], *gains(row[2:])[1:], *gains([row[2], row[-1]])[1:]] for row in rows]
    yield Table(
        "ablation-gains",
        "Gain in frames per second of each step over the step before. A step gains only if it "
        "shortens the slower half of the frame.",
        [*VIEW, *(Column(step, "×", 2) for step in steps[1:]), Column("all together", "×", 2)],
        factors, ("ablation",), frozenset({0}),
    )  # fmt: skip
    whole = [row[-1] for row in factors[1:] if row[-1]]
    if whole:
        mean = math.exp(sum(map(math.log, whole)) / len(whole))
        paper = f"; the paper: {factors[0][-1]:.1f} ×" if factors[0][-1] else ""
        yield Card(
            "Gain of each idea", f"{mean:.1f} ×",
            f"frames per second with all savings, geometric mean of {count_of(whole)}{paper}",
        )  # fmt: skip


def _fps(row: Facts | None) -> float | None:
    return row and row["fps_at_800mhz"]


def bars(results: Results) -> Iterator[Item]:
    """Grouped bars of frames per second, the paper's first."""
    facts, found = by_view(results)
    labels = [PAPER, *names([next(iter(by_step.values())) for by_step in found.values()])]
    lengths = {
        step["name"]: [
            fps or math.nan
            for fps in (step["paper_fps"], *(_fps(row.get(step["name"])) for row in found.values()))
        ]
        for step in facts["steps"]
    }

    def draw(figure: Canvas):
        axes = figure.subplots()
        side_by_side(axes, labels, lengths)
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_xscale("log")
        plain_ticks(axes.xaxis, (1, 2, 5))
        axes.set_xlabel("frames per second at 800 MHz, logarithmic")
        legend_below(figure, axes, 3)

    yield plotted(
        "ablation-bars",
        "Frames per second (x axis, logarithmic) by view, the paper's own first; one bar per step, "
        "in the colours of the legend, each with all savings of the bars above it.",
        f"Grouped bars of {len(labels)} views, one for each of {len(lengths)} steps.",
        1.2 + 0.42 * len(labels), draw, "ablation",
    )  # fmt: skip


def simulated(results: Results) -> Iterator[Item]:
    """Steps that were simulated in RTL."""
    facts, found = by_view(results)
    rows = [
        [*view, step, *against_rtl(row["cycles"]["frame"], row["rtl_cycles"], row["rtl_identical"])]
        for view, by_step in found.items()
        for step, row in by_step.items()
        if row["rtl_cycles"]
    ]
    if rows:
        yield Table(
            "ablation-rtl",
            f"Steps simulated in RTL, {facts['size']}: cycles per frame by the cycle model and in "
            "RTL. Identical: every bit of the picture equals the golden model's.",
            [*VIEW, Column("step"), *AGAINST_RTL], rows, ("ablation",),
        )  # fmt: skip


ABLATION = (bars, speeds, simulated)


MAPS_IN_A_ROW = 3

MAP_HEIGHT = 1.62  # inches per row of maps, with titles


COUNTS = {"gaussians": THOUSAND, "projected": THOUSAND, "splats": THOUSAND, "tile_pairs": MILLION}
"""Counts of a view and their units."""

RATES = ("near_rate", "culling_rate", "early_termination_rate", "pe_utilisation")

RATES_PAPER = (paper.CULLED, None, paper.TERMINATED, paper.PES_BUSY)
"""The paper's rates for compressed models, in the order of `RATES`."""

RATES_UNCOMPRESSED = (paper.CULLED_UNCOMPRESSED, None, paper.TERMINATED_UNCOMPRESSED, None)


def rates(results: Results) -> Iterator[Item]:
    """Counts and rates of each view, the paper's rates first."""
    facts, found = results.rows("work")
    nothing = [None] * len(COUNTS)
    rows = [
        [f"the paper, {kind}", "", *nothing, *(rate and 100 * rate for rate in rates)]
        for kind, rates in (("compressed", RATES_PAPER), ("uncompressed", RATES_UNCOMPRESSED))
    ]
    for row in found:
        counts = [row[key] / unit for key, unit in COUNTS.items()]
        rows.append([row["scene"], row["camera"], *counts, *(100 * row[key] for key in RATES)])
    means = [100 * sum(row[key] for row in found) / len(found) for key in RATES]
    rows.append(["mean of ours", count_of(found), *nothing, *means])
    yield Table(
        "work",
        f"Work per frame, {facts['size']}. Behind: Gaussians with their centre not in front of the "
        "near plane (the paper's culling). Not projected: also Gaussians outside the image (guard "
        "band). Pairs: of a splat and a tile. Ended early: pairs that are not blended because all "
        "pixels of the tile have terminated. PEs busy: share of all cycles of the frame in which a "
        "PE of stage 1 works. The paper's rates are averages over its own scenes and views.",
        [
            *VIEW, Column("Gaussians", "k", 0, none=""),
            Column("projected", "k", 0, none=""), Column("splats", "k", 0, none=""),
            Column("pairs", "M", 2, none=""), Column("behind", "%", 1),
            Column("not projected", "%", 1), Column("ended early", "%", 1),
            Column("PEs busy", "%", 1),
        ],
        rows, ("work",), frozenset({0, 1, len(rows) - 1}),
    )  # fmt: skip


def densest(facts: Facts, rows: list[Facts]) -> dict[str, np.ndarray]:
    """Splats per tile of each scene's densest view, by view; kept results have only these."""
    found: dict[str, tuple[str, np.ndarray]] = {}
    for row in rows:
        name = f"{row['scene']} {row['camera']}"
        if name not in facts["density"]:
            continue
        tiles = np.array(facts["density"][name])
        if tiles.ndim != 2 or not tiles.size:
            raise InputError(f"{facts.file}: density.{name}: not a table of tiles")
        if row["scene"] not in found or tiles.mean() > found[row["scene"]][1].mean():
            found[row["scene"]] = name, tiles
    if not found:
        raise InputError(f"{facts.file}: density: has no data for these scenes")
    return dict(found.values())


def density(results: Results) -> Iterator[Item]:
    """Maps of splats per tile, for each scene's densest view, on one common scale."""
    facts, found = results.rows("work")
    maps = densest(facts, found)
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
        bar.set_label(f"splats per tile of {TILE}×{TILE} pixels, logarithmic")
        bar.ax.xaxis.set_major_formatter("{x:,g}")

    yield plotted(
        "density",
        f"Splats per tile (the length of the tile's list), {facts['size']}, in the densest view of "
        f"each scene. Colours: one logarithmic scale up to {most:,}; tiles without splats are "
        f"white. The paper's map of bicycle has about {paper.LIST:,} in most tiles and up to "
        f"{paper.LIST_MAX:,}.",
        f"Heat maps of {len(maps)} views.",
        0.9 + MAP_HEIGHT * rows, draw, "work",
    )  # fmt: skip


WORK = (rates, density)
