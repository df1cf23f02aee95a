"""The command `bench scenes`: frames of the simulated machine."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.sim.bench.scenes import bench_scenes, views
from splatcore.sim.cli.bench import bench
from splatcore.sim.cli.options import PresetOption
from splatcore.sim.common.output import check_writable, console
from splatcore.sim.common.source import VIEW_SIZE, parse_size
from splatcore.sim.machine.path import find_timing
from splatcore.sim.machine.script import TIMINGS
from splatcore.spec.preset import find_preset


@bench.command("scenes")
def scenes_command(
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for results and tables.")
    ],
    scene: Annotated[
        list[str] | None,
        typer.Argument(metavar="SCENE …", help="Default: all in the folder SPLATCORE_SCENES."),
    ] = None,
    cameras: Annotated[
        str | None, typer.Option(metavar="ID,ID,…", help="Default: each scene's first, and more.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Pixels.")] = "x".join(
        map(str, VIEW_SIZE)
    ),
    timing: Annotated[
        str, typer.Option(metavar="NAME", help="Memory: 'ideal', 'lpddr4' or 'both'.")
    ] = "both",
    preset: PresetOption = "DEFAULT",
):
    """Render scenes by the simulated machine: cycles, traffic, and whether the pictures are right.

    A result that is in DIR already is not simulated again while the machine's Verilog is the same.
    Exit status 1 if a picture is not the golden model's.
    """
    config = find_preset(preset)
    timings = list(TIMINGS.values()) if timing == "both" else [find_timing(timing)]
    size = "x".join(map(str, parse_size(size)))
    found = views(list(scene or ()), cameras, size)
    check_writable(output / "x" if output.is_dir() else output)
    output.mkdir(exist_ok=True)
    right = bench_scenes(config, found, timings, output)
    console.print((output / "scenes.md").read_text(), soft_wrap=True)
    if not right:
        raise typer.Exit(1)
