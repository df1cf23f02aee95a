"""A command in a process of its own: seconds, peak memory, and why it failed.

A command that fails, or is killed, is a result as any other.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from splatcore.sim.common.pool import how_ended
from splatcore.spec.error import InputError
from splatcore.spec.need import anonymous
from splatcore.study.results.scale import Cost

SAMPLE = 0.02  # seconds between samples of memory
PATIENCE = 10  # seconds for an interrupted command to end by itself

START = """
import runpy, sys
folder, start = sys.argv[1:3]
del sys.argv[1:3]
sys.path.insert(0, start)
import splatcore
splatcore.__path__.append(folder)
runpy.run_module("splatcore", run_name="__main__", alter_sys=True)
"""
"""Program that runs the command line of a checkout whose rooms are folders of its root."""


@dataclass(frozen=True)
class Checkout:
    """A copy of the repository. folder: its root; None: the running one"""

    folder: Path | None = None

    @property
    def words(self) -> list[str]:
        """The words before a command's: its own virtual environment's Python, else this one."""
        if self.folder is None:
            return [sys.executable, "-m", "splatcore"]
        own = self.folder / ".venv" / "bin" / "python"
        if own.exists():
            return [str(own), "-m", "splatcore"]
        for start in (self.folder / "src", self.folder):
            if (start / "splatcore" / "__main__.py").exists():
                return [sys.executable, "-c", START, str(self.folder), str(start)]
        raise InputError(f"--against {self.folder}: is no checkout of Splatcore")

    @property
    def variables(self) -> dict[str, str]:
        """The environment, without the running checkout's path for another one."""
        mine = () if self.folder is None else ("PYTHONPATH",)
        return {name: value for name, value in os.environ.items() if name not in mine}

    def measured(
        self, command: Sequence[str], folder: Path, variables: Mapping[str, str] | None = None
    ) -> Cost:
        """Run a command in a folder, in a process of its own.

        variables: further ones of its environment
        """
        with tempfile.TemporaryFile("w+") as text:
            begin = time.monotonic()
            process = subprocess.Popen(
                [*self.words, *command], cwd=folder, env=self.variables | dict(variables or {}),
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=text,
                start_new_session=True,  # Ctrl-C does not reach it twice
            )  # fmt: skip
            try:
                usage, peak = _watched(process)
            except BaseException:
                _ended(process)
                raise
            text.seek(0)
            lines = text.read().splitlines()
        return Cost(
            cpu_seconds=round(usage.ru_utime + usage.ru_stime, 3),
            wall_seconds=round(time.monotonic() - begin, 3), peak_bytes=peak,
            why=_why(process.returncode, lines),
        )  # fmt: skip


def _watched(process: subprocess.Popen):
    """Wait for a process; return its resource usage, children included, and its peak memory."""
    peak = None
    while True:
        found = anonymous(process.pid)
        peak = peak if found is None else max(peak or 0, found)
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return usage, peak
        time.sleep(SAMPLE)


def _ended(process: subprocess.Popen):
    """End a process, by an interrupt if possible, so that it cleans up."""
    try:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _why(code: int, lines: list[str]) -> str:
    """Return why a command failed: the last line on standard error, else how its process ended."""
    if not code:
        return ""
    last = lines[-1].removeprefix("error: ") if lines and code > 0 else ""
    return last or how_ended([code])
