"""Worker processes, of one thread each, for independent tasks."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.queues import Queue
from queue import Empty
from typing import TypeVar

from splatcore.sim.common import output

Item = TypeVar("Item")

CONTEXT = get_context("spawn")  # a fork would inherit locks of the libraries' threads

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of the workers: more threads than cores would slow all of them down."""

POLL = 0.2  # seconds between reads of the workers' messages


class _Remembering:
    """`CONTEXT` with a list of the processes it started."""

    def __init__(self):
        self.started = []

    def Process(self, *arguments, **options):
        self.started.append(CONTEXT.Process(*arguments, **options))
        return self.started[-1]

    def __getattr__(self, name: str):
        return getattr(CONTEXT, name)


@contextmanager
def processes(count: int, messages: Queue | None = None) -> Iterator[Executor]:
    """Yield a pool of `count` processes; a failure or an interrupt ends them.

    messages: queue for `send`

    Raises BrokenProcessPool, with the text of `how_ended`, if a process is lost.
    """
    context = _Remembering()
    pool = ProcessPoolExecutor(count, context, _begin, (messages,))
    added = {name: value for name, value in ONE_THREAD.items() if name not in os.environ}
    os.environ.update(added)  # the processes start as work is submitted
    try:
        yield pool
    except BaseException as error:
        for process in context.started:
            process.terminate()
        if not isinstance(error, BrokenProcessPool):
            raise
        pool.shutdown()  # joins the processes
        raise BrokenProcessPool(how_ended([p.exitcode for p in context.started])) from None
    finally:
        for name in added:
            del os.environ[name]
        pool.shutdown(cancel_futures=True)


def how_ended(codes: list[int]) -> str:
    """Return how the first lost process ended.

    codes: exit codes of all processes; the others ended (0) or were terminated (-SIGTERM)
    """
    lost = [code for code in codes if code not in (0, -signal.SIGTERM)]
    code = lost[0] if lost else -signal.SIGTERM
    if code > 0:
        return f"ended with status {code}"
    name = signal.Signals(-code).name
    return f"ended by signal {-code} ({name})" + ", maybe out of memory" * (name == "SIGKILL")


def as_done(
    waiting: dict[Future, Item],
    messages: Queue | None = None,
    report: Callable[..., None] | None = None,
) -> Iterator[tuple[Item, Future]]:
    """Yield items with their futures as these complete; call `report` with messages meanwhile."""
    while waiting:
        done, _ = wait(waiting, POLL if messages else None, FIRST_COMPLETED)
        while messages:
            try:
                report(*messages.get_nowait())
            except Empty:
                break
        for future in done:
            yield waiting.pop(future), future


def send(*message: object):
    """In a worker: send a message to the process that created the pool."""
    _messages.put(message)


def _begin(messages: Queue | None):
    """In a new worker: print no progress, and end silently on an interrupt."""
    global _messages
    output.messages.quiet = True
    _messages = messages
    signal.signal(signal.SIGINT, signal.SIG_DFL)
