"""The report's section of power: the estimate by stage beside the paper's table."""

from collections.abc import Iterator

from splatcore.sim.common.paper import FPS, MEMORY_POWER
from splatcore.sim.report.page import MILLION, THOUSAND, Card, Column, Item, Table
from splatcore.sim.report.results import Results

MILLI = 1e-3


def stages(results: Results) -> Iterator[Item]:
    """mW by stage and of memories, as `splatcore power` has estimated them."""
    facts = results.facts("power")
    fps, paper = facts["fps"], facts["paper"]
    rows = []
    for stage, logic in facts["stages"].items():
        watts = (logic["switching"] + logic["clock"]) * fps + logic["leakage"]
        rows.append([
            stage, logic["nand2"] / THOUSAND, 100 * logic["activity"], watts / MILLI,
            milli(paper["logic_w"].get(stage)),
        ])  # fmt: skip
    for stage, memory in facts["stage_memories"].items():
        watts = memory["access"] * fps + memory["leakage"]
        name, _ = MEMORY_POWER.get(stage, (None, None))
        text = f"memories of {stage}" + (f"; the paper's: {name}" if name else "")
        rows.append([text, None, None, watts / MILLI, milli(paper["memory_w"].get(name))])
    rows.append(["all, estimate", None, None, facts["power_w"] / MILLI, milli(paper["power_w"])])
    strong = {len(rows) - 1}
    rows.append(["DRAM, estimate, apart", None, None, facts["dram_w"] / MILLI, None])
    size = "×".join(map(str, facts["size"]))
    what = f"{facts['scene']} at {size}, {fps:.1f} frames a second, preset {facts['preset']}"
    yield Table(
        "power",
        f"Estimated power of {what}; the paper's is of its own scenes at {FPS} frames a "
        f"second, by gate-level simulation. Ours: {facts['power_w'] / fps / MILLI:.3f} mJ a frame, "
        f"{facts['pixels_per_j'] / MILLION:,.0f} Mpixels/J (an estimate) without DRAM.",
        [
            Column("of"), Column("gates", "k NAND2", 1, none=""),
            Column("activity", "%", 2, none=""),
            Column("estimate", "mW", 2), Column("the paper", "mW", 2),
        ],
        rows, ("power",), frozenset(strong),
    )  # fmt: skip
    yield Card(
        "How large",
        f"≈ {facts['power_w'] / MILLI:,.0f} mW",
        f"an estimate, first order: {what}; the paper: {milli(paper['power_w']):.0f} mW at {FPS}",
    )


def milli(watts: float | None) -> float | None:
    """W in mW."""
    return None if watts is None else watts / MILLI


BLOCKS = (stages,)
