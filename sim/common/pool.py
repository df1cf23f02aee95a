"""Processes of one thread each that share independent work."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from multiprocessing.queues import Queue
from queue import Empty
from typing import TypeVar

from splatcore.sim.common import output

Item = TypeVar("Item")

CONTEXT = get_context("spawn")  # a fork would inherit locks of the libraries' threads

ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of the processes: threads that wait for each other while others work take longer."""

POLL = 0.2  # seconds between looks at the messages of the processes


@contextmanager
def processes(count: int, messages: Queue | None = None) -> Iterator[Executor]:
    """So many processes, which a failure or an interrupt ends. messages: where `send` puts them."""
    before = set(active_children())
    pool = ProcessPoolExecutor(count, CONTEXT, _begin, (messages,))
    added = {name: value for name, value in ONE_THREAD.items() if name not in os.environ}
    os.environ.update(added)  # the processes start as work is submitted
    try:
        yield pool
    except BaseException:
        for process in set(active_children()) - before:
            process.terminate()
        raise
    finally:
        for name in added:
            del os.environ[name]
        pool.shutdown(cancel_futures=True)


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
