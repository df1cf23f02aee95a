"""Output of a power estimate: table by stage with the paper's figures, text, JSON object."""

from dataclasses import asdict

from rich.table import Table

from splatcore.eda.paper import LOGIC, MEMORY_POWER, PIXELS_PER_JOULE, POWER
from splatcore.eda.power.activity import SAMPLE_LENGTH, Counts
from splatcore.eda.power.estimate import FEMTO, Estimate, Logic, sum_of
from splatcore.sim.common.table import new_table
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.energy import Energy

MILLI, MEGA = 1e-3, 1e6

HEADINGS = ("NAND2 k", "activity", "gates", "clock", "mW", "paper", "fJ", "paper")
"""Columns of the table; fJ are per NAND2-equivalent and cycle."""

NOTHING = [""] * 4  # empty cells of the columns before mW


def table(found: Estimate, fps: float, title: str) -> Table:
    """Table of mW by stage, for logic and memories."""
    made = new_table("mW; fJ per NAND2 and cycle", HEADINGS, title)
    for stage, logic in found.stages.items():
        made.add_row(stage, *_logic(logic, found.cycles, fps, *LOGIC.get(stage, (0, 0))))
    for stage, memory in found.stage_memories.items():
        name, paper = MEMORY_POWER.get(stage, ("", 0))
        made.add_row(
            f"memories, {stage}" + (f"; paper: {name}" if name else ""), *NOTHING,
            _milli(memory.access * fps + memory.leakage), _milli(paper),
        )  # fmt: skip
    nand2, paper = (sum(each) for each in zip(*LOGIC.values(), strict=True))
    every = sum_of(list(found.stages.values()))
    made.add_row("all logic", *_logic(every, found.cycles, fps, nand2, paper), style="bold")
    made.add_row("all", *NOTHING, _milli(found.power(fps)), _milli(POWER), style="bold")
    made.add_row("DRAM, not included", *NOTHING, _milli(sum(found.dram.values()) * fps))
    return made


def _milli(watts: float) -> str:
    return f"{watts / MILLI:,.2f}" if watts else ""


def _logic(logic: Logic, cycles: int, fps: float, nand2: float, paper: float) -> tuple[str, ...]:
    """Cells of a stage. nand2, paper: NAND2-equivalents and W of the paper's stage."""
    femto = logic.frame / (logic.nand2 * cycles) / FEMTO
    return (
        f"{logic.nand2 / 1000:,.1f}", f"{logic.activity:.2%}",
        _milli(logic.switching * fps), _milli(logic.clock * fps),
        _milli(logic.frame * fps + logic.leakage), _milli(paper),
        f"{femto:.3f}", f"{implied(nand2, paper):.3f}" if nand2 else "",
    )  # fmt: skip


def implied(nand2: float, watts: float) -> float:
    """fJ per NAND2-equivalent and cycle at 800 MHz that a power in W implies."""
    return watts / (nand2 * CLOCK_HZ) / FEMTO


def lines(found: Estimate, fps: float) -> list[str]:
    """Lines below the table: energy per frame, pixels per joule, limits of the estimate."""
    dram = sum(found.dram.values())
    with_dram, chip = (found.pixels_per_joule(fps, k) / MEGA for k in (True, False))
    return [
        f"An ESTIMATE. Per frame: {found.cycles:,} cycles, {found.power(fps) / fps / MILLI:.3f} mJ "
        f"(leakage {found.leakage / fps / MILLI:.3f} of it), DRAM {dram / MILLI:.3f} mJ.",
        f"Mpixels/J: {chip:,.0f}, with DRAM {with_dram:,.0f}; the paper's "
        f"{PIXELS_PER_JOULE / MEGA:,.0f} without.",
        "No clock gates, no hazards, no layout; constants: spec/energy.py.",
    ]


def report(found: Estimate, counts: Counts, energy: Energy, fps: float) -> dict:
    """JSON object of an estimate, in J and W."""
    power = found.power(fps)
    return {
        "estimate": "first order, from the activity of nets in RTL",
        "fps": fps, "cycles": found.cycles,
        "sampling": {
            "window_cycles": SAMPLE_LENGTH, "one_in": counts.sample_every,
            "simulated_cycles": counts.simulated, "counted_cycles": counts.counted,
        },
        "power_w": power, "leakage_w": found.leakage, "frame_j": power / fps,
        "dram_w": sum(found.dram.values()) * fps, "dram_frame_j": found.dram,
        "pixels_per_j": found.pixels_per_joule(fps, False),
        "pixels_per_j_with_dram": found.pixels_per_joule(fps, True),
        "stages": {name: asdict(logic) for name, logic in found.stages.items()},
        "stage_memories": {name: asdict(memory) for name, memory in found.stage_memories.items()},
        "parts": {
            name: asdict(logic) | asdict(counts.parts[name]) for name, logic in found.logic.items()
        },
        "memories": {
            path: {"stage": stage} | asdict(memory)
            for (path, stage), memory in found.memories.items()
        },
        "traffic_bytes": counts.traffic,
        "constants": asdict(energy)
        | {"switching_fj": energy.switching, "clock_fj": energy.clock, "dram_pj": energy.dram_byte},
        "paper": {
            "power_w": POWER,
            "logic_w": {name: watts for name, (_, watts) in LOGIC.items()},
            "logic_fj": {name: implied(*found) for name, found in LOGIC.items()},
            "memory_w": {name: watts for _, (name, watts) in MEMORY_POWER.items()},
        },
    }  # fmt: skip
