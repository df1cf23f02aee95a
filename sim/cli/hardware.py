"""Commands about the hardware: verilog, registers, synth, memories, programs."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES, WHOLE
from splatcore.sim.cli.options import JsonOption, PresetOption, app
from splatcore.sim.common.output import check_writable, console, progress_bar
from splatcore.sim.common.paper import GATES, MEMORIES, OPERATIONS, PES_BUSY, STAGE_OF
from splatcore.sim.common.result import write_json
from splatcore.sim.eda import verilog
from splatcore.sim.eda.gate_table import synthesise_machine
from splatcore.sim.eda.register_page import write_register_files
from splatcore.sim.eda.synth import DEPTH_MAX, gates, memories
from splatcore.spec.config import KB, Config
from splatcore.spec.error import InputError
from splatcore.spec.microprogram import Program, operation_counts, program
from splatcore.spec.preset import find_preset
from splatcore.spec.programs import TEXTS
from splatcore.spec.schedule import pes, schedule

PARTS = STAGES | CONTROL | PRIMITIVES


@app.command("verilog")
def verilog_command(
    output: Annotated[Path, typer.Option("-o", metavar="DIR", help="Folder to write into.")],
    part: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help=f"{', '.join(verilog.WRITERS)}. Default: both."),
    ] = None,
    preset: PresetOption = "DEFAULT",
):
    """Write the machine as Verilog.

    top: splatcore_top.v with splatcore_memories.v, memories.csv, a FuseSoC core file, constraints
    and lint's waivers. stages: one file each, which stands alone. docs/integration.md says more.
    """
    check_writable(output / "x" if output.is_dir() else output)
    config = find_preset(preset)
    parts = part or list(verilog.WRITERS)
    if unknown := [name for name in parts if name not in verilog.WRITERS]:
        names = ", ".join(verilog.WRITERS)
        raise InputError(f"--part '{unknown[0]}': unknown (there are {names})")
    paths: dict[Path, None] = {}
    with progress_bar("writing Verilog") as advance:
        for done, name in enumerate(parts):
            advance(done, len(parts), f"writing {name}")
            paths |= dict.fromkeys(verilog.WRITERS[name](config, output))
    for path in paths:
        console.print(str(path), soft_wrap=True)


@app.command("registers")
def registers_command(
    output: Annotated[Path, typer.Option("-o", metavar="DIR", help="Folder to write into.")],
    preset: PresetOption = "DEFAULT",
):
    """Write the register map: registers.md, and the C header splatcore.h.

    The header also has the layout of memory and the function that makes registers' numbers;
    docs/example_frame.c renders a frame with it.
    """
    check_writable(output / "x" if output.is_dir() else output)
    for path in write_register_files(find_preset(preset), output):
        console.print(str(path), soft_wrap=True)


@app.command("synth")
def synth_command(
    stage: Annotated[list[str], typer.Option(metavar="NAME", help=f"top, {', '.join(PARTS)}.")],
    preset: PresetOption = "DEFAULT",
    json: JsonOption = None,
):
    """Synthesise stages or primitives and say how large and how deep they are.

    Sizes are NAND2-equivalents with flip-flops and without memories, which are listed in bits.
    Depth is the number of gates on the longest path between registers; 800 MHz in 28 nm leave room
    for 40. Mapped for area, with the depth that this gives, and mapped for speed.

    top is the whole machine, part by part, and checked for latches, loops, wires of several drivers
    and of none. It takes a quarter of an hour the first time; parts are kept in build/.
    """
    check_writable(json)
    config = find_preset(preset)
    unknown = [name for name in stage if name not in PARTS and name != "top"]
    if unknown:
        names = ", ".join(PARTS)
        raise InputError(f"--stage '{unknown[0]}': unknown (there are top, {names})")
    facts = {"preset": config.name}
    if parts := [name for name in stage if name != "top"]:
        facts["stages"] = _synthesise_parts(config, parts)
    if "top" in stage:
        facts["top"] = synthesise_machine(config)
    write_json(json, facts)


def _synthesise_parts(config: Config, names: list[str]) -> dict:
    """Print a table of parts on their own; the same for a JSON file."""
    facts = {}
    title = f"preset {config.name}; depth for speed ≤ {DEPTH_MAX}"
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    table.add_column("stage", no_wrap=True)
    for heading in ("NAND2", "paper", "depth", "for speed", "depth", "flip-flops", "memory bits"):
        table.add_column(heading, justify="right")
    for name in names:
        with progress_bar(f"synthesising {name}"):
            found = gates(PARTS[name](config))
        paper = GATES.get(STAGE_OF.get(name))
        row = (
            *(found.nand2, paper, found.depth, found.speed_nand2, found.speed_depth),
            *(found.flip_flops, found.memory_bits),
        )
        table.add_row(name, *("–" if value is None else f"{value:,.0f}" for value in row))
        facts[name] = vars(found) | {"memory_bits": found.memory_bits, "paper_nand2": paper}
    console.print(table)
    return facts


@app.command("memories")
def memories_command(preset: PresetOption = "DEFAULT", json: JsonOption = None):
    """List the on-chip memories of each stage, beside the paper's five."""
    check_writable(json)
    config = find_preset(preset)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=f"preset {config.name}")
    for heading in ("stage", "words", "bits", "how many", "KB"):
        table.add_column(heading, justify="left" if heading == "stage" else "right")
    facts, total = {}, 0.0
    for name, parts in WHOLE.items():
        sizes = Counter(size for make in parts for size in memories(make(config)))
        facts[name] = [
            {"words": words, "bits": bits, "count": count} for (words, bits), count in sizes.items()
        ]
        for (words, bits), count in sizes.items():
            kilobytes = words * bits * count / 8 / KB
            total += kilobytes
            table.add_row(name, f"{words:,}", f"{bits:,}", str(count), f"{kilobytes:.2f}")
    table.add_row("all", "", "", "", f"{total:.2f}")
    console.print(table)
    paper = ", ".join(f"{name} {size}" for name, size in MEMORIES.items())
    console.print(f"The paper: {sum(MEMORIES.values())} KB ({paper}).")
    write_json(json, {"preset": config.name, "kilobytes": total, "stages": facts})


