"""Switching activity in RTL simulation: changes of each part's nets, accesses of each memory.

Two frames of a view are simulated from memory to pixels, so that both halves are busy. One frame
time is counted: from when the first frame's tiles can be rendered until the second frame's can,
while the second frame's points are processed. Nets are sampled once per cycle, after they have
settled, so glitches of gates (hazards) are left out. Long frames are sampled in windows.
"""

import re
from collections import Counter
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from splatcore.eda.gates.machine_gates import PARTS, part_around
from splatcore.eda.gates.macros import Macros, module, sizes_in
from splatcore.eda.power.loads import SUFFIX, observed
from splatcore.eda.power.saif import duration, nets
from splatcore.golden.pipeline import render
from splatcore.hdl.top import Top
from splatcore.sim.common.cache import kept_json
from splatcore.sim.common.output import progress_bar
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.machine.machine import Job, Machine
from splatcore.sim.machine.path import simulate
from splatcore.sim.machine.program import TOGGLES
from splatcore.sim.machine.script import LPDDR4
from splatcore.sim.rtl.convert import kept
from splatcore.spec.config import Config
from splatcore.spec.energy import ENERGY
from splatcore.spec.error import InputError
from splatcore.spec.registers import INTERRUPT_FRAME, INTERRUPT_READY

FRAMES = 2

SAMPLE_LENGTH = 1024
"""Cycles per window. A net that differs from the previous window counts as one change."""

COUNTED = 1 << 17  # cycles of a frame that are sampled by default, about
MACRO = "macro"  # instance of a memory (`eda.gates.macros`); its nets are not logic

TOP_DEPTH = 2
"""Instances around the machine's own: Verilator's, which repeats its ports, and `top`."""


@dataclass(frozen=True)
class Activity:
    """Activity of a part. bits: of its nets; changes: per frame; still: bits that never changed."""

    bits: int
    changes: float
    still: int


@dataclass(frozen=True)
class Register:
    """A register of the machine.

    loads: shares of cycles in which it loads a value, of its bits or of all bits alike
    changes: per frame, of all its bits
    """

    part: str
    bits: int
    loads: list[float]
    changes: float


@dataclass(frozen=True)
class Accesses:
    """A memory: its path, its part, its size, and its reads and writes per frame."""

    path: str
    part: str
    words: int
    bits: int
    reads: float
    writes: float


@dataclass(frozen=True)
class Counts:
    """Switching of a frame.

    parts: by name, as in `eda.gates.machine_gates.PARTS`
    registers: by path and name (`plain`)
    cycles, pixels: of a frame
    sample_every: one window in `sample_every` was sampled
    simulated, counted: cycles of the run, and of its sampled windows
    traffic: bytes per frame, by cause
    """

    parts: dict[str, Activity]
    registers: dict[str, Register]
    memories: list[Accesses]
    cycles: int
    pixels: int
    sample_every: int
    simulated: int
    counted: int
    traffic: dict[str, int]


@cache
def machine_source(config: Config) -> str:
    """The machine's Verilog with memories as modules, whose enables are nets, and with observers of
    registers (`eda.power.loads`)."""
    text = observed(kept(Top(config), platform=Macros()))
    return text + "".join(module(*size) for size in sizes_in(text))


def plain(name: str) -> str:
    """A path without the suffixes $N that Amaranth appends to equal names."""
    return re.sub(r"\$\d+", "", name)


def register_name(path: str) -> str:
    """The path of a register or of a net, without the suffixes $N of instances."""
    return re.sub(r"\$\d+(?=\.)", "", path)


def memory_sizes(source: str) -> dict[str, tuple[int, int]]:
    """Words and bits of each memory, by the path of its module."""
    sizes = {}
    for body in re.split(r"^module \\?top\.?", source, flags=re.M)[1:]:
        path = plain(body.split(maxsplit=1)[0])
        for words, bits in re.findall(rf"^  splatcore_memory_(\d+)x(\d+) {MACRO} \(", body, re.M):
            if path in sizes:
                raise ValueError(f"two memories at {path}")
            sizes[path] = int(words), int(bits)
    return sizes


