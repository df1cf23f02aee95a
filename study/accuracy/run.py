"""Scenes that `splatcore error` measures, two at a time, each in its own process."""

import os
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.model.generate.hard import HARD
from splatcore.model.generate.hard_colour import ANTIALIASED
from splatcore.sim.common import notes
from splatcore.sim.common.notes import with_notes
from splatcore.sim.common.output import messages, progress_bar
from splatcore.sim.common.pool import CONTEXT, as_done, processes, send
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.size import shape_of
from splatcore.sim.frame.source import SUFFIXES, scene_files, scene_folder
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.study.accuracy.points import measure_view

PROCESSES = 2  # scenes measured at a time; one of half a million Gaussians takes 2 GB

NOT_POINTS = ("transmittance_edge", "unnormalised_quaternions", "not_finite", "empty")
"""Hard cases that do not concern stages 0 and 1: packing removes them, or they concern blending."""

HARD_CASES = tuple(name for name in HARD if name not in (*NOT_POINTS, *ANTIALIASED))
"""Hard cases that machines of all number widths can render."""


def named(
    sources: list[str], camera: str | None, size: str | None, reading: Reading = AS_STATED
) -> dict[str, View]:
    """Views of the scenes on the command line, without duplicates.

    Raises InputError for a file that cannot be opened.
    """
    check_view(camera, size)
    for source in sources:
        if source not in GENERATORS or os.path.exists(source):
            read_bytes(source, 4)
    common = {"size": size, "file": camera, "reading": reading}
    return {source: View(source, **common) for source in sources}


def everything(
    folder: str | None, camera: str | None, size: str | None, reading: Reading = AS_STATED
) -> dict[str, View]:
    """All scenes of a folder, else the garden, and the hard cases of stages 0 and 1, by name.

    reading: applies to the scenes, not to the hard cases
    """
    if camera:
        raise InputError("--camera: goes with a SCENE only")
    check_view(None, size)
    place = Path(folder) if folder else scene_folder()
    if place.is_dir():
        paths = scene_files(place)
        if not paths:
            raise InputError(f"--scenes {place}: holds no scene ({', '.join(SUFFIXES)})")
        views = {path.name: View(str(path), size=size, reading=reading) for path in paths}
    elif folder:
        raise InputError(f"--scenes {folder}: no such folder")
    else:
        messages.print(f"no folder {place}: using the generated garden instead", soft_wrap=True)
        views = {"garden": View("garden", size=size, reading=reading)}
    return views | {name: View(name) for name in HARD_CASES}


def check_view(camera: str | None, size: str | None):
    """Raise InputError for a size or a camera file that cannot be used."""
    shape = shape_of(size)
    if camera:
        read_camera(camera, shape)


def measured(views: dict[str, View], machines: tuple[Config, ...]) -> Iterator[tuple[str, dict]]:
    """Yield each view's name and its result of `measure_view`, in order of completion."""
    total = len(views) * (len(machines) + 1)
    doing, begun = {}, 0
    with progress_bar("measuring", total) as advance:

        def progress(name: str, step: str):
            nonlocal begun
            doing[name] = step
            label = ", ".join(f"{name}: {step}" for name, step in doing.items())
            advance(begun, total, label)
            begun += 1

        ready = in_processes if len(views) > 1 else in_turn
        for name, facts in ready(views, machines, progress):
            del doing[name]
            yield name, facts


def in_turn(views, machines, progress) -> Iterator[tuple[str, dict]]:
    """Measure the views one after the other in this process."""
    for name, view in views.items():
        yield name, measure_view(view, machines, partial(progress, name))


def in_processes(views, machines, progress) -> Iterator[tuple[str, dict]]:
    """Measure the views in worker processes, which a failure or an interrupt ends."""
    news = CONTEXT.Queue()
    try:
        with processes(PROCESSES, news) as pool:
            waiting = {
                pool.submit(with_notes, measure_view, view, machines, partial(send, name)): name
                for name, view in views.items()
            }
            for name, future in as_done(waiting, news, progress):
                facts, lines = future.result()
                notes.add(*lines)
                yield name, facts
    except BrokenProcessPool as error:
        raise InputError(f"measuring views: a process {error}") from None
