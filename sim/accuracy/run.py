"""Which scenes `splatcore error` measures, and how: two at a time, in processes of their own."""

import os
import re
import signal
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children, get_context
from pathlib import Path
from queue import Empty

from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.file import read_bytes
from splatcore.model.generate.generate import GENERATORS
from splatcore.model.generate.hard import HARD
from splatcore.sim.accuracy.points import Subject, measure_subject
from splatcore.sim.common.output import messages, progress_bar
from splatcore.sim.common.source import parse_size
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

PROCESSES = 2
"""Scenes that are measured at a time; one of half a million Gaussians takes 2 GB."""

POLL = 0.2
"""Seconds between looks at what the processes are at."""

VARIABLE, FOLDER = "SPLATCORE_SCENES", "../shared/scenes"
"""The environment's variable that names the folder of scenes, and the folder without it."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of the processes: threads that wait for each other while others work take longer."""

SUFFIXES = (".ply", ".spz", ".splat", ".sog")
"""Files of that folder that are scenes."""

CAMERAS = ".cameras.json"

NOT_POINTS = ("transmittance_edge", "unnormalised_quaternions", "not_finite", "empty")
"""Hard cases of which stages 0 and 1 see nothing: they are over in packing or begin in blending."""

HARD_CASES = tuple(name for name in HARD if name not in NOT_POINTS)


def named(sources: list[str], camera: str | None, size: str | None) -> list[Subject]:
    """The scenes that the command line names, each once; InputError for what cannot be opened."""
    check_view(camera, size)
    for source in sources:
        if source not in GENERATORS or os.path.exists(source):
            read_bytes(source, 4)
    return [
        Subject(source, source, camera or camera_beside(source), size, source in HARD)
        for source in dict.fromkeys(sources)
    ]


def everything(folder: str | None, camera: str | None, size: str | None) -> list[Subject]:
    """Every scene of a folder, else the garden; and the hard cases that concern points."""
    if camera:
        raise InputError("--camera: goes with a SCENE only")
    check_view(None, size)
    place = Path(folder or os.environ.get(VARIABLE, FOLDER))
    if place.is_dir():
        paths = sorted(path for path in place.iterdir() if path.suffix.lower() in SUFFIXES)
        if not paths:
            raise InputError(f"--scenes {place}: holds no scene ({', '.join(SUFFIXES)})")
        subjects = [Subject(p.name, str(p), camera_beside(p), size) for p in paths]
    elif folder:
        raise InputError(f"--scenes {folder}: there is no such folder")
    else:
        messages.print(f"no folder {place}: the generated garden stands in", soft_wrap=True)
        subjects = [Subject("garden", "garden", None, size)]
    return subjects + [Subject(name, name, hard=True) for name in HARD_CASES]


def check_view(camera: str | None, size: str | None):
    """InputError for options that no scene could be seen with."""
    if camera:
        read_camera(camera)
    if size:
        parse_size(size)


def camera_beside(source: str | Path) -> str | None:
    """The file of cameras of a scene file: the longest NAME.cameras.json whose NAME begins its.

    NAME ends where the file's own does or before a character that is no letter and no digit:
    leica-sofort.cameras.json goes with leica-sofort-top8192.ply.
    """
    source = Path(source)
    if source.suffix.lower() not in SUFFIXES:
        return None
    for end in range(len(source.name), 0, -1):
        path = source.with_name(source.name[:end] + CAMERAS)
        if re.match(r"\W|_", source.name[end:]) and path.is_file():
            return str(path)
    return None


def measured(
    subjects: list[Subject], machines: tuple[Config, ...]
) -> Iterator[tuple[Subject, dict]]:
    """What `measure_subject` says of each, as they become ready, behind a progress bar."""
    total = len(subjects) * (len(machines) + 1)
    doing, told = {}, 0
    with progress_bar("measuring", total) as advance:

        def tell(name: str, what: str):
            nonlocal told
            doing[name] = what
            label = ", ".join(f"{name}: {what}" for name, what in doing.items())
            advance(told, total, label)
            told += 1

        ready = in_processes if len(subjects) > 1 else in_turn
        for subject, facts in ready(subjects, machines, tell):
            del doing[subject.name]
            yield subject, facts


def in_turn(subjects, machines, tell) -> Iterator[tuple[Subject, dict]]:
    """Measures in this process."""
    for subject in subjects:
        yield subject, measure_subject(subject, machines, partial(tell, subject.name))


def in_processes(subjects, machines, tell) -> Iterator[tuple[Subject, dict]]:
    """Measures in processes of their own, which a failure or an interrupt ends."""
    context = get_context("spawn")  # a fork would inherit locks of the libraries' threads
    news = context.Queue()
    before = set(active_children())
    pool = ProcessPoolExecutor(PROCESSES, context, _begin, (news,))
    try:
        with environment(ONE_THREAD):  # the processes start as work is submitted
            waiting = {pool.submit(_work, subject, machines): subject for subject in subjects}
        while waiting:
            done, _ = wait(waiting, POLL, FIRST_COMPLETED)
            _pass_on(news, tell)
            for future in done:
                yield waiting.pop(future), future.result()
    except BrokenProcessPool:
        raise MemoryError from None  # what ends a process unasked
    except BaseException:
        for process in set(active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def environment(variables: dict[str, str]) -> Iterator[None]:
    """Sets variables that are not set, for a while."""
    added = {name: value for name, value in variables.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _pass_on(news, tell):
    """Tell what the processes have said so far."""
    while True:
        try:
            tell(*news.get_nowait())
        except Empty:
            return


def _begin(news):
    """In a new process: an interrupt ends it without a word."""
    global _news
    _news = news
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _work(subject: Subject, machines: tuple[Config, ...]) -> dict:
    return measure_subject(subject, machines, lambda what: _news.put((subject.name, what)))
