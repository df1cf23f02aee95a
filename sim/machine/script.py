"""The script of the simulated host, command by command, and the report of its run."""

import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from splatcore.sim.common.source import check_known
from splatcore.sim.rtl.build import SimulationError
from splatcore.sim.rtl.initial import state_of
from splatcore.spec.axi import READERS, WRITERS, port_bytes, read_bytes
from splatcore.spec.config import Config
from splatcore.spec.registers import addresses

IDLE_MAX = 200_000  # cycles without any movement on the bus after which a waiting host gives up

CYCLES_MAX = 1 << 62

RESET_CYCLES = 4

MAPPED = "memory"  # file of a run's folder with the bytes that the machine sees

REASONS = {
    "done": "the script was done",
    "error": "the machine reported an error",
    "hang": "nothing moved on the bus",
    "limit": "the limit of cycles was reached",
    "rule": "a rule of AXI was broken",
}


GOING_WRONG = tuple(
    f"{way}_{what}" for what in ("errors", "strays", "missing") for way in ("read", "write")
)
"""Settings of memory that list the numbers of what goes wrong (`Timing`)."""


@dataclass(frozen=True)
class Timing:
    """Behaviour of memory (`memory.hpp`).

    latency: cycles from a request to its first beat. bandwidth: bytes a cycle, shared by reads and
    writes; 0 for any number. granule: bytes that an access moves at least. outstanding: requests of
    a path that memory takes before the first is answered. stall: probability with which a side of
    memory (and of the host) idles in a cycle, drawn from `seed`, as is what registers and
    memories of the machine begin with. read_errors, write_errors: numbers
    of read beats and of written bursts, from 0 on, that are answered by an error. read_strays,
    write_strays: those before whose answer there is one that nobody has asked for. read_missing,
    write_missing: those that are never answered.
    """

    name: str
    latency: int
    bandwidth: float = 0.0
    granule: int = 0
    outstanding: int = 64
    stall: float = 0.0
    seed: int = 0
    read_errors: tuple[int, ...] = ()
    write_errors: tuple[int, ...] = ()
    read_strays: tuple[int, ...] = ()
    write_strays: tuple[int, ...] = ()
    read_missing: tuple[int, ...] = ()
    write_missing: tuple[int, ...] = ()

    @property
    def settings(self) -> list[str]:
        """Lines for the program."""
        names = ("latency", "bandwidth", "granule", "outstanding", "stall", "seed")
        lines = [f"{name} {getattr(self, name)}" for name in names]
        for name in GOING_WRONG:
            lines += [f"{name} {number}" for number in getattr(self, name)]
        return lines


IDEAL = Timing("ideal", latency=4)  # as good as memory on the chip

LPDDR4 = Timing("lpddr4", latency=80, bandwidth=32.0, granule=32)
"""64 bits of LPDDR4-3200 (JEDEC JESD209-4), seen at the paper's clock of 800 MHz.

3200 million transfers a second of 8 bytes are 25.6 GB/s, 32 bytes a cycle. A burst of 16 transfers
on one of the four 16-bit channels, the least that is moved, is 32 bytes. 100 ns = 80 cycles of
latency are a guess on the safe side: 18 ns to open a row, 17.5 ns to read, 5 ns for the burst, and
60 ns for controller, physical interface and interconnect. Refresh, turns of the bus and conflicts
of banks are left out: they would take 10 to 30 % of the bandwidth.
"""

TIMINGS = {timing.name: timing for timing in (IDEAL, LPDDR4)}


def find_timing(name: str) -> Timing:
    """The timing of that name; InputError lists the names."""
    if name.lower() not in TIMINGS:
        check_known("--timing", TIMINGS, name)
    return TIMINGS[name.lower()]


@dataclass(frozen=True)
class Region:
    """Bytes of memory that the machine may read, and write if `writable`. begin: its address; at:
    its place in memory's file."""

    name: str
    begin: int
    size: int
    writable: bool
    at: int

    @property
    def end(self) -> int:
        return self.begin + self.size


class Memory(Protocol):
    """Facts of memory that `execute` needs."""

    regions: tuple[Region, ...]


@dataclass
class Script:
    """Commands of the host; each method that brings a result returns its number in the report."""

    config: Config
    lines: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.addresses = addresses(self.config)

    def _add(self, line: str) -> int:
        self.lines.append(line)
        return len(self.lines) - 1

    def write(self, register: str | int, value: int) -> int:
        """register: its name, or an address."""
        return self._add(f"write {self.addresses.get(register, register)} {value}")

    def read(self, register: str | int) -> int:
        return self._add(f"read {self.addresses.get(register, register)}")

    def wait(self, mask: int) -> int:
        """Until a bit of INTERRUPT in `mask` has been set; what is set is cleared and kept."""
        return self._add(f"wait {mask}")

    def cycles(self, count: int) -> int:
        return self._add(f"cycles {count}")

    def reset(self, count: int = RESET_CYCLES) -> int:
        """Reset the machine; memory forgets what it was asked for."""
        return self._add(f"reset {count}")

    def save(self, address: int, size: int, file: str) -> int:
        """Keep what lies in memory now in a file of the run's folder."""
        return self._add(f"save {address} {size} {file}")

    def last_part(self) -> int:
        """All that follows is done in any case, after an error too."""
        return self._add("finally")


