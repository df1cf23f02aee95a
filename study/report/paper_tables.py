"""Comparison with the paper's tables: operations of stage 1, gates, memories."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from matplotlib.figure import Figure as Canvas

from splatcore.eda import paper
from splatcore.eda.gates.synth import DEPTH_MAX
from splatcore.sim.common.plot import legend_below, side_by_side
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import DEFAULT, KB, PAPER, Config
from splatcore.spec.microprogram import operation_counts, projection
from splatcore.spec.schedule import pes, schedule
from splatcore.study.report.page import THOUSAND, Card, Item, plotted
from splatcore.study.report.results import Results
from splatcore.study.results.fields import columns, with_names
from splatcore.study.results.machines import Gates

BITS = 8  # of a byte


def operations(_: Results) -> Iterator[Item]:
    """Operation counts of stage 1 with and without products with zeros."""
    rows = [paper_row("with zeros", paper.PES_DENSE, None)]
    rows.append(paper_row("without zeros", paper.PES, paper.PES_BUSY))
    for config in (DEFAULT, PAPER):
        for products, skips in (("with zeros", False), ("without zeros", True)):
            rows.append(own_row(replace(config, skip_zeros=skips), products))
    yield Table(
        "operations",
        "Operations of stage 1 per Gaussian with harmonics of degree 1, with and without products "
        "with the zeros of the Jacobian. Ours multiply by L of Σ = L·Lᵀ from the packed model, "
        "fold camera and focal lengths into constants of the frame, and add extents for binning. "
        "Saved: operations that skipping the zeros saves.",
        [
            Column("machine"), Column("products"), Column("all", "operations", 0),
            Column("×", "", 0), Column("+ and −", "", 0), Column("÷ and √", "", 0),
            Column("clamp, maximum", "", 0), Column("PEs", "", 0),
            Column("cycles", "per Gaussian", 0), Column("PEs busy", "%", 1),
            Column("saved", "% of operations", 1),
        ],
        [
            [*row, None if n % 2 == 0 else 100 * (1 - row[2] / rows[n - 1][2])]
            for n, row in enumerate(rows)
        ],
    )  # fmt: skip
    yield Card(
        "Gain of each idea", f"{rows[2][2]} → {rows[3][2]}",
        "operations of stage 1 per Gaussian without products with zeros; the paper: "
        f"{rows[0][2]} → {rows[1][2]}",
    )  # fmt: skip


def paper_row(products: str, pes: int, busy: float | None) -> list:
    """The paper's counts; it has no counts of clamps and cycles."""
    counts = paper.OPERATIONS[products]
    return [
        "the paper", products, counts["operations"], counts["multiply"],
        counts["add"] + counts["subtract"], counts["divide"], None, pes, None,
        busy and 100 * busy,
    ]  # fmt: skip


def own_row(config: Config, products: str) -> list:
    """Counts of a machine's program for its degree of harmonics."""
    steps = projection(config)
    counts, plan = Counter(operation_counts(steps.steps)), schedule(config, steps)
    units = pes(config, steps)
    return [
        config.name, products, counts.total(), counts["multiply"], counts["add"],
        counts["reciprocal"] + counts["rsqrt"], counts["clamp"] + counts["maximum"], units,
        plan.interval, 100 * plan.utilisation(units),
    ]  # fmt: skip


def gates(results: Results) -> Iterator[Item]:
    """Gates of each stage and part."""
    facts = results.facts("synth")
    top, stages = facts["top"], Counter()
    for part in top["parts"].values():
        stages[part["stage"]] += part["nand2"]
    ratio = top["nand2"] / paper.GATES_ALL
    yield Card(
        "How large", f"{top['nand2'] / THOUSAND:,.0f} k",
        f"NAND2-equivalents without memories, {ratio:.0%} of the paper's "
        f"{paper.GATES_ALL / THOUSAND:,.0f} k",
    )  # fmt: skip

    def draw(figure: Canvas):
        axes = figure.subplots()
        kilo = {
            facts["preset"]: [nand2 / THOUSAND for nand2 in stages.values()],
            "the paper": [paper.GATES.get(s, float("nan")) / THOUSAND for s in stages],
        }
        side_by_side(axes, list(stages), kilo)
        axes.set_xlabel("thousands of NAND2-equivalents")
        legend_below(figure, axes, 2)

    yield plotted(
        "gates-by-stage",
        "Gates by stage, ours and the paper's. The paper has no stage for binning; its four "
        "sorters have 256 entries each and find the maximum of all entries at once.",
        "Bars of each stage, ours and the paper's.",
        1 + 0.34 * len(stages), draw,
    )  # fmt: skip
    rows = []
    for stage, nand2 in stages.items():
        rows.append({"part": stage, "nand2": nand2, "paper": paper.GATES.get(stage)})
        parts = {name: part for name, part in top["parts"].items() if part["stage"] == stage}
        rows += with_names("part", {f"{stage}: {k.replace('_', ' ')}": parts[k] for k in parts})
    rows.append(top | {"part": "all", "paper": paper.GATES_ALL})
    strong = frozenset(n for n, row in enumerate(rows) if "stage" not in row)
    keys = ("count", "nand2", "speed_nand2", "speed_depth", "paper")
    yield Table.of(
        "gates",
        "Gates of the whole machine, with flip-flops and without memories, mapped for area and "
        "for speed. Depth: gates on the longest path between registers, mapped for speed; 800 MHz "
        f"in 28 nm allow {DEPTH_MAX}.",
        [
            Column("part"), *columns(Gates, " ".join(keys[:-1])),
            Column("the paper", "k", 1, none="", get="paper", per=THOUSAND),
        ],
        (dict.fromkeys(keys) | row for row in rows), strong,
    )  # fmt: skip


def memories(results: Results) -> Iterator[Item]:
    """On-chip memories by stage, and the paper's five."""
    facts = results.facts("memories")
    sizes = {
        stage: sum(m["words"] * m["bits"] * m["count"] for m in parts) / BITS / KB
        for stage, parts in facts["stages"].items()
    }
    yield Card(
        "How large", f"{facts['kilobytes']:.1f} KB",
        f"of on-chip memory; the paper: {sum(paper.MEMORIES.values())}",
    )  # fmt: skip
    theirs = paper.MEMORIES | {"all": sum(paper.MEMORIES.values())}
    rows = [[facts["preset"], *size] for size in (*sizes.items(), ("all", facts["kilobytes"]))]
    rows += [["the paper", *size] for size in theirs.items()]
    yield Table(
        "memories",
        "On-chip memories. The paper divides them differently: its lists are stored on chip as far "
        "as they fit, ours are streamed through DRAM.",
        [Column("machine"), Column("memory"), Column("size", "KB", 2)],
        rows, frozenset(n for n, row in enumerate(rows) if row[1] == "all"),
    )  # fmt: skip


BLOCKS = (operations, gates, memories)
