"""The commands `verilog` and `registers`: files for those who build the machine in."""

import re
from pathlib import Path

from splatcore.sim.cli.options import FolderOption, PresetOption, app, option
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.source import check_known
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PARTS = ("top", "registers", "stages")
"""Names of `sim.eda.verilog.WRITERS`, whose import takes a while."""

DEFAULT_PARTS = PARTS[:2]

PartOption = option(list[str] | None, "NAME", f"{', '.join(PARTS)}. Default: the first two.")
PrefixOption = option(str, "NAME", "What names of modules and of the files with them begin with.")
SourceOption = option(bool, None, "Whether attributes src name lines of Python: a third of it all.")


@app.command("verilog")
def verilog_command(
    output: FolderOption,
    part: PartOption = None,
    preset: PresetOption = "DEFAULT",
    prefix: PrefixOption = "splatcore",
    src: SourceOption = True,
):
    """Write the machine as Verilog, and all that a flow wants beside it.

    top: splatcore_top.v with splatcore_memories.v, memories.csv, a FuseSoC core file with a small
    testbench, constraints and lint's waivers. registers: what `splatcore registers` writes. stages:
    one file each, which stands alone. docs/integration.md says more.
    """
    config = find_preset(preset)
    parts = part or list(DEFAULT_PARTS)
    check_known("--part", PARTS, *parts)
    if not re.fullmatch(r"[A-Za-z]\w*", prefix, re.A):
        raise InputError(f"--prefix {prefix}: is no name of Verilog")
    from splatcore.sim.eda import verilog

    names = verilog.Names(prefix, src)
    paths: dict[Path, None] = {}
    with progress_bar("writing Verilog") as advance:
        for done, name in enumerate(parts):
            advance(done, len(parts), f"writing {name}")
            paths |= dict.fromkeys(verilog.WRITERS[name](config, output, names))
    for path in paths:
        console.print(str(path), soft_wrap=True)


@app.command("registers")
def registers_command(output: FolderOption, preset: PresetOption = "DEFAULT"):
    """Write the register map: registers.md, the C header splatcore.h, splatcore.rdl; and a driver.

    splatcore_driver.c renders a frame and needs no floating point, as in a kernel;
    splatcore_camera.c makes a camera's registers. splatcore.rdl is SystemRDL, for other tools.
    """
    from splatcore.sim.eda.register_files import write_register_files

    for path in write_register_files(find_preset(preset), output):
        console.print(str(path), soft_wrap=True)
