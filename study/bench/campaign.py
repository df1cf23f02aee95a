"""Many independent measurements, on all local cores or on a cluster; each result is saved at once.

A task is a function with arguments. Its result is a file, stored with a key of everything that the
result depends on. A restarted campaign runs only the missing tasks. If a worker dies, its tasks
run again; a task that loses its worker twice is reported as a failure.
"""

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

from splatcore.sim.common import notes
from splatcore.sim.common.cache import with_key
from splatcore.sim.common.notes import with_notes
from splatcore.sim.common.output import messages, progress_bar, write
from splatcore.sim.common.pool import as_done, processes
from splatcore.sim.common.sources import code_key
from splatcore.sim.frame.shot import View
from splatcore.spec.cache import digest
from splatcore.spec.error import InputError

TRIES = 2  # workers that a task may lose before it counts as failed


@dataclass(frozen=True)
class Task:
    """A call `function(*arguments)` that returns a dict for a JSON file.

    name: of the file, and in messages
    about: key of the result, in addition to the code of the function and of all that it imports
    """

    name: str
    about: str
    function: Callable[..., dict]
    arguments: tuple

    @property
    def key(self) -> str:
        return digest([code_key(self.function), self.about])


@dataclass(frozen=True)
class Failure:
    """A failed task: its name and the reason."""

    what: str
    why: str


def results(
    tasks: list[Task], folder: Path, scheduler: str | None, label: str
) -> Iterator[tuple[Task, dict | Failure]]:
    """Yield each task with its result or failure, the results already in the folder first.

    scheduler: address of a Dask scheduler; None: local processes. Workers need the scene files at
        the same paths.
    label: of the progress bar
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
    """Collect results by task name, in any order, and failures as dicts for the result's file.

    Raises InputError if there are only failures.
    """
    found, failed = {}, []
    for task, result in results(tasks, folder / "parts", scheduler, label):
        if isinstance(result, Failure):
            failed.append(asdict(result))
        else:
            found[task.name] = result
    if failed and not found:
        raise InputError(f"{label}: all measurements failed")
    return found, failed


def rows_of_views(
    name: str,
    function: Callable[..., dict],
    views: list[View],
    folder: Path,
    scheduler: str | None,
    *arguments: object,
) -> tuple[list[dict], list[dict[str, str]]]:
    """Measure each view as a task; return the rows of all, in order, and the failures.

    function: (view, *arguments) → {"rows": […]}
    """
    tasks = [
        Task(file_name(f"{name} {view.name} {view.size}"), f"{view} {arguments}", function,
             (view, *arguments))
        for view in views
    ]  # fmt: skip
    results, failed = collected(tasks, folder, scheduler, name)
    return [row for task in tasks for row in results.get(task.name, {}).get("rows", ())], failed


def file_name(text: str) -> str:
    """A text as a name of a file."""
    return text.replace("/", "-").replace(":", "-")


def outcome(future: Future, task: Task) -> dict | Failure:
    """A task's result, or a `Failure` if it raised an error. Prints the notes of the worker."""
    try:
        found, lines = future.result()
        notes.add(*lines)
        return found
    except BrokenProcessPool:
        raise
    except MemoryError:
        return Failure(task.name, "out of memory")
    except Exception as error:
        return Failure(task.name, f"{type(error).__name__}: {error}".splitlines()[0])


def outcomes(pool: Executor, tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """Run tasks in a pool and yield results in order of completion."""
    waiting = {pool.submit(with_notes, task.function, *task.arguments): task for task in tasks}
    for task, future in as_done(waiting):
        yield task, outcome(future, task)


def in_processes(tasks: list[Task]) -> Iterator[tuple[Task, dict | Failure]]:
    """Run tasks on all local cores.

    If a process dies, all others end with it. The remaining tasks run again, one by one, which
    shows the task that kills its process.
    """
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
    """Run tasks on the workers of a Dask scheduler, which reassigns the tasks of lost workers."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler: needs Dask: pip install 'splatcore[cluster]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: {error or 'no answer'}") from None
    with client, client.get_executor(retries=TRIES, pure=False) as pool:
        yield from outcomes(pool, tasks)
