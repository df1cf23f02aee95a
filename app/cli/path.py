"""Commands with --cameras: one row per camera, then minimum, mean and maximum."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from splatcore.app.cli.describe import antialiased_line
from splatcore.app.cli.options import Cameras
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.table import NONE, Column, Table
from splatcore.sim.frame.metric import decibels
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import check_fits, check_one, check_source, open_path, open_source
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.renderable import check_renderable

FEW = 4
"""Number of views, spread evenly over all, from which a scene's packing is chosen."""

FOLDS = {"least": min, "mean": lambda values: sum(values) / len(values), "most": max}
"""Summaries of a column of numbers, by their JSON keys."""

LABELS = {"least": "min", "mean": "mean", "most": "max"}
"""Names of the summaries in the table."""


def check(view: Cameras, scheduler: str | None):
    """Raise InputError for options that do not go together."""
    check_one(view.camera, view.cameras)
    if scheduler and not view.cameras:
        raise InputError("--scheduler: goes with --cameras")


def open_all(scene: str, view: Cameras, machine: bool, **more) -> list[Shot]:
    """Open a scene and the frames of its cameras, whose file names must differ.

    machine: the machine renders them: it must be able to, and one packing is chosen for all
    more: other fields of the frames
    """
    check_source(scene, view.reading)
    cameras = view.reading.seen(open_path(view.cameras, view.size, scene))
    names = [file_name(camera) for camera in cameras]
    for camera, name in zip(cameras, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"--cameras {view.cameras}: two cameras have the name {camera.name}")
        if machine:
            check_fits(more["config"], camera.width, camera.height)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, view.reading)
    if machine and source.model is not None:
        check_renderable(more["config"], source.model)
    source.seen_by(*cameras)
    shots = [Shot(source, camera, **more) for camera in cameras]
    return packed_alike(shots) if machine else shots


def file_name(view: Camera) -> str:
    """Return a camera's name as a file name."""
    return re.sub(r"[^\w.+-]+", "-", view.name)


def packed_alike(shots: list[Shot]) -> list[Shot]:
    """Return frames with one packing of their scene, which `FEW` of them choose if it is open."""
    from splatcore.sim.frame.choose import quality_of

    first, some = shots[0], shots[:: -(-len(shots) // FEW)]
    if first.source.scene is None or first.quality:
        return shots
    with progress_bar(f"packing {first.source.name}"):
        quality = quality_of(first.source.scene, first.config, [shot.camera for shot in some])
    return [replace(shot, quality=quality) for shot in shots]


def along(
    function: Callable[..., dict],
    shots: list[Shot],
    arguments: tuple = (),
    scheduler: str | None = None,
) -> Iterator[dict]:
    """Yield `function(shot, *arguments)` for each frame of one scene, in order.

    The calls run in several processes, each of which opens the scene once. The function returns a
    row with the key `counts`; a note is printed for a view that shows nothing.
    scheduler: address of a Dask scheduler; None: processes of this computer
    """
    from splatcore.study.bench.campaign import Failure, Task, in_processes, on_cluster

    tasks = [Task(s.camera.name, "", of_shot, (function, s, arguments)) for s in shots]
    run = on_cluster(tasks, scheduler) if scheduler else in_processes(tasks)
    waiting, turn, scene = {}, 0, shots[0].source.name
    with progress_bar("views", len(tasks)) as advance:
        for done, (task, found) in enumerate(run, 1):
            if isinstance(found, Failure):
                raise InputError(f"{scene}: camera {found.what}: {found.why}")
            advance(done, len(tasks), f"{scene}: camera {task.name}")
            waiting[task.name] = found
            while turn < len(shots) and (found := waiting.pop(shots[turn].camera.name, None)):
                note_empty(shots[turn], found["counts"])
                yield found
                turn += 1


def of_shot(function: Callable[..., dict], shot: Shot, arguments: tuple) -> dict:
    """Worker: call a function with a frame."""
    return {"camera": shot.camera.name} | function(shot, *arguments)


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


ERRORS = [
    *(
        Column(f"dB, {name}", digits=2, get=partial(decibels, name=name))
        for name in ("machine", "scene")
    ),
    Column("dB, packing", digits=2, get="packing.psnr_db_packing"),
    Column("max error, machine", digits=4, get="max_error_machine"),
    Column("max error, scene", digits=4, get="max_error_scene"),
]
"""Columns of a machine's errors."""


def print_table(shot: Shot, rows: list[dict], columns: Sequence[Column], title: str) -> dict:
    """Print a table of rows and their summaries; return the content of `--json`.

    shot: one of the scene's frames
    columns: those without any value are left out
    """
    source, facts = shot.source, {name: folded(rows, fold) for name, fold in FOLDS.items()}
    lines = rows + [{"camera": LABELS[name]} | row for name, row in facts.items()]
    columns = [
        column for column in columns if any(column.cell(column.value(row)) != NONE for row in lines)
    ]
    strong = frozenset(range(len(rows), len(lines)))
    Table.of("path", title, [Column("camera"), *columns], lines, strong).print()
    console.print(f"{source.name}: {antialiased_line(source)}")
    if packing := rows[0].get("packing"):
        size = f"{packing['bytes_per_gaussian']:.2f} bytes per Gaussian"
        text = f"{source.name}: packed as {packing['quality']} for all cameras: {size}"
        console.print(text)
    return source.stated | {"views": rows} | facts
