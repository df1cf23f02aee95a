"""The command `power`: an ESTIMATE of what a frame takes, stage by stage, beside the paper's."""

from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from splatcore.sim.cli import options
from splatcore.sim.cli.options import option
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.paper import LOGIC, MEMORY_POWER, PIXELS_PER_JOULE, POWER
from splatcore.sim.common.source import check_fits, open_camera, open_source
from splatcore.sim.common.table import new_table, print_whole
from splatcore.sim.eda.liberty import Library
from splatcore.sim.eda.liberty_file import read_liberty
from splatcore.sim.eda.machine_gates import netlist, sizes
from splatcore.sim.machine.machine import Job
from splatcore.sim.packing.choose import packed_model
from splatcore.sim.power.activity import SAMPLE_LENGTH, Counts, counts_of
from splatcore.sim.power.estimate import (
    FEMTO,
    Estimate,
    Gates,
    Logic,
    estimate,
    gates_of,
    sum_of,
)
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.energy import PROCESS_NM, Energy
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

MILLI, MEGA = 1e-3, 1e6

HEADINGS = ("NAND2 k", "activity", "gates", "clock", "mW", "paper", "fJ", "paper")
"""Columns of the table; fJ are those of a NAND2-equivalent and cycle."""

NOTHING = [""] * 4  # in place of all columns before mW


FpsOption = option(float | None, "N", "Frames a second. Default: full speed, 800 MHz.", "--fps")
SampleOption = option(
    int | None,
    "N",
    f"Count in one of N windows of {SAMPLE_LENGTH} cycles; 1: in all. Default: about 32 windows.",
    "--sample",
)
LibertyOption = option(
    str | None, "FILE", "Standard cells (.lib, .lib.gz): gates' energies by these, with --process."
)
ProcessOption = option(
    float | None, "NM", f"The library's process, to scale energies to {PROCESS_NM} nm.", min=1.0
)


@options.app.command("power")
def power_command(
    scene: options.SourceArgument,
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    preset: options.PresetOption = "DEFAULT",
    fps: FpsOption = None,
    sample: SampleOption = None,
    liberty: LibertyOption = None,
    process: ProcessOption = None,
    json: options.JsonOption = None,
):  # fmt: skip
    """ESTIMATE the power of a frame, first order, by stage, beside the paper's.

    Frames are simulated in RTL; how often the nets of a part change, times its gates, times the
    energy of a NAND2 that switches, is the part's. Nets of RTL stand for those of gates; nothing
    is laid out. Flip-flops add their clock, memories their accesses, DRAM (apart) its bytes. All
    constants are in spec/energy.py, 28 nm at 0.9 V, with their sources; --json writes them, too. A
    factor of two either way is within what this is good for.

    With --liberty each gate and flip-flop takes what the library says, by its slew and load, wires
    included, scaled from --process and the library's voltage; memories, DRAM and leakage as before.

    The first time it compiles and simulates the machine and synthesises its parts, half an hour
    for DEFAULT; what it finds is kept (see
    `splatcore cache`).
    """
    config = find_preset(preset)
    for name, value in (("fps", fps), ("sample", sample)):
        if value is not None and not value > 0:
            raise InputError(f"--{name} {value:g}: is not above 0")
    library = _library(liberty, process)
    with progress_bar(f"packing {scene}"):
        source = open_source(scene)
        view = open_camera(camera, size, source)
        check_fits(config, view.width, view.height)
        model = packed_model(source, config, view)
    counts = counts_of(config, Job(model, view), sample, f"simulating {source.name}")
    if fps is not None and fps > CLOCK_HZ / counts.cycles:
        most = CLOCK_HZ / counts.cycles
        raise InputError(f"--fps {fps:g}: is more than {most:.1f}, what 800 MHz are good for")
    gates = _gates(config, library, process)
    found = estimate(counts, gates, config.energy)
    fps = found.fps_max if fps is None else fps
    what = f"{Path(source.name).name} {view.width}x{view.height}, preset {config.name}"
    print_whole(table(found, fps, f"ESTIMATE, first order: {what}, {fps:.1f} frames a second"))
    for text in lines(found, fps):
        console.print(text, soft_wrap=True)
    facts = {
        "preset": config.name, "scene": source.name, "camera": camera or view.name,
        "size": [view.width, view.height],
    }  # fmt: skip
    if library:
        facts["liberty"] = _cells(library, process, config.energy)
    write_json(json, facts | report(found, counts, config.energy, fps))


