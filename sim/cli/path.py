"""What commands do with all cameras of a file: a row for each, then least, mean and most."""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from splatcore.sim.common.describe import antialiased_line
from splatcore.sim.common.metric import decibels
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.source import (
    Source,
    check_fits,
    check_one,
    check_source,
    open_path,
    open_source,
)
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.common.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.renderable import check_renderable

FEW = 4
"""Views, spread evenly over all, for which a scene's packing is chosen."""

FOLDS = {"least": min, "mean": lambda values: sum(values) / len(values), "most": max}
"""What is said of a column of numbers."""


def check(camera: str | None, cameras: str | None, scheduler: str | None):
    """InputError for options that do not go together."""
    check_one(camera, cameras)
    if scheduler and not cameras:
        raise InputError("--scheduler: goes with --cameras")


def open_all(
    cameras: str, size: str | None, scene: str, reading: Reading, config: Config | None
) -> tuple[Source, list[Camera]]:
    """A scene and its views, each by a name of its own. config: the machine that renders them."""
    check_source(scene, reading)
    views = reading.seen(open_path(cameras, size, scene))
    names = [file_name(view) for view in views]
    for view, name in zip(views, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"--cameras {cameras}: two cameras are called {view.name}")
        if config:
            check_fits(config, view.width, view.height)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, reading)
    if config and source.model is not None:
        check_renderable(config, source.model)
    source.seen_by(*views)
    return source, views


def file_name(view: Camera) -> str:
    """A camera's name as that of a file."""
    return re.sub(r"[^\w.+-]+", "-", view.name)


def quality_of(source: Source, config: Config, views: list[Camera]) -> str | None:
    """How a scene is packed, once for all views: as `FEW` of them ask for."""
    from splatcore.sim.packing.choose import quality_of

    with progress_bar(f"packing {source.name}"):
        return quality_of(source, config, views[:: -(-len(views) // FEW)])


def along(
    function: Callable[..., dict],
    source: Source,
    views: list[Camera],
    arguments: tuple,
    scheduler: str | None,
) -> Iterator[dict]:
    """`function(source, view, *arguments)` of each view in their order, by several processes, which
    open the scene once. It returns a row with `counts`; a view that shows nothing is noted."""
    from splatcore.sim.bench.campaign import Failure, Task, in_processes, on_cluster

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
    """In a process: what a function makes of a view of the scene that was opened last. scene: the
    arguments of `open_source`."""
    from splatcore.sim.bench.sweep import opened

    return {"camera": view.name} | function(opened(*scene), view, *arguments)


def folded(rows: Sequence[dict], fold: Callable[[list], float]) -> dict:
    """One number of each key of rows, also in objects within; keys without a number are left out,
    and so is what is None."""
    found = {}
    for key in rows[0]:
        values = [row[key] for row in rows if row[key] is not None]
        if values and isinstance(values[0], dict):
            found[key] = folded(values, fold)
        elif values and type(values[0]) in (int, float):
            found[key] = fold(values)
    return found


def cell(*keys: str, form: str = ",.0f", scale: float = 1) -> Callable[[dict], str]:
    """What shows the number of a row that keys lead to."""

    def show(row: dict) -> str:
        for key in keys:
            row = None if row is None else row.get(key)
        return shown(row, form, scale)

    return show


ERRORS = {f"dB, {name}": partial(decibels, name=name) for name in ("machine", "scene")} | {
    "dB, packing": cell("packing", "psnr_db_packing", form=".2f"),
    "largest error, machine": cell("max_error_machine", form=".4f"),
    "largest error, scene": cell("max_error_scene", form=".4f"),
}
"""Columns of a machine's errors by heading."""


def tell(
    source: Source, rows: list[dict], columns: dict[str, Callable[[dict], str]], title: str
) -> dict:
    """Print a table of rows, whose columns are filled by functions; content of `--json`."""
    facts = {name: folded(rows, fold) for name, fold in FOLDS.items()}
    lines = [(row["camera"], row) for row in rows] + list(facts.items())
    cells = {name: [show(row) for _, row in lines] for name, show in columns.items()}
    cells = {name: texts for name, texts in cells.items() if set(texts) != {"–"}}
    table = new_table("camera", cells, title)
    for number, (name, _) in enumerate(lines):
        texts = (column[number] for column in cells.values())
        table.add_row(name, *texts, end_section=number == len(rows) - 1)
    print_whole(table)
    console.print(f"{source.name}: {antialiased_line(source)}", soft_wrap=True)
    if packing := rows[0].get("packing"):
        size = f"{packing['bytes_per_gaussian']:.2f} bytes a Gaussian"
        text = f"{source.name}: packed as {packing['quality']} for all cameras: {size}"
        console.print(text, soft_wrap=True)
    return source.stated | {"views": rows} | facts
