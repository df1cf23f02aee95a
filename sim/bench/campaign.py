"""Many independent measurements: on all cores here, or on a cluster, each result kept at once.

A task is a function with arguments; what it returns is kept as a file of its own under a key that
stands for all that decides on it. A campaign that is begun again does only what is missing. A
worker that is lost takes no result with it: its tasks are done again, and one that loses its
worker twice is given up, named.
"""

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

from splatcore.sim.common import notes
from splatcore.sim.common.cache import digest, with_key
from splatcore.sim.common.notes import with_notes
from splatcore.sim.common.output import messages, progress_bar, write
from splatcore.sim.common.pool import as_done, processes
from splatcore.sim.common.sources import code_key
from splatcore.spec.error import InputError

TRIES = 2  # workers that a task may lose before it is given up


@dataclass(frozen=True)
class Task:
    """`function(*arguments)` → a dict for a JSON file. name: of that file and in messages; `about`
    stands, with the function's code and all that it imports, for all that decides on the result."""

    name: str
    about: str
    function: Callable[..., dict]
    arguments: tuple

    @property
    def key(self) -> str:
        return digest([code_key(self.function), self.about])


@dataclass(frozen=True)
class Failure:
    """A task that came to nothing, and why."""

    what: str
    why: str


def results(
    tasks: list[Task], folder: Path, scheduler: str | None, label: str
) -> Iterator[tuple[Task, dict | Failure]]:
    """The result or failure of each task, those first that are in the folder already.

    scheduler: address of a Dask scheduler; None: processes here. Workers need the scene files at
    the same paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = []
    for task in tasks:
        found = with_key(folder / f"{task.name}.json", task.key)
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
                data = json.dumps({"key": task.key} | found).encode()
                write(folder / f"{task.name}.json", data)
            advance(done, len(tasks), f"{label}: {task.name}")
            yield task, found


def collected(
    tasks: list[Task], folder: Path, scheduler: str | None, label: str
) -> tuple[dict[str, dict], list[dict[str, str]]]:
    """Results of the tasks by name, in any order, and the failures, as results' files have them;
    InputError if there are only failures."""
    found, failed = {}, []
    for task, result in results(tasks, folder / "parts", scheduler, label):
        if isinstance(result, Failure):
            failed.append(asdict(result))
        else:
            found[task.name] = result
    if failed and not found:
        raise InputError(f"{label}: nothing could be measured")
    return found, failed


def outcome(future: Future, task: Task) -> dict | Failure:
    """A task's result; what it raised is a failure of the task, not of the campaign. Notes of the
    worker are told here."""
    try:
        found, lines = future.result()
        notes.add(*lines)
        return found
    except BrokenProcessPool:
        raise
    except MemoryError:
        return Failure(task.name, "memory exhausted")
    except Exception as error:
        return Failure(task.name, f"{type(error).__name__}: {error}".splitlines()[0])


def outcomes(pool: Executor, tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """Results in the order in which they come."""
    waiting = {pool.submit(with_notes, task.function, *task.arguments): task for task in tasks}
    for task, future in as_done(waiting):
        yield task, outcome(future, task)


def in_processes(tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """On all cores. If a process is lost, all others end with it: what is left is done again, and
    the second time one by one, so that who loses it is known."""
    left = {task.name: task for task in tasks}
    for turn in range(TRIES):
        one_by_one = turn == TRIES - 1
        for some in [[task] for task in left.values()] if one_by_one else [list(left.values())]:
            try:
                with processes(1 if one_by_one else os.cpu_count() or 1) as pool:
                    for task, found in outcomes(pool, some):
                        del left[task.name]
                        yield task, found
            except BrokenProcessPool as error:
                if one_by_one:
                    del left[some[0].name]
                    yield some[0], Failure(some[0].name, f"its process {error}")
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
        yield from outcomes(pool, tasks)
