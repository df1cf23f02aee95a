"""The command `scene`: a generated scene, as a file."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.cli.options import (
    app,
)
from splatcore.sim.common.output import check_writable, console, progress_bar, whole_file, write


@app.command(
    "scene",
    help="Generate a scene and write it as a 3DGS PLY.\n\nNAME is `garden`, the embedded default, "
    "or one of the hard cases: " + ", ".join(name for name in GENERATORS if name != "garden") + ".",
)
def scene_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Which scene.")],
    output: Annotated[Path, typer.Option("-o", metavar="FILE.ply", help="Where to write it.")],
    count: Annotated[int | None, typer.Option(help="Number of Gaussians.")] = None,
    seed: Annotated[int, typer.Option(help="Same seed, same scene.")] = 0,
    cameras: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write the scene's own view, too.")
    ] = None,
):
    check_writable(output, cameras)
    with progress_bar(f"generating {name}"):
        scene = generate(name, count, seed)
        with whole_file(output) as part:
            write_ply(part, scene)
        if cameras:
            write(cameras, cameras_json([generated_camera(name)]).encode())
    console.print(f"{output}: {len(scene)} Gaussians, SH degree {scene.sh_degree}")