def read_counts(
    path: Path, sizes: dict[str, tuple[int, int]], scale: float
) -> tuple[dict[str, Activity], dict[str, Register], list[Accesses]]:
    """Read a SAIF file: activity by part, loads by register and accesses by memory.

    scale: factor from the file's cycles to a frame's
    """
    bits, changes, still = Counter(), Counter(), Counter()
    enables: dict[tuple[str, str], int] = {}
    loads: dict[str, list[int]] = {}
    by_name, widths = Counter(), Counter()  # of all nets
    for net in nets(path):
        if len(net.path) < TOP_DEPTH:
            continue
        instance = plain(".".join(net.path[TOP_DEPTH:]))
        if net.path[-1] == MACRO:
            if net.name in ("read_enable", "write_enable"):
                enables[instance.removesuffix(f".{MACRO}"), net.name] = net.high
            continue
        full = register_name(".".join((*net.path[TOP_DEPTH:], net.name.partition("[")[0])))
        if full.endswith(SUFFIX):
            loads.setdefault(full.removesuffix(SUFFIX), []).append(net.high)
            continue
        by_name[full] += net.changes
        widths[full] += 1
        name = part_around(instance)
        bits[name] += 1
        changes[name] += net.changes
        still[name] += not net.changes
    if {place for place, _ in enables} != set(sizes):
        raise ValueError(f"{path}: has other memories than the machine")
    activity = {
        part.name: Activity(bits[part.name], changes[part.name] * scale, still[part.name])
        for part in PARTS
        if bits[part.name]
    }
    accesses = [
        Accesses(
            place, part_around(place), *sizes[place],
            enables[place, "read_enable"] * scale, enables[place, "write_enable"] * scale,
        )
        for place in sorted(sizes)
    ]  # fmt: skip
    cycles = duration(path)
    registers = {
        name: Register(
            part_around(plain(name.rpartition(".")[0])), widths[name],
            [high / cycles for high in found], by_name[name] * scale,
        )
        for name, found in loads.items()
    }  # fmt: skip
    return activity, registers, accesses


def counts_of(config: Config, job: Job, sample_every: int | None, label: str) -> Counts:
    """Measure the switching of a view's frame with LPDDR4 as memory, or read it from the cache.

    sample_every: sample one window in `sample_every`; None: about `COUNTED` cycles in all
    label: name of the view for messages
    Raises InputError if the machine fails or its picture is not the golden model's.
    """
    with progress_bar(f"writing the machine {config.name}"):
        source = machine_source(config)
    # Everything that the counts depend on: not the constants of energy, and no names.
    made_from = [source, replace(config, energy=ENERGY), LPDDR4, job.model.image, job.background]
    made_from += [replace(job.camera, name=""), TOGGLES, FRAMES, SAMPLE_LENGTH, COUNTED]

    def compute() -> dict:
        return asdict(simulated_counts(config, source, job, sample_every, label))

    return from_json(kept_json("power", [*made_from, sample_every], compute))


def simulated_counts(
    config: Config, source: str, job: Job, sample_every: int | None, label: str
) -> Counts:
    """Simulate the frames for `counts_of`. source: Verilog of the machine."""
    frame = render(config, *job)
    every = sample_every or max(1, round(frame_cycles(config, frame).frame / COUNTED))
    with progress_bar(f"building the machine {config.name} with activity counting, takes minutes"):
        machine = Machine(config, source, toggles=True)
    lines = settings(every) | {"steady": f"{INTERRUPT_READY} {INTERRUPT_FRAME}"}
    with TemporaryDirectory(prefix="splatcore") as name:
        run = simulate(
            machine, [job] * FRAMES, LPDDR4, label, settings=lambda areas: lines, keep=Path(name)
        )
        if not run.done:
            raise InputError(f"{label}: the machine failed: {run.why}")
        if any(not np.array_equal(found.pixels, frame.pixels) for found in run.frames):
            raise InputError(f"{label}: the picture is not the golden model's")
        with progress_bar("counting"):
            path, (cycles,) = Path(name) / "waves.saif", run.frame_cycles
            counted = duration(path)
            parts, registers, memories = read_counts(path, memory_sizes(source), cycles / counted)
    return Counts(
        parts, registers, memories, cycles, job.camera.width * job.camera.height, every,
        run.report.cycles, counted, run.frames[-1].traffic,
    )  # fmt: skip


def settings(sample_every: int) -> dict[str, str]:
    """Sampling options for the simulation program."""
    return {"sample_every": str(sample_every), "sample_length": str(SAMPLE_LENGTH)}


def from_json(facts: dict) -> Counts:
    """Read `Counts` from their JSON object."""
    parts = {name: Activity(**found) for name, found in facts["parts"].items()}
    registers = {name: Register(**found) for name, found in facts["registers"].items()}
    memories = [Accesses(**found) for found in facts["memories"]]
    return Counts(**facts | {"parts": parts, "registers": registers, "memories": memories})
