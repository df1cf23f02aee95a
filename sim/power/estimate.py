"""Power, first order, an ESTIMATE: what a frame switches, times the energies of `spec.energy`.

A part's gates take activity × what they take if all change once, for each cycle: its
NAND2-equivalents × energy of a switching NAND2, or what a library says of its cells
(`sim.power.cells`). Its activity is that of its nets in RTL, changes for each bit and cycle, which
stand for the nets of gates that synthesis makes of them. Both are rough: RTL has nets that
synthesis takes out (constants and names of the same wire, which count more than once), gates have
more nets than RTL, and hazards are left out. Flip-flops are clocked in each cycle of a frame, as
there are no clock gates; memories take energy when they are read or written only.
"""

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

from splatcore.sim.eda.machine_gates import PARTS, Size
from splatcore.sim.power.activity import Counts
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.energy import Energy

FEMTO, PICO, NANO = 1e-15, 1e-12, 1e-9

STAGE_OF = {part.name: part.stage for part in PARTS}

STAGES = tuple(dict.fromkeys(STAGE_OF.values()))


class Gates(NamedTuple):
    """A part. change: J if all its nets change once; clock: J of a cycle; leakage: W."""

    nand2: float
    flip_flops: int
    change: float
    clock: float
    leakage: float


@dataclass(frozen=True)
class Logic:
    """A part or a stage. activity: changes of a net's bit in a cycle; switching, clock: J of a
    frame; leakage: W."""

    nand2: float
    flip_flops: int
    activity: float
    switching: float
    clock: float
    leakage: float

    @property
    def frame(self) -> float:
        """J of a frame, without leakage."""
        return self.switching + self.clock


@dataclass(frozen=True)
class Memory:
    """A memory, or those of a stage. access: J of a frame; leakage: W."""

    kilobits: float
    reads: float
    writes: float
    access: float
    leakage: float


@dataclass(frozen=True)
class Estimate:
    """J of a frame and W of leakage: logic by part, memories by (path, stage), DRAM by cause."""

    cycles: int
    pixels: int
    logic: dict[str, Logic]
    memories: dict[tuple[str, str], Memory]
    dram: dict[str, float]

    @property
    def stages(self) -> dict[str, Logic]:
        """Logic by stage; a stage's activity is that of its mean NAND2."""
        stages = by_stage((STAGE_OF[name], logic) for name, logic in self.logic.items())
        return {stage: sum_of(parts) for stage, parts in stages.items()}

    @property
    def stage_memories(self) -> dict[str, Memory]:
        """Memories by stage."""
        stages = by_stage((stage, memory) for (_, stage), memory in self.memories.items())
        return {
            stage: Memory(*map(sum, zip(*map(astuple, memories), strict=True)))
            for stage, memories in stages.items()
        }

    @property
    def frame(self) -> float:
        """J of a frame on the chip, without leakage."""
        return sum(part.frame for part in self.logic.values()) + sum(
            memory.access for memory in self.memories.values()
        )

    @property
    def leakage(self) -> float:
        """W of all of the chip."""
        return sum(part.leakage for part in (*self.logic.values(), *self.memories.values()))

    @property
    def fps_max(self) -> float:
        """Frames a second at full speed."""
        return CLOCK_HZ / self.cycles

    def power(self, fps: float) -> float:
        """W of the chip at so many frames a second. Between frames the clock stands still."""
        return self.frame * fps + self.leakage

    def pixels_per_joule(self, fps: float, with_dram: bool) -> float:
        """Pixels that a joule makes."""
        dram = sum(self.dram.values()) if with_dram else 0.0
        return self.pixels / (self.power(fps) / fps + dram)


def by_stage(found: Iterable[tuple[str, Any]]) -> dict[str, list]:
    """Items of each stage, in the order of `STAGES`."""
    stages = {stage: [] for stage in STAGES}
    for stage, item in found:
        stages[stage].append(item)
    return {stage: items for stage, items in stages.items() if items}


def gates_of(sizes: Iterable[Size], energy: Energy) -> dict[str, Gates]:
    """Parts as synthesis has found them, mapped for area."""
    return {
        size.part.name: Gates(
            size.nand2, size.flip_flops, size.nand2 * energy.switching * FEMTO,
            size.flip_flops * energy.clock * FEMTO, size.nand2 * energy.gate_leakage * NANO,
        )
        for size in sizes
    }  # fmt: skip


def estimate(counts: Counts, gates: dict[str, Gates], energy: Energy) -> Estimate:
    """Energy and leakage of a frame. gates: by part, as many as `counts` has."""
    if set(gates) != set(counts.parts):
        raise ValueError(f"sizes and counts of other parts: {set(gates) ^ set(counts.parts)}")
    logic = {}
    for name, part in gates.items():
        found = counts.parts[name]
        changes = found.changes / found.bits
        logic[name] = Logic(
            part.nand2, part.flip_flops, changes / counts.cycles,
            changes * part.change, counts.cycles * part.clock, part.leakage,
        )  # fmt: skip
    memories = {}
    for found in counts.memories:
        accesses, bits = found.reads + found.writes, found.words * found.bits
        memories[found.path, STAGE_OF[found.part]] = Memory(
            bits / 1024, found.reads, found.writes,
            access=accesses * energy.access(found.words, found.bits) * FEMTO,
            leakage=bits * energy.memory_leakage * NANO,
        )  # fmt: skip
    dram = {cause: bytes * energy.dram_byte * PICO for cause, bytes in counts.traffic.items()}
    return Estimate(counts.cycles, counts.pixels, logic, memories, dram)


def sum_of(parts: list[Logic]) -> Logic:
    """Parts together; their activity is that of the mean NAND2."""
    nand2, flip_flops, _, *energies = map(sum, zip(*map(astuple, parts), strict=True))
    activity = sum(part.activity * part.nand2 for part in parts) / nand2
    return Logic(nand2, flip_flops, activity, *energies)