def _library(liberty: str | None, process: float | None) -> Library | None:
    """The library of a file, if there is one; InputError without its process."""
    if (liberty is None) != (process is None):
        given, other = ("--process", "--liberty")[:: -1 if process is None else 1]
        raise InputError(f"{given} {process or liberty}: goes with {other} only")
    return liberty and read_liberty(liberty)


def _gates(config: Config, library: Library | None, process: float | None) -> dict[str, Gates]:
    """What the machine's parts take: in cells of a library, or in plain gates."""
    with progress_bar("synthesising the machine") as advance:
        if library is None:
            return gates_of(sizes(netlist(config), advance), config.energy)
        from splatcore.sim.eda.silicon import machine_silicon
        from splatcore.sim.power.cells import gates_in_cells

        _, silicon = machine_silicon(netlist(config), library, advance)
        return gates_in_cells(silicon.wired, process, config.energy)


def _cells(library: Library, process: float, energy: Energy) -> dict:
    """Say in which cells it is; the same for a JSON file."""
    volts = library.voltage
    text = f"In cells of {library.name}, scaled from {process:g} nm, {volts:g} V."
    console.print(text, soft_wrap=True)
    return {
        "library": library.name, "corner": library.corner, "voltage": volts,
        "process_nm": process, "scale": energy.scale(process, volts),
    }  # fmt: skip


def table(found: Estimate, fps: float, title: str) -> Table:
    """mW by stage, and of the memories of each."""
    made = new_table("mW; fJ a NAND2 and cycle", HEADINGS, title)
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
    made.add_row("DRAM, apart", *NOTHING, _milli(sum(found.dram.values()) * fps))
    return made


def _milli(watts: float) -> str:
    return f"{watts / MILLI:,.2f}" if watts else ""


def _logic(logic: Logic, cycles: int, fps: float, nand2: float, paper: float) -> tuple[str, ...]:
    """Cells of a stage, with NAND2-equivalents and W of the paper's."""
    femto = logic.frame / (logic.nand2 * cycles) / FEMTO
    return (
        f"{logic.nand2 / 1000:,.1f}", f"{logic.activity:.2%}",
        _milli(logic.switching * fps), _milli(logic.clock * fps),
        _milli(logic.frame * fps + logic.leakage), _milli(paper),
        f"{femto:.3f}", f"{implied(nand2, paper):.3f}" if nand2 else "",
    )  # fmt: skip


def implied(nand2: float, watts: float) -> float:
    """fJ of a NAND2-equivalent and cycle at 800 MHz that a power implies."""
    return watts / (nand2 * CLOCK_HZ) / FEMTO


def lines(found: Estimate, fps: float) -> list[str]:
    """Lines below the table: energy of a frame, pixels a joule, what is left out."""
    dram = sum(found.dram.values())
    with_dram, chip = (found.pixels_per_joule(fps, k) / MEGA for k in (True, False))
    return [
        f"An ESTIMATE. A frame: {found.cycles:,} cycles, {found.power(fps) / fps / MILLI:.3f} mJ "
        f"(of it leakage {found.leakage / fps / MILLI:.3f}), DRAM {dram / MILLI:.3f} mJ.",
        f"Mpixels/J: {chip:,.0f}, with DRAM {with_dram:,.0f}; the paper's "
        f"{PIXELS_PER_JOULE / MEGA:,.0f} without.",
        "No clock gates, no hazards, nothing laid out; constants: spec/energy.py.",
    ]


def report(found: Estimate, counts: Counts, energy: Energy, fps: float) -> dict:
    """The same and more for a JSON file, in J and W."""
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
