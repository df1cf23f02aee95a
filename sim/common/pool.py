"""Processes of one thread each that share independent work."""

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
"""Environment of the processes: threads that wait for each other while others work take longer."""

POLL = 0.2  # seconds between looks at the messages of the processes


class _Remembering:
    """`CONTEXT` that remembers its processes."""

    def __init__(self):
        self.started = []

    def Process(self, *arguments, **options):
        self.started.append(CONTEXT.Process(*arguments, **options))
        return self.started[-1]

    def __getattr__(self, name: str):
        return getattr(CONTEXT, name)


@contextmanager
def processes(count: int, messages: Queue | None = None) -> Iterator[Executor]:
    """So many processes, which a failure or an interrupt ends. messages: where `send` puts them.

    If a process is lost, the text of the BrokenProcessPool says how it ended (`how_ended`).
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
    """How the first process that was lost ended, by the exit codes of all: the others have ended
    (0) or were terminated for its sake."""
    lost = [code for code in codes if code not in (0, -signal.SIGTERM)]
    code = lost[0] if lost else -signal.SIGTERM
    if code > 0:
        return f"ended with status {code}"
    name = signal.Signals(-code).name
    return f"ended by signal {-code} ({name})" + ", as without memory" * (name == "SIGKILL")


def as_done(
    waiting: dict[Future, Item],
    messages: Queue | None = None,
    tell: Callable[..., None] | None = None,
) -> Iterator[tuple[Item, Future]]:
    """Items and their futures, as these are done; `tell` is called with the messages meanwhile."""
    while waiting:
        done, _ = wait(waiting, POLL if messages else None, FIRST_COMPLETED)
        while messages:
            try:
                tell(*messages.get_nowait())
            except Empty:
                break
        for future in done:
            yield waiting.pop(future), future


def send(*message: object):
    """In a process of a pool: a message to the process that made it."""
    _messages.put(message)


def _begin(messages: Queue | None):
    """In a new process: an interrupt ends it without a word, and its progress is told nowhere."""
    global _messages
    output.messages.quiet = True
    _messages = messages
    signal.signal(signal.SIGINT, signal.SIG_DFL)
