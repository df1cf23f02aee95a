"""Many independent measurements: on all cores here, or on a cluster, each result kept at once.

A task is a function with arguments; what it returns is kept as a file of its own under a key that
stands for all that decides on it. A campaign that is begun again only does what is missing. A
worker that is lost takes no result with it: its tasks are done again, and one that loses its
worker twice is given up, named.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from splatcore.sim.accuracy.run import ONE_THREAD, environment
from splatcore.sim.common.output import messages, progress_bar, write
from splatcore.spec.error import InputError

SOURCES = (
    "spec/*.py",
    "model/**/*.py",
    "golden/*.py",
    "sim/cycles/*.py",
    "sim/bench/sweep.py",
    "sim/bench/workload.py",
)
"""What results come from: packing, the twins and the cycle model. A result of others is not ours.
"""

TRIES = 2
"""Workers that a task may lose before it is given up."""


@dataclass(frozen=True)
class Task:
    """`function(*arguments)` → a dict for a JSON file. name: of that file and in messages; `about`
    stands, with the sources, for all that decides on the result."""

    name: str
    about: str
    function: Callable[..., dict]
    arguments: tuple

    @property
    def key(self) -> str:
        return hashlib.sha256(f"{sources()}\0{self.about}".encode()).hexdigest()


@dataclass(frozen=True)
class Failure:
    """A task that came to nothing, and why."""

    what: str
    why: str


@cache
def sources(patterns: tuple[str, ...] = SOURCES) -> str:
    """Stands for the text of the files that the patterns name."""
    here, text = Path(__file__).parents[2], hashlib.sha256()
    for pattern in patterns:
        for path in sorted(here.glob(pattern)):
            text.update(path.read_bytes())
    return text.hexdigest()


def results(
    tasks: list[Task], folder: Path, scheduler: str | None, label: str
) -> Iterator[tuple[Task, dict | Failure]]:
    """What comes of each task, those first that are in the folder already.

    scheduler: address of a Dask scheduler; None: processes here. Workers need the scene files at
    the same paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = []
    for task in tasks:
        found = kept(folder, task)
        if found is None:
            missing.append(task)
        else:
            yield task, found
    if not missing:
        return
    run = on_cluster(missing, scheduler) if scheduler else in_processes(missing)
    with progress_bar(label, len(tasks)) as advance:
        advance(len(tasks) - len(missing), len(tasks))
        for done, (task, found) in enumerate(run, len(tasks) - len(missing) + 1):
            if isinstance(found, Failure):
                messages.print(f"{found.what}: {found.why}", markup=False, soft_wrap=True)
            else:
                write(path_of(folder, task), json.dumps({"key": task.key} | found).encode())
            advance(done, len(tasks), f"{label}: {task.name}")
            yield task, found


def path_of(folder: Path, task: Task) -> Path:
    """Where a task's result is kept."""
    return folder / f"{task.name}.json"


def kept(folder: Path, task: Task) -> dict | None:
    """A result that is there already; None if it is of other sources or cannot be read."""
    try:
        found = json.loads(path_of(folder, task).read_text())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("key") == task.key else None


def outcome(future: Future, task: Task) -> dict | Failure:
    """A task's result; what it raised is a failure of the task, not of the campaign."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except MemoryError:
        return Failure(task.name, "memory exhausted")
    except Exception as error:
        return Failure(task.name, f"{type(error).__name__}: {error}".splitlines()[0])


def as_done(pool: Executor, tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """Results in the order in which they come."""
    waiting = {pool.submit(task.function, *task.arguments): task for task in tasks}
    while waiting:
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in done:
            yield waiting[future], outcome(future, waiting[future])
            del waiting[future]


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Processes of one thread each."""
    pool = ProcessPoolExecutor(count, get_context("spawn"))
    try:
        with environment(ONE_THREAD):  # they start as work is submitted
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def in_processes(tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """On all cores. If a process is lost, all others end with it: what is left is done again, and
    the second time one by one, so that who loses it is known."""
    left = {task.name: task for task in tasks}
    for turn in range(TRIES):
        one_by_one = turn == TRIES - 1
        for some in [[task] for task in left.values()] if one_by_one else [list(left.values())]:
            try:
                with processes(1 if one_by_one else os.cpu_count() or 1) as pool:
                    for task, found in as_done(pool, some):
                        del left[task.name]
                        yield task, found
            except BrokenProcessPool:
                if one_by_one:
                    del left[some[0].name]
                    yield some[0], Failure(some[0].name, "lost its process, as without memory")
        if not left:
            return


def on_cluster(tasks: list[Task], address: str) -> Iterator[tuple[Task, dict | Failure]]:
    """By the workers of a Dask scheduler, which gives a lost worker's tasks to the others."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler: needs Dask; install it by pip install 'splatcore[cluster]'"
        ) from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: {error or 'no answer'}") from None
    with client, client.get_executor(retries=TRIES, pure=False) as pool:
        yield from as_done(pool, tasks)