@app.command("programs")
def programs_command(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print this program's steps and their times.")
    ] = None,
    preset: PresetOption = "DEFAULT",
    json: JsonOption = None,
):
    """List the microprograms of stages 0 and 1: operations, cycles, how busy the PEs are."""
    check_writable(json)
    config = find_preset(preset)
    if show is not None and show not in TEXTS:
        raise InputError(f"--show '{show}': unknown (there are {', '.join(TEXTS)})")
    facts = {name: program_facts(config, program(name)) for name in TEXTS}
    if show:
        plan = schedule(config, program(show))
        for place in plan.places:
            unit = (
                f"{place.step.unit}{place.number}" if place.step.unit == "pe" else place.step.unit
            )
            console.print(f"{place.time:4}  {unit:10}  {place.step}", soft_wrap=True)
    else:
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("program", no_wrap=True)
        for heading in HEADINGS:
            table.add_column(heading, justify="right", no_wrap=True)
        for name, row in facts.items():
            table.add_row(name, *map(str, row.values()))
        console.print(table)
        console.print(PAPER_OPERATIONS)
    write_json(json, {"preset": config.name, "programs": facts})


HEADINGS = "ops × + /√ choose PEs cycles latency busy regs".split()
"""Short names of `program_facts`, in its order."""

PAPER_OPERATIONS = (
    "The paper: {0[operations]} operations ({0[multiply]} ×, {0[add]} +, {0[divide]} /, "
    "{0[subtract]} −) without products with zeros, {1[operations]} with them ({1[multiply]} ×, "
    "{1[add]} +, {1[divide]} /, {1[subtract]} −); PEs busy {2:.1f} % of the cycles."
).format(OPERATIONS["without zeros"], OPERATIONS["with zeros"], 100 * PES_BUSY)


def program_facts(config: Config, steps: Program) -> dict[str, int | float]:
    """A program's operations and its schedule on a machine."""
    counts, plan = operation_counts(steps.steps), schedule(config, steps)
    return {
        "operations": sum(counts.values()),
        "multiply": counts.get("multiply", 0),
        "add": counts.get("add", 0),
        "divide_or_root": counts.get("reciprocal", 0) + counts.get("rsqrt", 0),
        "choose": counts.get("clamp", 0) + counts.get("maximum", 0),
        "pes": pes(config, steps),
        "cycles_an_item": plan.interval,
        "latency": plan.length,
        "pes_busy": round(plan.utilisation(pes(config, steps)), 3),
        "registers": plan.registers,
    }
