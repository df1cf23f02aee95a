"""A worker process of the page: a new request cancels the current one.

It is a process, not a thread, because compiled loops hold Python's lock and would block the page.
A signal interrupts its work at the next line of Python; packing continues while only the camera
moves, as the next request needs the same model.
"""

import os
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from splatcore.app.view.studio import Request, Shown, Studio
from splatcore.sim.common import output
from splatcore.sim.common.pool import CONTEXT
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.source import open_source
from splatcore.spec.error import InputError

SECONDS = 2.0  # timeout for a process to end

INTERRUPT = signal.SIGUSR1  # sent to the process after a new request or a cancellation


@dataclass(frozen=True)
class Progress:
    """The current step, and the share done (0 … 1; None: unknown)."""

    text: str
    share: float | None


@dataclass(frozen=True)
class Failed:
    """The reason why a request failed."""

    why: str


Receive = Callable[[Progress | Shown | Failed], None]


class Superseded(Exception):
    """A newer request has arrived."""


class Worker:
    """A process that serves requests for pictures of a scene.

    `ask` and `cancel` may be called from any thread. Only answers to the newest request are
    delivered, in a thread of the worker.
    scene, reading: arguments of `open_source`
    """

    def __init__(self, scene: str, reading: Reading = AS_STATED):
        self._lock, self._ready = threading.Lock(), CONTEXT.Event()
        self._newest, self._changed = CONTEXT.Value("q", 0), CONTEXT.Value("q", 0)
        self._receive: Receive | None = None
        self._machine: tuple | None = None  # of the last request
        self._pipe, far = CONTEXT.Pipe()
        self._process = CONTEXT.Process(
            target=work, args=(scene, reading, far, self._newest, self._changed, self._ready),
            daemon=True, name="splatcore view",
        )  # fmt: skip
        self._process.start()
        far.close()
        threading.Thread(target=self._listen, daemon=True).start()

    def ask(self, request: Request, receive: Receive):
        """Send a request, which replaces the previous one."""
        machine = request.config, request.quality
        with self._lock:
            self._newest.value += 1
            if machine != self._machine:
                self._machine, self._changed.value = machine, self._newest.value
            self._receive = receive
            try:
                self._pipe.send((self._newest.value, request))
            except OSError:
                receive(Failed(GONE))
            self._interrupt()

    def cancel(self):
        """Cancel the current request."""
        with self._lock:
            self._newest.value += 1
            self._receive = None
            self._interrupt()

    def _interrupt(self):
        """Make the process look for a newer request; it cannot before it has a handler."""
        if self._ready.is_set() and self._process.is_alive():
            with suppress(ProcessLookupError):
                os.kill(self._process.pid, INTERRUPT)

    def close(self):
        """End the process and its children."""
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
    """End a process and its group."""
    try:
        os.killpg(pid, signal.SIGTERM)
    except (ProcessLookupError, PermissionError):  # the group does not exist yet
        os.kill(pid, signal.SIGTERM)


def work(scene: str, reading: Reading, pipe, newest, changed, ready):
    """Main function of the process: serve the newest request until the pipe is closed."""
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process ends this one
    signal.signal(INTERRUPT, signal.SIG_IGN)
    ready.set()
    output.messages.quiet = True
    studio = Studio(open_source(scene, reading))
    while True:
        try:
            number, request = pipe.recv()
        except EOFError:
            return
        if number == newest.value:
            with suppress(Superseded):  # a signal may arrive as `serve` returns
                serve(studio, number, request, pipe.send, newest, changed)


def serve(studio: Studio, number: int, request: Request, send: Callable, newest, changed):
    """Send the answers to a request as long as it is the newest one.

    newest: number of the newest request
    changed: number of the last request for another machine or quality than the one before
    """
    sending = False

    def check(*_):
        """Raise Superseded if the work is no longer needed; an answer is sent completely."""
        if not sending and (changed if studio.packing else newest).value > number:
            raise Superseded

    def answer(shown: Progress | Shown | Failed):
        nonlocal sending
        sending = True
        send((newest.value if studio.packing else number, shown))
        sending = False

    def report(text: str, share: float | None):
        check()
        answer(Progress(text, share))

    before = signal.signal(INTERRUPT, check)
    try:
        for shown in studio.steps(request, report):
            check()
            answer(shown)
    except Superseded:
        return
    except InputError as error:
        answer(Failed(str(error)))
    except Exception as error:
        traceback.print_exc()
        answer(Failed(f"{type(error).__name__}: {error}"))
    finally:
        signal.signal(INTERRUPT, before)
