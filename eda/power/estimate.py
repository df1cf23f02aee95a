"""First-order ESTIMATE of power: switching of a frame times the energies of `spec.energy`.

Energy of a part's gates per cycle: activity × energy if all nets change once. The latter is
NAND2-equivalents × energy of a switching NAND2, or comes from the cells of a library
(`eda.power.cells`). Activity is measured in RTL, as changes per bit and cycle of the part's nets,
which stand for the nets of the synthesised gates. Both are rough: RTL has nets that synthesis
removes (constants, and several names of one wire), gates have more nets than RTL, and hazards are
left out. Flip-flops are clocked while their clock gate is open (`eda.power.clocks`), those without
one and the gates themselves in every cycle of a frame. Memories take energy only when they are read
or written.
"""

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

from splatcore.eda.gates.machine_gates import PARTS, Size
from splatcore.eda.power.activity import Counts
from splatcore.eda.power.clocks import Clocked
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.energy import Energy

FEMTO, PICO, NANO = 1e-15, 1e-12, 1e-9

STAGE_OF = {part.name: part.stage for part in PARTS}

STAGES = tuple(dict.fromkeys(STAGE_OF.values()))


class Gates(NamedTuple):
    """A part.

    change: J if all its nets change once
    clock: J per cycle in which all its flip-flops are clocked
    gates_clock: J per cycle of its clock gates
    leakage: W
    """

    nand2: float
    flip_flops: int
    change: float
    clock: float
    gates_clock: float
    leakage: float


@dataclass(frozen=True)
class Logic:
    """A part or a stage.

    activity: changes per bit and cycle
    switching, clock: J per frame
    clock_always: J per frame if all flip-flops were clocked in each cycle, without clock gates
    leakage: W
    """

    nand2: float
    flip_flops: int
    activity: float
    switching: float
    clock: float
    clock_always: float
    leakage: float

    @property
    def frame(self) -> float:
        """J per frame, without leakage."""
        return self.switching + self.clock


@dataclass(frozen=True)
class Memory:
    """A memory, or all memories of a stage. access: J per frame; leakage: W."""

    kilobits: float
    reads: float
    writes: float
    access: float
    leakage: float


@dataclass(frozen=True)
class Estimate:
    """J per frame and W of leakage: logic by part, memories by (path, stage), DRAM by cause."""

    cycles: int
    pixels: int
    logic: dict[str, Logic]
    memories: dict[tuple[str, str], Memory]
    dram: dict[str, float]

    @property
    def stages(self) -> dict[str, Logic]:
        """Logic by stage; a stage's activity is its mean per NAND2."""
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
        """J per frame on the chip, without leakage."""
        return sum(part.frame for part in self.logic.values()) + sum(
            memory.access for memory in self.memories.values()
        )

    @property
    def leakage(self) -> float:
        """W of the whole chip."""
        return sum(part.leakage for part in (*self.logic.values(), *self.memories.values()))

    @property
    def fps_max(self) -> float:
        """Frames per second at full speed."""
        return CLOCK_HZ / self.cycles

    def power(self, fps: float) -> float:
        """W of the chip at `fps` frames per second. The clock is stopped between frames."""
        return self.frame * fps + self.leakage

    def pixels_per_joule(self, fps: float, with_dram: bool) -> float:
        """Pixels per joule at `fps` frames per second."""
        dram = sum(self.dram.values()) if with_dram else 0.0
        return self.pixels / (self.power(fps) / fps + dram)


def by_stage(found: Iterable[tuple[str, Any]]) -> dict[str, list]:
    """Group items by stage, in the order of `STAGES`."""
    stages = {stage: [] for stage in STAGES}
    for stage, item in found:
        stages[stage].append(item)
    return {stage: items for stage, items in stages.items() if items}


def gates_of(sizes: Iterable[Size], energy: Energy) -> dict[str, Gates]:
    """Parts with energies of plain gates; a clock gate's clock counts as a flip-flop's.

    sizes: from synthesis, mapped for area
    """
    return {
        size.part.name: Gates(
            size.nand2, size.flip_flops, size.nand2 * energy.switching * FEMTO,
            size.flip_flops * energy.clock * FEMTO, size.clock_gates * energy.clock * FEMTO,
            size.nand2 * energy.gate_leakage * NANO,
        )
        for size in sizes
    }  # fmt: skip


def estimate(
    counts: Counts, gates: dict[str, Gates], clocks: dict[str, Clocked], energy: Energy
) -> Estimate:
    """Estimate energy and leakage of a frame.

    gates, clocks: by part, the same parts as in `counts`
    """
    if set(gates) != set(counts.parts):
        raise ValueError(f"parts with only sizes or counts: {set(gates) ^ set(counts.parts)}")
    logic = {}
    for name, part in gates.items():
        found = counts.parts[name]
        changes = found.changes / found.bits
        logic[name] = Logic(
            part.nand2, part.flip_flops, changes / counts.cycles,
            changes * part.change,
            counts.cycles * (part.clock * clocks[name].share + part.gates_clock),
            counts.cycles * part.clock, part.leakage,
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
    """Sum of several parts; the activity is the mean per NAND2."""
    nand2, flip_flops, _, *energies = map(sum, zip(*map(astuple, parts), strict=True))
    activity = sum(part.activity * part.nand2 for part in parts) / nand2
    return Logic(nand2, flip_flops, activity, *energies)
