"""The command `synth`: sizes and depths of stages, from synthesis."""

from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.cli.options import JsonOption, PresetOption, app
from splatcore.sim.common.output import check_writable, console, progress_bar
from splatcore.sim.common.paper import GATES, STAGE_OF
from splatcore.sim.common.result import write_json
from splatcore.sim.eda.machine_gates import synthesise_machine
from splatcore.sim.eda.synth import DEPTH_MAX, gates
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PARTS = STAGES | CONTROL | PRIMITIVES


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