PIXELS_WRITTEN = "write_pixels"


def beat_bytes(config: Config, cause: str) -> int:
    """Bytes of a beat, by "read_" or "write_" and who reads or writes."""
    kind, _, client = cause.partition("_")
    return read_bytes(config, client) if kind == "read" else port_bytes(config)


@dataclass(frozen=True)
class Answer:
    """Answer to a command. cycle: when it was through; response: of AXI4-Lite."""

    cycle: int
    value: int
    response: int


@dataclass
class Report:
    """A run. config: the machine. answers: by the number of the command, for those
    that were done. events: cycle and bits of each interrupt. read, written: beats by reader and
    writer. asked: read beats and written bursts that memory was asked for, as those that go wrong
    are counted. regions: bytes read and written. outside: accesses that no region allows, the first
    ones told. rule: of AXI that was broken. command: that the script was at."""

    config: Config
    result: str = ""
    cycles: int = 0
    command: int = 0
    rule: str = ""
    answers: dict[int, Answer] = field(default_factory=dict)
    events: list[tuple[int, int]] = field(default_factory=list)
    read: dict[str, int] = field(default_factory=dict)
    written: dict[str, int] = field(default_factory=dict)
    asked: tuple[int, int] = (0, 0)
    regions: dict[str, tuple[int, int]] = field(default_factory=dict)
    outside: int = 0
    outside_told: list[str] = field(default_factory=list)
    window: tuple[int, int] | None = None

    @property
    def done(self) -> bool:
        """True if the script came to its end without an error."""
        return self.result == "done"

    @property
    def why(self) -> str:
        """The result in words."""
        text = f"{REASONS[self.result]}, cycle {self.cycles}, command {self.command}"
        text += f": {self.rule}" if self.rule else ""
        told = self.outside_told[0] if self.outside else ""
        return text + (f"; {self.outside} accesses outside of memory: {told}" if told else "")

    @property
    def traffic(self) -> dict[str, int]:
        """Bytes by cause: whole beats, but of pixels only those that are written."""
        found = {f"read_{name}": beats for name, beats in self.read.items()}
        found |= {f"write_{name}": beats for name, beats in self.written.items()}
        found = {cause: beats * beat_bytes(self.config, cause) for cause, beats in found.items()}
        images = [written for name, (_, written) in self.regions.items() if "image" in name]
        return found | ({PIXELS_WRITTEN: sum(images)} if PIXELS_WRITTEN in found else {})


def read_report(path: Path, config: Config) -> Report:
    """The report that the program has written."""
    report, readers, writers = Report(config), list(READERS), list(WRITERS)
    for line in path.read_text().splitlines():
        kind, *rest = line.split()
        if kind.isdigit():
            cycle, value, response = map(int, rest)
            report.answers[int(kind)] = Answer(cycle, value, response)
        elif kind == "event":
            report.events.append((int(rest[0]), int(rest[1])))
        elif kind == "read":
            report.read[readers[int(rest[0])]] = int(rest[1])
        elif kind == "written":
            report.written[writers[int(rest[0])]] = int(rest[1])
        elif kind == "asked":
            report.asked = int(rest[1]), int(rest[2])
        elif kind == "region":
            report.regions[rest[0]] = int(rest[1]), int(rest[2])
        elif kind == "outside":
            report.outside = int(rest[1])
        elif kind == "told":
            what, number, address, size, cycle = rest
            name = (readers if what == "read" else writers)[int(number)]
            text = f"{what} of {name}, {size} bytes at 0x{int(address):x}, cycle {cycle}"
            report.outside_told.append(text)
        elif kind == "window":
            report.window = int(rest[1]), int(rest[2])
        elif kind == "end":
            report.result, report.cycles, report.command = rest[0], int(rest[1]), int(rest[2])
            report.rule = " ".join(rest[3:])
    return report


def prepare(
    folder: Path, script: Script, memory: Memory, timing: Timing, settings: Mapping[str, str]
) -> None:
    """Write what a run on a folder's memory file needs besides; settings: its limits, and more."""
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
) -> Report:
    """Run a script on the memory file of a folder.

    progress: told of cycles and of the image's bytes that have been written, twice a second.
    settings: more lines for the program. Raises SimulationError if the program breaks off.
    """
    limits = {"idle_max": str(idle_max), "cycles_max": str(cycles_max)}
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
                else:
                    log.append(line)
        except BaseException:
            run.kill()
            raise
    if run.returncode:
        raise SimulationError(f"the simulation broke off: {''.join(log[-5:])}")
    return read_report(folder / "report", script.config)


def open_memory(folder: Path) -> np.ndarray:
    """The memory file's bytes, which stay readable when the folder is gone."""
    return np.memmap(folder / MAPPED, np.uint8, "r")
