"""Scripts of the simulated host, and reports of their runs."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from splatcore.sim.common.choice import check_known
from splatcore.spec.axi import READERS, WRITERS, port_bytes
from splatcore.spec.config import Config
from splatcore.spec.registers import addresses

RESET_CYCLES = 4
MAPPED = "memory"  # memory file in a run's folder

REASONS = {
    "done": "the script was done",
    "error": "the machine reported an error",
    "hang": "nothing moved on the bus",
    "limit": "the limit of cycles was reached",
    "rule": "a rule of AXI was broken",
}

FAULTS = tuple(
    f"{way}_{kind}" for kind in ("errors", "strays", "missing") for way in ("read", "write")
)
"""Settings of memory that list injected faults (`Timing`)."""


@dataclass(frozen=True)
class Timing:
    """Behaviour of memory (`memory.hpp`).

    latency: cycles from a request to its first beat
    bandwidth: bytes per cycle, shared by reads and writes; 0: unlimited
    granule: minimum bytes per access
    outstanding: requests in flight, for reads and for writes
    stall: probability that a channel of memory or host idles in a cycle
    seed: of the stalls, and of the initial values of the machine's registers and memories
    *_errors: read beats and written bursts, numbered from 0, that are answered by an error
    *_strays: beats and bursts preceded by an answer without a request
    *_missing: beats and bursts that are never answered
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
        """Lines of the program's `settings`."""
        names = ("latency", "bandwidth", "granule", "outstanding", "stall", "seed")
        lines = [f"{name} {getattr(self, name)}" for name in names]
        for name in FAULTS:
            lines += [f"{name} {number}" for number in getattr(self, name)]
        return lines


IDEAL = Timing("ideal", latency=4)  # like memory on the chip

LPDDR4 = Timing("lpddr4", latency=80, bandwidth=32.0, granule=32)
"""64 bits of LPDDR4-3200 (JEDEC JESD209-4) at the paper's clock of 800 MHz.

3200 million transfers per second of 8 bytes are 25.6 GB/s, or 32 bytes per cycle. The smallest
access, a burst of 16 transfers on one of four 16-bit channels, moves 32 bytes. The latency, 100 ns
or 80 cycles, is conservative: 18 ns to open a row, 17.5 ns to read, 5 ns for the burst, 60 ns for
interconnect. Not modelled: refresh, bus turnarounds, bank conflicts (10 to 30 % of the bandwidth).
"""

LPDDR4_80 = replace(LPDDR4, name="lpddr4-80", bandwidth=0.8 * LPDDR4.bandwidth)
"""LPDDR4 with a fifth of its bandwidth lost to what is not modelled."""

TIMINGS = {timing.name: timing for timing in (IDEAL, LPDDR4, LPDDR4_80)}


def find_timing(name: str) -> Timing:
    """Find a timing by name; InputError lists the names."""
    if name.lower() not in TIMINGS:
        check_known("--timing", TIMINGS, name)
    return TIMINGS[name.lower()]


@dataclass(frozen=True)
class Region:
    """Memory that the machine may access. begin: address; at: offset in the memory file."""

    name: str
    begin: int
    size: int
    writable: bool
    at: int

    @property
    def end(self) -> int:
        return self.begin + self.size


class Memory(Protocol):
    """A memory map, as `execute` needs it."""

    regions: tuple[Region, ...]


@dataclass
class Script:
    """Commands of the host; each method adds one and returns its number in the report."""

    config: Config
    lines: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.addresses = addresses(self.config)

    def _add(self, line: str) -> int:
        self.lines.append(line)
        return len(self.lines) - 1

    def write(self, register: str | int, value: int) -> int:
        """Write a register, by name or by address."""
        return self._add(f"write {self.addresses.get(register, register)} {value}")

    def read(self, register: str | int) -> int:
        return self._add(f"read {self.addresses.get(register, register)}")

    def wait(self, mask: int) -> int:
        """Wait until INTERRUPT has a bit in `mask`; set bits are cleared and remembered."""
        return self._add(f"wait {mask}")

    def cycles(self, count: int) -> int:
        return self._add(f"cycles {count}")

    def reset(self, count: int = RESET_CYCLES) -> int:
        """Reset the machine for `count` cycles; memory drops its requests."""
        return self._add(f"reset {count}")

    def save(self, address: int, size: int, file: str) -> int:
        """Save bytes of memory, as they are now, to a file in the run's folder."""
        return self._add(f"save {address} {size} {file}")

    def last_part(self) -> int:
        """Begin the last part: the following commands run even after an error."""
        return self._add("finally")


PIXELS_WRITTEN = "write_pixels"


@dataclass(frozen=True)
class Answer:
    """Answer to a command. cycle: when it was done; response: of AXI4-Lite."""

    cycle: int
    value: int
    response: int


@dataclass
class Report:
    """Report of a run.

    result: key of `REASONS`
    rule: the AXI rule that was broken
    answers: by number of the command; command: number of the last one
    events: cycle and bits of each interrupt
    read, written: beats by reader and by writer
    asked: read beats and write bursts requested, numbered as in `Timing`'s faults
    regions: bytes read and written by region
    outside: number of illegal accesses; outside_shown: the first few as text
    window: first and last recorded cycle
    """

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
    outside_shown: list[str] = field(default_factory=list)
    window: tuple[int, int] | None = None

    @property
    def done(self) -> bool:
        """True if the script ended without an error."""
        return self.result == "done"

    @property
    def why(self) -> str:
        """Outcome of the run, as text."""
        text = f"{REASONS[self.result]}, cycle {self.cycles}, command {self.command}"
        text += f": {self.rule}" if self.rule else ""
        first = self.outside_shown[0] if self.outside else ""
        return text + (f"; {self.outside} accesses outside of memory: {first}" if first else "")

    @property
    def traffic(self) -> dict[str, int]:
        """Bytes by cause: whole beats; of pixels only the bytes that are written."""
        found = {f"read_{name}": beats for name, beats in self.read.items()}
        found |= {f"write_{name}": beats for name, beats in self.written.items()}
        found = {cause: beats * port_bytes(self.config) for cause, beats in found.items()}
        images = [written for name, (_, written) in self.regions.items() if "image" in name]
        return found | ({PIXELS_WRITTEN: sum(images)} if PIXELS_WRITTEN in found else {})


def read_report(path: Path, config: Config) -> Report:
    """Read the program's report."""
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
        elif kind == "shown":
            access, number, address, size, cycle = rest
            name = (readers if access == "read" else writers)[int(number)]
            text = f"{access} of {name}, {size} bytes at 0x{int(address):x}, cycle {cycle}"
            report.outside_shown.append(text)
        elif kind == "window":
            report.window = int(rest[1]), int(rest[2])
        elif kind == "end":
            report.result, report.cycles, report.command = rest[0], int(rest[1]), int(rest[2])
            report.rule = " ".join(rest[3:])
    return report
