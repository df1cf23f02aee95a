"""Commands with --cameras: one row per camera, then minimum, mean and maximum."""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from splatcore.app.cli.describe import antialiased_line
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.frame.metric import decibels
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import (
    Source,
    check_fits,
    check_one,
    check_source,
    open_path,
    open_source,
)
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.renderable import check_renderable

FEW = 4
"""Number of views, spread evenly over all, from which a scene's packing is chosen."""

FOLDS = {"least": min, "mean": lambda values: sum(values) / len(values), "most": max}
"""Summaries of a column of numbers, by their JSON keys."""

LABELS = {"least": "min", "mean": "mean", "most": "max"}
"""Names of the summaries in the table."""


def check(camera: str | None, cameras: str | None, scheduler: str | None):
    """Raise InputError for options that do not go together."""
    check_one(camera, cameras)
    if scheduler and not cameras:
        raise InputError("--scheduler: goes with --cameras")


def open_all(
    cameras: str, size: str | None, scene: str, reading: Reading, config: Config | None
) -> tuple[Source, list[Camera]]:
    """Open a scene and its views, whose file names must differ.

    config: machine that must be able to render them; None: no machine
    """
    check_source(scene, reading)
    views = reading.seen(open_path(cameras, size, scene))
    names = [file_name(view) for view in views]
    for view, name in zip(views, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"--cameras {cameras}: two cameras have the name {view.name}")
        if config:
            check_fits(config, view.width, view.height)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, reading)
    if config and source.model is not None:
        check_renderable(config, source.model)
    source.seen_by(*views)
    return source, views


def file_name(view: Camera) -> str:
    """Return a camera's name as a file name."""
    return re.sub(r"[^\w.+-]+", "-", view.name)


def quality_of(source: Source, config: Config, views: list[Camera]) -> str | None:
    """Choose one packing of a scene for all views, from `FEW` of them."""
    from splatcore.sim.frame.choose import quality_of

    with progress_bar(f"packing {source.name}"):
        return quality_of(source, config, views[:: -(-len(views) // FEW)])


def along(
    function: Callable[..., dict],
    source: Source,
    views: list[Camera],
    arguments: tuple,
    scheduler: str | None,
) -> Iterator[dict]:
    """Yield `function(source, view, *arguments)` for each view, in order.

    The calls run in several processes, each of which opens the scene once. The function returns a
    row with the key `counts`; a note is printed for a view that shows nothing.
    scheduler: address of a Dask scheduler; None: processes of this computer
    """
    from splatcore.study.bench.campaign import Failure, Task, in_processes, on_cluster

    scene = source.name, source.reading
    tasks = [Task(v.name, "", of_scene, (function, scene, v, arguments)) for v in views]
    run = on_cluster(tasks, scheduler) if scheduler else in_processes(tasks)
    waiting, turn = {}, 0
    with progress_bar("views", len(tasks)) as advance:
        for done, (task, found) in enumerate(run, 1):
            if isinstance(found, Failure):
                raise InputError(f"{source.name}: camera {found.what}: {found.why}")
            advance(done, len(tasks), f"{source.name}: camera {task.name}")
            waiting[task.name] = found
            while turn < len(views) and (found := waiting.pop(views[turn].name, None)):
                note_empty(source, views[turn], found["counts"])
                yield found
                turn += 1


def of_scene(
    function: Callable[..., dict], scene: tuple[str, Reading], view: Camera, arguments: tuple
) -> dict:
    """Worker: call a function with a view of a scene, which is opened if the last one was another.

    scene: the arguments of `open_source`
    """
    from splatcore.study.bench.sweep import opened

    return {"camera": view.name} | function(opened(*scene), view, *arguments)


def folded(rows: Sequence[dict], fold: Callable[[list], float]) -> dict:
    """Fold the numbers of each key over all rows, also in nested objects.

    None is skipped; a key without any number is left out.
    """
    found = {}
    for key in rows[0]:
        values = [row[key] for row in rows if row[key] is not None]
        if values and isinstance(values[0], dict):
            found[key] = folded(values, fold)
        elif values and type(values[0]) in (int, float):
            found[key] = fold(values)
    return found


def cell(*keys: str, form: str = ",.0f", scale: float = 1) -> Callable[[dict], str]:
    """Return a function that formats the number under nested keys of a row."""

    def show(row: dict) -> str:
        for key in keys:
            row = None if row is None else row.get(key)
        return shown(row, form, scale)

    return show


ERRORS = {f"dB, {name}": partial(decibels, name=name) for name in ("machine", "scene")} | {
    "dB, packing": cell("packing", "psnr_db_packing", form=".2f"),
    "max error, machine": cell("max_error_machine", form=".4f"),
    "max error, scene": cell("max_error_scene", form=".4f"),
}
"""Columns of a machine's errors: heading → text of a row."""


def print_table(
    source: Source, rows: list[dict], columns: dict[str, Callable[[dict], str]], title: str
) -> dict:
    """Print a table of rows and their summaries; return the content of `--json`.

    columns: heading → function from a row to the text of a cell
    """
    facts = {name: folded(rows, fold) for name, fold in FOLDS.items()}
    lines = [(row["camera"], row) for row in rows]
    lines += [(LABELS[name], row) for name, row in facts.items()]
    cells = {name: [show(row) for _, row in lines] for name, show in columns.items()}
    cells = {name: texts for name, texts in cells.items() if set(texts) != {"–"}}
    table = new_table("camera", cells, title)
    for number, (name, _) in enumerate(lines):
        texts = (column[number] for column in cells.values())
        table.add_row(name, *texts, end_section=number == len(rows) - 1)
    print_whole(table)
    console.print(f"{source.name}: {antialiased_line(source)}", soft_wrap=True)
    if packing := rows[0].get("packing"):
        size = f"{packing['bytes_per_gaussian']:.2f} bytes per Gaussian"
        text = f"{source.name}: packed as {packing['quality']} for all cameras: {size}"
        console.print(text, soft_wrap=True)
    return source.stated | {"views": rows} | facts
