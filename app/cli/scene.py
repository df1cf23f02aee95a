"""The commands `scene` (generate one), `join` (put several side by side) and `info` (show one)."""

from dataclasses import replace
from pathlib import Path

from splatcore.app.cli import describe
from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.options import (
    ANTIALIASED,
    SOURCE,
    argument,
    command,
    option,
)
from splatcore.model.cameras.join import in_view, side_by_side
from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.sim.common import notes
from splatcore.sim.common import output as files
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.frame.reading import Marks, Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import check_source, open_source
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

PLY = option(..., "FILE.ply", "Scene file to write.")
CAMERAS_FILE = option(None, "FILE.json", "Also write the scene's camera.")


@command(
    "scene",
    help=f"{COMMANDS['scene'].summary}\n\nNAME is `garden`, the embedded default, "
    "or one of the hard cases: " + ", ".join(name for name in GENERATORS if name != "garden") + ".",
)
def scene_command(
    name: str = argument(..., "NAME", "Scene to generate."),
    output: Path = PLY,
    count: int | None = option(None, "N", "Number of Gaussians."),
    sh_degree: int | None = option(None, "N", "SH degree of the garden, 0 … 3 (default: 1)."),
    seed: int = option(0, "N", "Random seed."),
    cameras: Path | None = CAMERAS_FILE,
    antialiased: bool | None = ANTIALIASED,
):
    with progress_bar(f"generating {name}"):
        made = replace(generate(name, count, seed, sh_degree), antialiased=bool(antialiased))
        _write(output, cameras, made, generated_camera(name))


@command("join")
def join_command(
    reading: Marks,
    scene: list[str] = argument(..., "SCENE …", "Scenes, from left to right."),
    output: Path = PLY,
    behind: str | None = option(
        None, "SCENE", "Also put a scene behind the camera: it is loaded and never visible."
    ),
    count: int | None = option(
        None, "N", "Keep N Gaussians, picked evenly; those behind the camera are dropped first."
    ),
    cameras: Path | None = CAMERAS_FILE,
):
    """Put scenes side by side in front of one camera, in one PLY file.

    The camera is the first scene's: the first in NAME.cameras.json next to its file, else a
    generated view. Of n scenes, each gets a column of the picture: it is moved (not turned or
    scaled) to the middle of its column, √n times as far away as from its own camera. Surroundings
    of real scenes overlap other columns. --cameras writes the camera.
    """
    reading = Reading(**vars(reading))
    for each in scene:
        check_source(each, reading)
    with progress_bar("joining"):
        shots = (View(each, reading=reading).open() for each in scene)
        views = [(shot.source.unpacked, shot.camera) for shot in shots]
        unseen = open_source(behind).unpacked if behind else None
        joined, camera = side_by_side(views, unseen, count)
        _write(output, cameras, joined, camera)
    console.print(f"{in_view(joined, camera)} Gaussians in view")


def _write(output: Path, cameras: Path | None, scene: Scene, camera: Camera):
    """Write a scene and its camera, and print a line about them."""
    with files.whole_file(output) as part:
        write_ply(part, scene)
    if cameras:
        files.write(cameras, cameras_json([camera]).encode())
    console.print(f"{output}: {len(scene)} Gaussians, SH degree {scene.sh_degree}")


@command("info")
def info_command(
    reading: Marks,
    scene: str = SOURCE,
) -> dict:
    """Show the contents of a scene or packed model.

    Prints counts, extents, ranges of values, and notes on anything unusual.
    """
    notes.hush()  # they are in the table
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, Reading(**vars(reading)))
        facts = describe.describe(source)
    describe.table(facts, notes=True).print()
    return facts
