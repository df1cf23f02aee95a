"""The group of commands `bench`, and the options that they share."""

from collections.abc import Iterable
from pathlib import Path

import typer

from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.cli.options import App, app, argument, option
from splatcore.sim.common.output import console, make_folder, messages, write_json
from splatcore.sim.common.reading import AS_STATED, Reading
from splatcore.sim.common.size import parse_size
from splatcore.sim.common.source import VIEW_SIZE, View, check_fits, check_known, check_source
from splatcore.spec.config import Config

bench = App(no_args_is_help=True, help="Measure cycles of the hardware, compiled and simulated.")
app.add_typer(bench, name="bench")

FolderOption = option(Path, "DIR", "Folder for results; kept results stay.", "-o", "--out")
ScenesArgument = argument(
    list[str] | None, "SCENE …", "Default: all in the folder SPLATCORE_SCENES."
)
CamerasOption = option(str | None, "ID,ID,…", "Default: each scene's first, and more.")
PixelsOption = option(str, "WxH", "Pixels.", "--size")
SchedulerOption = option(
    str | None,
    "ADDRESS",
    "A Dask scheduler, like tcp://host:8786, whose workers do the work; they read the scene files "
    "at the same paths. Default: processes here, one for each core.",
)
SIZE = "x".join(map(str, VIEW_SIZE))


def look(
    output: Path, scene: list[str] | None, cameras: str | None, size: str,
    machines: Iterable[Config], quality: str | None = None, reading: Reading = AS_STATED,
) -> list[View]:  # fmt: skip
    """The views to measure by some machines; makes the folder."""
    for config in machines:
        check_fits(config, *parse_size(size))
    size = "x".join(map(str, parse_size(size)))
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
    for text in scene or ():
        check_source(text, reading)
    from splatcore.sim.bench.scenes import views

    found = views(list(scene or ()), cameras, size, quality, reading)
    make_folder(output)
    return found


def view_of(text: str, size: str, quality: str | None = None, reading: Reading = AS_STATED) -> View:
    """The view of SCENE[:ID]."""
    scene, _, camera = text.partition(":")
    return View(scene, camera, size, quality=quality, reading=reading)


def finish(path: Path, facts: dict):
    """Write the result; what failed is listed again, and is an exit status of 1."""
    write_json(path, facts)
    console.print(str(path), soft_wrap=True)
    if facts["failed"]:
        for failure in facts["failed"]:
            messages.print(
                f"missing: {failure['what']}: {failure['why']}", markup=False, soft_wrap=True
            )
        raise typer.Exit(1)
