"""The group of commands `bench`, and the options and functions that they share."""

from collections.abc import Iterable
from pathlib import Path

import typer

from splatcore.app.cli.options import OUTPUT, SCENE, App, app, argument, check_quality, option
from splatcore.sim.common.output import console, make_folder, messages, write_json
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.size import parse_size
from splatcore.sim.frame.source import VIEW_SIZE, check_fits, check_source
from splatcore.spec.config import Config

bench = App("bench", no_args_is_help=True, help="Measure many scenes or machines in one run.")
app.add_group(bench)

FolderOption = option(
    Path, "DIR", "Folder for results; results already there are kept.", "-o", "--out", panel=OUTPUT
)
ScenesArgument = argument(
    list[str] | None, "SCENE …", "Scenes. Default: all in the folder SPLATCORE_SCENES."
)
CamerasOption = option(
    str | None,
    "ID,ID,…",
    "Cameras in the file next to each scene. Default: the first; for kitchen.spz also "
    "kitchen_inside_0 and kitchen_inside_150.",
    panel=SCENE,
)
PixelsOption = option(str, "WxH", "Pixels of the pictures.", "--size", panel=SCENE)
SchedulerOption = option(
    str | None,
    "ADDRESS",
    "Dask scheduler, like tcp://host:8786, whose workers do the work; they must find the scene "
    "files at the same paths. Default: one process per core of this computer.",
)
SIZE = "x".join(map(str, VIEW_SIZE))


def look(
    output: Path, scene: list[str] | None, cameras: str | None, size: str,
    machines: Iterable[Config], quality: str | None = None, reading: Reading = AS_STATED,
) -> list[View]:  # fmt: skip
    """Check the arguments, make the output folder, and return the views to measure.

    Raises InputError for a picture too large for one of the machines.
    """
    for config in machines:
        check_fits(config, *parse_size(size))
    size = "x".join(map(str, parse_size(size)))
    check_quality(quality, *(scene or ()))
    for text in scene or ():
        check_source(text, reading)
    from splatcore.study.bench.scenes import views

    found = views(list(scene or ()), cameras, size, quality, reading)
    make_folder(output)
    return found


def view_of(text: str, size: str, quality: str | None = None, reading: Reading = AS_STATED) -> View:
    """Return the view that SCENE[:ID] names."""
    scene, _, camera = text.partition(":")
    check_quality(quality, scene)
    return View(scene, camera, size, quality=quality, reading=reading)


def finish(path: Path, facts: dict):
    """Write the result; list the failures again and exit with status 1 if any."""
    write_json(path, facts)
    console.print(str(path), soft_wrap=True)
    if facts["failed"]:
        for failure in facts["failed"]:
            messages.print(
                f"missing: {failure['what']}: {failure['why']}", markup=False, soft_wrap=True
            )
        raise typer.Exit(1)
