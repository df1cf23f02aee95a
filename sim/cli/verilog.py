"""The command `verilog`: the machine as Verilog files."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.sim.cli.options import PresetOption, app
from splatcore.sim.common.output import check_folder, console, progress_bar
from splatcore.sim.eda import verilog
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset


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
    check_folder(output)
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
