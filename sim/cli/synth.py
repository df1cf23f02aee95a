"""The command `synth`: how large the machine's parts are, and how deep."""

from pathlib import Path

from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.cli.options import FOLDER, JsonOption, PresetOption, app, option
from splatcore.sim.common import paper
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.source import check_known
from splatcore.sim.common.table import new_table, shown
from splatcore.sim.eda.machine_gates import synthesise_machine
from splatcore.sim.eda.synth import DEPTH_MAX, gates
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PARTS = STAGES | CONTROL | PRIMITIVES

StageOption = option(list[str], "NAME", f"top, {', '.join(PARTS)}.")
LibertyOption = option(
    str | None, "FILE", "Standard cells (.lib, .lib.gz): area and longest paths in these."
)
ProcessOption = option(
    float | None, "NM", "The library's process, to scale its area to 28 nm.", min=1.0
)
StaOption = option(
    Path | None, FOLDER, "With --liberty: netlists of cells, and scripts for OpenSTA.", "-o"
)


@app.command("synth")
def synth_command(
    stage: StageOption,
    preset: PresetOption = "DEFAULT",
    liberty: LibertyOption = None,
    process: ProcessOption = None,
    output: StaOption = None,
    json: JsonOption = None,
):
    """Synthesise stages or primitives and say how large and how deep they are.

    Sizes are NAND2-equivalents with flip-flops and without memories, which are listed in bits.
    Depth is the number of gates on the longest path between registers; 800 MHz in 28 nm leave room
    for 40. Mapped for area, with the depth that this gives, and mapped for speed.

    With --liberty in cells of that library instead: um², its own NAND2-equivalents, ps of the
    longest path with its cells and the names of its ends, without and with wires, and the same in
    FO4: the delay of an inverter with four of its kind as load. docs/silicon.md says what is
    assumed.

    top is the whole machine, part by part, and checked for latches, loops, wires of several drivers
    and of none; with --liberty paths lead across parts. It takes up to half an hour the first time;
    parts are kept (see `splatcore cache`).
    """
    config = find_preset(preset)
    check_known("--stage", ("top", *PARTS), *stage)
    for name, value in {"-o": output, "--process": process}.items():
        if value is not None and liberty is None:
            raise InputError(f"{name} {value}: goes with --liberty only")
    facts = {"preset": config.name}
    if liberty is not None:
        from splatcore.sim.eda.silicon_tables import print_silicon

        facts |= print_silicon(config, stage, liberty, process, output)
    else:
        if parts := [name for name in stage if name != "top"]:
            facts["stages"] = _synthesise_parts(config, parts)
        if "top" in stage:
            facts["top"] = synthesise_machine(config)
    write_json(json, facts)


def _synthesise_parts(config: Config, names: list[str]) -> dict:
    """Print a table of parts on their own; the same for a JSON file."""
    facts = {}
    headings = ("NAND2", "paper", "depth", "for speed", "depth", "flip-flops", "memory bits")
    title = f"preset {config.name}; depth for speed ≤ {DEPTH_MAX}"
    table = new_table("stage", headings, title)
    for name in names:
        with progress_bar(f"synthesising {name}"):
            found = gates(PARTS[name](config))
        nand2 = paper.GATES.get(paper.STAGE_OF.get(name))
        row = [found.nand2, nand2, found.depth, found.speed_nand2, found.speed_depth]
        row += [found.flip_flops, found.memory_bits]
        table.add_row(name, *(shown(value, ",.0f") for value in row))
        facts[name] = vars(found) | {"memory_bits": found.memory_bits, "paper_nand2": nand2}
    console.print(table)
    return facts
