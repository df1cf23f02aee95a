"""The commands `scene` and `info`: a generated scene as a file; the contents of a file."""

from pathlib import Path

from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.cli.options import JsonOption, SourceArgument, app, argument, option
from splatcore.sim.common import describe
from splatcore.sim.common import output as files
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.source import open_source

NameArgument = argument(str, "NAME", "Which scene.")
OutputOption = option(Path, "FILE.ply", "Where to write it.", "-o")
CountOption = option(int | None, None, "Number of Gaussians.")
SeedOption = option(int, None, "Same seed, same scene.")
CamerasOption = option(Path | None, "FILE.json", "Write the scene's own view, too.")


@app.command(
    "scene",
    help="Generate a scene and write it as a 3DGS PLY.\n\nNAME is `garden`, the embedded default, "
    "or one of the hard cases: " + ", ".join(name for name in GENERATORS if name != "garden") + ".",
)
def scene_command(
    name: NameArgument,
    output: OutputOption,
    count: CountOption = None,
    seed: SeedOption = 0,
    cameras: CamerasOption = None,
):
    with progress_bar(f"generating {name}"):
        scene = generate(name, count, seed)
        with files.whole_file(output) as part:
            write_ply(part, scene)
        if cameras:
            files.write(cameras, cameras_json([generated_camera(name)]).encode())
    console.print(f"{output}: {len(scene)} Gaussians, SH degree {scene.sh_degree}")


@app.command("info")
def info_command(scene: SourceArgument, json: JsonOption = None):
    """Say what a scene or packed model holds: counts, extents, ranges, anything odd."""
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        facts = describe.describe(source)
    console.print(describe.table(facts))
    write_json(json, facts)
