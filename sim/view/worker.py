"""A process that works for the page: the newest request wins, whatever is at work ends.

A process, not a thread: compiled loops hold Python's lock, and the page shall stay live.
"""

import os
import signal
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from splatcore.sim.common import output
from splatcore.sim.common.pool import CONTEXT
from splatcore.sim.common.reading import AS_STATED, Reading
from splatcore.sim.common.source import open_source
from splatcore.sim.view.studio import Request, Shown, Studio
from splatcore.spec.error import InputError

SECONDS = 2.0  # that a process gets to end


@dataclass(frozen=True)
class Progress:
    """What is being done, and how much of it is done (0 … 1; None: nobody knows)."""

    text: str
    share: float | None


@dataclass(frozen=True)
class Failed:
    """Why nothing comes of a request."""

    why: str


Receive = Callable[[Progress | Shown | Failed], None]


class Superseded(Exception):
    """A newer request is there."""


class Worker:
    """A process that holds a scene, and what is asked of it. `ask` and `cancel` come from any
    thread, answers to the newest request alone, in a thread of the worker's own. scene,
    reading: as `open_source` takes them."""

    def __init__(self, scene: str, reading: Reading = AS_STATED):
        self._lock, self._newest = threading.Lock(), CONTEXT.Value("q", 0)
        self._receive: Receive | None = None
        self._pipe, far = CONTEXT.Pipe()
        self._process = CONTEXT.Process(
            target=work, args=(scene, reading, far, self._newest), daemon=True,
            name="splatcore view",
        )  # fmt: skip
        self._process.start()
        far.close()
        threading.Thread(target=self._listen, daemon=True).start()

    def ask(self, request: Request, receive: Receive):
        """Have a request served instead of what was asked before."""
        with self._lock:
            self._newest.value += 1
            self._receive = receive
            try:
                self._pipe.send((self._newest.value, request))
            except OSError:
                receive(Failed(GONE))

    def cancel(self):
        """Have no request served."""
        with self._lock:
            self._newest.value += 1
            self._receive = None

    def close(self):
        """End the process and what it has started."""
        self.cancel()
        if self._process.is_alive():
            _kill(self._process.pid)
        self._process.join(SECONDS)

    def _listen(self):
        while True:
            try:
                number, answer = self._pipe.recv()
            except (EOFError, OSError):
                break
            with self._lock:
                receive = self._receive if number == self._newest.value else None
            if receive:
                receive(answer)
        if self._receive:
            self._receive(Failed(GONE))


GONE = "the process that renders has ended; start the viewer again"


def _kill(pid: int):
    """End a process with all of its group."""
    try:
        os.killpg(pid, signal.SIGTERM)
    except (ProcessLookupError, PermissionError):  # it has no group of its own yet
        os.kill(pid, signal.SIGTERM)


def work(scene: str, reading: Reading, pipe, newest):
    """In the worker's process: serve the newest request until the pipe ends."""
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process ends this one
    output.messages.quiet = True
    studio = Studio(open_source(scene, reading))
    while True:
        try:
            number, request = pipe.recv()
        except EOFError:
            return
        if number == newest.value:
            serve(studio, number, request, pipe.send, newest)


def serve(studio: Studio, number: int, request: Request, send: Callable, newest):
    """Send what comes of a request as long as it is the newest one."""

    def tell(text: str, share: float | None):
        if number != newest.value:
            raise Superseded
        send((number, Progress(text, share)))

    try:
        for shown in studio.steps(request, tell):
            send((number, shown))
            if number != newest.value:
                return
    except Superseded:
        return
    except InputError as error:
        send((number, Failed(str(error))))
    except Exception as error:
        traceback.print_exc()
        send((number, Failed(f"{type(error).__name__}: {error}")))
