"""Runs of the program around the simulated machine, saved every so many cycles if wanted."""

import subprocess
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from splatcore.sim.common.output import make_folder, messages, write
from splatcore.sim.machine.script import MAPPED, Memory, Report, Script, Timing, read_report
from splatcore.sim.rtl.build import SimulationError
from splatcore.sim.rtl.verilator import state_of
from splatcore.spec.cache import digest
from splatcore.spec.error import InputError

IDLE_MAX = 200_000  # cycles without a transfer on the bus after which a run ends
CYCLES_MAX = 1 << 62
RESUMED = "resumed"  # the state from which it goes on
SUM = 8  # bytes of a checksum


class Saves:
    """Saves of a run, files CYCLE.save of a folder: a hash of everything that decides the run, the
    program's state, a checksum.

    every: cycles between saves; 0: none
    until: last cycle to go on from; None: any
    needed: whether there must be one
    """

    def __init__(
        self, folder: Path, every: int = 0, until: int | None = None, needed: bool = False
    ):
        self.folder, self.every, self.until, self.needed = folder, every, until, needed
        self.key = b""

    def begin(self, folder: Path, key: str) -> dict[str, str]:
        """Settings of a run in a folder, which goes on from the newest save.

        key: hash of everything that decides the run
        Raises InputError for a save that is damaged, of another run, or missing.
        """
        self.key, settings = key.encode(), {"save_every": str(self.every)}
        cycles = [int(path.stem) for path in self.folder.glob("*.save") if path.stem.isdigit()]
        found = [cycle for cycle in cycles if self.until is None or cycle <= self.until]
        if not found and self.needed:
            raise InputError(f"{self.folder}: has no save at or before cycle {self.until:,}")
        if self.every:
            make_folder(self.folder)
        if not found:
            return settings
        path = self.folder / f"{max(found)}.save"
        data = path.read_bytes()
        if _sum(data[:-SUM]) != data[-SUM:]:
            raise InputError(f"{path}: is damaged; delete it")
        if not data.startswith(self.key):
            raise InputError(f"{path}: is of another machine, scene or view; delete it")
        messages.print(f"{path}: the run goes on from here")
        (folder / RESUMED).write_bytes(data[len(self.key) : -SUM])
        return settings | {"resume": RESUMED}

    def keep(self, made: Path):
        """Move a save that the program has written, named "save.CYCLE", to the folder."""
        data = self.key + made.read_bytes()
        made.unlink()
        write(self.folder / f"{made.suffix[1:]}.save", data + _sum(data))


def prepare(
    folder: Path, script: Script, memory: Memory, timing: Timing, settings: Mapping[str, str]
) -> None:
    """Write `settings` and `script` into a run's folder. settings: limits and further lines."""
    lines = [*timing.settings, f"size {(folder / MAPPED).stat().st_size}"]
    lines += [f"{name.lower()} {script.addresses[name]}" for name in ("INTERRUPT", "FINISHED")]
    for r in memory.regions:
        lines.append(f"region {r.name} {r.begin} {r.end} {int(r.writable)} {r.at}")
    lines += [f"{name} {value}" for name, value in settings.items()]
    (folder / "settings").write_text("\n".join(lines) + "\n")
    (folder / "script").write_text("\n".join(script.lines) + "\n")


def execute(
    program: Path,
    folder: Path,
    script: Script,
    memory: Memory,
    timing: Timing,
    *,
    progress: Callable[[int, int], None] | None = None,
    idle_max: int = IDLE_MAX,
    cycles_max: int = CYCLES_MAX,
    settings: Mapping[str, str] | None = None,
    saves: Saves | None = None,
) -> Report:
    """Run a script on the memory file of a folder.

    progress: called twice per second with cycles and image bytes written
    settings: further lines for the program
    saves: where the run is saved and goes on from, if the program can do that
    Raises SimulationError if the program fails, InputError for a save of another run.
    """
    limits = {"idle_max": str(idle_max), "cycles_max": str(cycles_max)}
    if saves:
        made_from = [program.parent.parent.name, *timing.settings, script.lines, memory.regions]
        limits |= saves.begin(folder, digest([made_from, open_memory(folder)]))
    prepare(folder, script, memory, timing, limits | dict(settings or {}))
    with subprocess.Popen(
        [program, str(folder), *state_of(timing.seed)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as run:
        try:
            log = []
            for line in run.stdout:
                if line.startswith("progress "):
                    if progress:
                        progress(*map(int, line.split()[1:]))
                elif line.startswith("saved "):
                    saves.keep(folder / line.split()[1])
                else:
                    log.append(line)
        except BaseException:
            run.kill()
            raise
    if run.returncode:
        raise SimulationError(f"the simulation failed: {''.join(log[-5:])}")
    return read_report(folder / "report", script.config)


def open_memory(folder: Path) -> np.ndarray:
    """Map the memory file; its bytes stay readable after the folder is deleted."""
    return np.memmap(folder / MAPPED, np.uint8, "r")


def _sum(data: bytes) -> bytes:
    """Checksum of data."""
    return b"%08x" % zlib.crc32(data)
