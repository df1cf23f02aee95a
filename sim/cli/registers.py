"""The command `registers`: the register map, as a page and as a C header."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.sim.cli.options import PresetOption, app
from splatcore.sim.common.output import check_folder, console
from splatcore.sim.eda.register_files import write_register_files
from splatcore.spec.preset import find_preset


@app.command("registers")
def registers_command(
    output: Annotated[Path, typer.Option("-o", metavar="DIR", help="Folder to write into.")],
    preset: PresetOption = "DEFAULT",
):
    """Write the register map: registers.md, and the C header splatcore.h.

    The header also has the layout of memory and the function that makes registers' numbers;
    docs/example_frame.c renders a frame with it.
    """
    check_folder(output)
    for path in write_register_files(find_preset(preset), output):
        console.print(str(path), soft_wrap=True)
