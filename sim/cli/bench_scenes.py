"""The command `bench scenes`: frames of the simulated machine."""

from typing import Annotated

import typer

from splatcore.sim.bench.scenes import bench_scenes
from splatcore.sim.cli.bench import (
    SIZE,
    CamerasOption,
    FolderOption,
    PixelsOption,
    ScenesArgument,
    bench,
    look,
)
from splatcore.sim.cli.options import PresetOption
from splatcore.sim.common.output import console
from splatcore.sim.machine.path import find_timing
from splatcore.sim.machine.script import TIMINGS
from splatcore.spec.preset import find_preset


@bench.command("scenes")
def scenes_command(
    output: FolderOption,
    scene: ScenesArgument = None,
    cameras: CamerasOption = None,
    size: PixelsOption = SIZE,
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
    right = bench_scenes(config, look(output, scene, cameras, size), timings, output)
    console.print((output / "scenes.md").read_text(), soft_wrap=True)
    if not right:
        raise typer.Exit(1)
