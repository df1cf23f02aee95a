"""The commands `verilog`, `registers` and `example`: files for integrating the machine."""

import re
from pathlib import Path

from splatcore.app.cli.options import NEW_FOLDER, PRESET, command, listed, option
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, progress_bar
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

PARTS = ("top", "registers", "stages")
"""Keys of `eda.deliver.verilog.WRITERS`, repeated here because its import is slow."""

DEFAULT_PARTS = PARTS[:2]


@command("verilog")
def verilog_command(
    output: Path = NEW_FOLDER,
    part: list[str] | None = option(
        None, "NAME", f"Part to write: {listed(PARTS)}; may be repeated. Default: the first two."
    ),
    config: Config = PRESET,
    prefix: str = option("splatcore", "NAME", "Prefix of the names of modules and their files."),
    src: bool = option(
        True,
        None,
        "Write `src` attributes, with lines of Python: a third of the text.",
        "--src/--no-src",
    ),
):
    """Write the machine as Verilog, with the files that a flow needs.

    Part top: splatcore_top.v, splatcore_memories.v, memories.csv, a FuseSoC core file with a small
    testbench, constraints and lint waivers. Part registers: the files of `splatcore registers`.
    Part stages: one self-contained file per stage. See docs/integration.md.

    Takes a minute or more: splatcore_top.v has 8 MB (TINY), 15 MB (DEFAULT) or 27 MB (PAPER).
    """
    parts = part or list(DEFAULT_PARTS)
    check_known("--part", PARTS, *parts)
    if not re.fullmatch(r"[A-Za-z]\w*", prefix, re.A):
        raise InputError(f"--prefix {prefix}: is not a Verilog identifier")
    from splatcore.eda.deliver import verilog

    names = verilog.Names(prefix, src)
    paths: dict[Path, None] = {}
    with progress_bar("writing Verilog") as advance:
        for done, name in enumerate(parts):
            advance(done, len(parts), f"writing {name}")
            paths |= dict.fromkeys(verilog.WRITERS[name](config, output, names))
    for path in paths:
        console.print(str(path))


@command("registers")
def registers_command(output: Path = NEW_FOLDER, config: Config = PRESET):
    """Write the register map, a C header, a driver and SystemRDL.

    registers.md is the documentation, splatcore.h the header, splatcore.rdl SystemRDL for other
    tools. splatcore_driver.c renders a frame without floating point, as a kernel needs it;
    splatcore_camera.c computes the registers of a camera.
    """
    from splatcore.eda.deliver.register_files import write_register_files

    for path in write_register_files(config, output):
        console.print(str(path))


@command("example")
def example_command(output: Path = NEW_FOLDER):
    """Write a self-contained folder in which Verilog renders a frame.

    Preset TINY under cocotb, with a Makefile, requirements.txt, the scene and the expected picture.
    Start with README.md in the folder.
    """
    from splatcore.eda.example.example import write_example

    with progress_bar("writing the example"):
        paths = write_example(output)
    for path in paths:
        console.print(str(path))
