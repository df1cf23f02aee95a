"""Output of a power estimate: table by stage with the paper's figures, text, JSON object."""

from dataclasses import asdict

from splatcore.eda.paper import LOGIC, MEMORY_POWER, PIXELS_PER_JOULE, POWER
from splatcore.eda.power.activity import SAMPLE_LENGTH, Counts
from splatcore.eda.power.estimate import FEMTO, STAGE_OF, Estimate, Logic, sum_of
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.energy import Energy

MILLI, MEGA = 1e-3, 1e6

COLUMNS = (
    Column("mW; fJ per NAND2 and cycle", get="name"),
    Column("NAND2 k", digits=1, get="nand2", per=1000, none=""),
    Column(
        "activity", digits=2, get=lambda row: f"{row['activity']:.2%}" if "nand2" in row else ""
    ),
    Column("gates", digits=2, get="switching", per=MILLI, none=""),
    Column("clock", digits=2, per=MILLI, none=""),
    Column("ungated", digits=2, get="clock_always", per=MILLI, none=""),
    Column("mW", digits=2, get="power", per=MILLI, none=""),
    Column("paper", digits=2, per=MILLI, none=""),
    Column("fJ", digits=3, get="femto", none=""),
    Column("paper", digits=3, get="paper_femto", none=""),
)
"""Columns of the table; powers in W, 0 is empty; fJ are per NAND2-equivalent and cycle."""

POWERS = ("switching", "clock", "clock_always", "power", "paper")


def table(found: Estimate, fps: float, title: str) -> Table:
    """Table of mW by stage, for logic and memories."""
    rows = [
        {"name": stage} | _logic(logic, found.cycles, fps, *LOGIC.get(stage, (0, 0)))
        for stage, logic in found.stages.items()
    ]
    for stage, memory in found.stage_memories.items():
        name, paper = MEMORY_POWER.get(stage, ("", 0))
        name = f"memories, {stage}" + (f"; paper: {name}" if name else "")
        rows.append({"name": name, "power": memory.access * fps + memory.leakage, "paper": paper})
    nand2, paper = (sum(each) for each in zip(*LOGIC.values(), strict=True))
    every = sum_of(list(found.stages.values()))
    strong = frozenset((len(rows), len(rows) + 1))
    rows.append({"name": "all logic"} | _logic(every, found.cycles, fps, nand2, paper))
    rows.append({"name": "all", "power": found.power(fps), "paper": POWER})
    rows.append({"name": "DRAM, not included", "power": sum(found.dram.values()) * fps})
    for row in rows:
        row |= {key: row.get(key) or None for key in POWERS}
    return Table.of("power", title, COLUMNS, rows, strong)


def _logic(logic: Logic, cycles: int, fps: float, nand2: float, paper: float) -> dict:
    """A stage's row. nand2, paper: NAND2-equivalents and W of the paper's stage."""
    return {
        "nand2": logic.nand2, "activity": logic.activity, "switching": logic.switching * fps,
        "clock": logic.clock * fps, "clock_always": logic.clock_always * fps,
        "power": logic.frame * fps + logic.leakage, "paper": paper,
        "femto": logic.frame / (logic.nand2 * cycles) / FEMTO,
        "paper_femto": implied(nand2, paper) if nand2 else None,
    }  # fmt: skip


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
        "No hazards, no layout; constants: spec/energy.py. Ungated: the clock without clock gates.",
    ]


COSTLY = 20

COST_COLUMNS = (
    Column("register or memory", get="name"),
    Column("part"),
    Column("bits", digits=0),
    Column("clocked; accesses per cycle", digits=2, get="uses"),
    Column("mW", digits=3, get="power", per=MILLI),
)


def costs(found: Estimate, counts: Counts, energy: Energy, fps: float) -> dict:
    """Print the `COSTLY` registers and memories that take the most power; return them for JSON.

    A register's power is that of its clock, if gated by its own enable, and of its changes.
    """
    rows = []
    for name, each in counts.registers.items():
        share = sum(each.loads) / len(each.loads)
        clock = share * each.bits * counts.cycles * energy.clock
        power = (clock + each.changes * energy.switching) * FEMTO * fps
        rows.append({
            "name": name, "part": each.part, "bits": each.bits, "uses": share, "power": power
        })  # fmt: skip
    for each in counts.memories:
        memory = found.memories[each.path, STAGE_OF[each.part]]
        uses = (each.reads + each.writes) / counts.cycles
        power = memory.access * fps + memory.leakage
        rows.append({
            "name": each.path, "part": each.part, "bits": each.words * each.bits, "uses": uses,
            "power": power,
        })  # fmt: skip
    rows = sorted(rows, key=lambda row: row["power"], reverse=True)[:COSTLY]
    Table.of("costs", "registers and memories that take the most power", COST_COLUMNS, rows).print()
    return {"costs": rows}


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
