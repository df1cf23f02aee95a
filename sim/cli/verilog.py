"""The commands `verilog` and `registers`: files for those who build the machine in."""

from pathlib import Path

from splatcore.sim.cli.options import FolderOption, PresetOption, app, option
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.source import check_known
from splatcore.spec.preset import find_preset

PARTS = ("top", "stages")
"""Names of `sim.eda.verilog.WRITERS`, whose import takes a while."""

PartOption = option(list[str] | None, "NAME", f"{', '.join(PARTS)}. Default: both.")


@app.command("verilog")
def verilog_command(
    output: FolderOption, part: PartOption = None, preset: PresetOption = "DEFAULT"
):
    """Write the machine as Verilog.

    top: splatcore_top.v with splatcore_memories.v, memories.csv, a FuseSoC core file, constraints
    and lint's waivers. stages: one file each, which stands alone. docs/integration.md says more.
    """
    config = find_preset(preset)
    parts = part or list(PARTS)
    check_known("--part", PARTS, *parts)
    from splatcore.sim.eda import verilog

    paths: dict[Path, None] = {}
    with progress_bar("writing Verilog") as advance:
        for done, name in enumerate(parts):
            advance(done, len(parts), f"writing {name}")
            paths |= dict.fromkeys(verilog.WRITERS[name](config, output))
    for path in paths:
        console.print(str(path), soft_wrap=True)


@app.command("registers")
def registers_command(output: FolderOption, preset: PresetOption = "DEFAULT"):
    """Write the register map: registers.md, and the C header splatcore.h.

    The header also has the layout of memory and the function that makes registers' numbers;
    docs/example_frame.c renders a frame with it.
    """
    from splatcore.sim.eda.register_files import write_register_files

    for path in write_register_files(find_preset(preset), output):
        console.print(str(path), soft_wrap=True)
