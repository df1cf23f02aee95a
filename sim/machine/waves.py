"""Waveforms of a part of a run: a VCD or FST file, and views of the stages' streams for viewers."""

import re
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from splatcore.golden.pipeline import Frame
from splatcore.sim.common.output import write
from splatcore.sim.machine.areas import Areas
from splatcore.sim.machine.diagnosis import place_in_group
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.path import simulate
from splatcore.sim.machine.script import Timing
from splatcore.sim.machine.wave_files import LEVELS, Signal, signals
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.work import PIXEL, SLOT, page_bytes, stride

WHOLE = "TOP"  # the module around the machine

OVERLAP, MORE = 1.5, 300
"""Estimate of a group's cycles: factor on its share of the frame's cycles, and cycles added."""

CLOCK = ("clk", "rst")
BINARY, HEXADECIMAL, GROUP, GROUP_END = "@28", "@22", "@800200", "@1000200"
"""GTKWave's display flags for the lines that follow."""


@dataclass(frozen=True)
class Window:
    """The recorded part of a run: given cycles, or a tile's group of frame 0, from reading its list
    to writing its last pixel.

    cycles: first and last cycle; None for a group
    in_lists: whether the group has a list
    offset: of its list in list memory; without a list, of its entry in the table of groups
    shape: of the image's array: height, width, bytes of a pixel
    rectangle: x0, x1, y0, y1 of the group's pixels
    share: its part of all entries of the frame
    """

    cycles: tuple[int, int] | None = None
    in_lists: bool = False
    offset: int = 0
    shape: tuple[int, int, int] = (0, 0, 0)
    rectangle: tuple[int, int, int, int] = (0, 0, 0, 0)
    share: float = 0.0

    @classmethod
    def of(cls, config: Config, window: str | None, tile: str | None, golden: Frame) -> "Window":
        """Parse --window or --tile; InputError if it is not in the run or the image."""
        if window:
            first, last = _two(window, "--window", ":")
            if not 0 <= first <= last:
                raise InputError(f"--window {window}: the end is before the beginning")
            return cls((first, last))
        column, row = _two(tile, "--tile", ",")
        height, width, _ = shape = golden.pixels.shape
        if not (0 <= column * TILE < width and 0 <= row * TILE < height):
            raise InputError(f"--tile {tile}: outside of the image of {width}x{height}")
        group, _ = place_in_group(config, golden, (column, row))
        side, lists = group_pixels(config), golden.binned.lists
        y, x = (k * side for k in divmod(group, group_grid(config, width, height)[1]))
        rectangle = x, min(x + side, width), y, min(y + side, height)
        if lists.count[group]:
            page = int(lists.page[group]) * page_bytes(config)
            share = float(lists.count[group] / lists.count.sum())
            return cls(None, True, page, shape, rectangle, share)
        return cls(None, False, group * SLOT, shape, rectangle)

    def count(self, run: int, rendering: int) -> int:
        """Estimated number of recorded cycles; a group is read while an earlier one is rasterized.

        run: cycles of the run
        rendering: cycles of a frame's second half
        """
        if self.cycles is None:
            return min(round(OVERLAP * self.share * rendering) + MORE, run)
        first, last = self.cycles
        return max(min(last, run) - first, 0) + 1

    def settings(self, areas: Areas) -> dict[str, str]:
        """Lines of the program's `settings`."""
        if self.cycles:
            return {"window": f"{self.cycles[0]} {self.cycles[1]}"}
        (x0, x1, y0, y1), (_, width, pixel) = self.rectangle, self.shape
        start = areas.region("lists0" if self.in_lists else "groups0").begin + self.offset
        row = stride(width, pixel > PIXEL)
        numbers = start, areas.images[0], row, x0 * pixel, x1 * pixel, y0, y1
        return {"watch": " ".join(map(str, numbers))}


@dataclass(frozen=True)
class Recording:
    """Waveforms to record.

    scope: path of a module
    levels: of modules to record, the module itself included
    """

    path: Path
    window: Window
    scope: str = WHOLE
    levels: int = LEVELS


def write_waves(
    machine: Machine, jobs: list[Job], timing: Timing, recording: Recording, label: str, **options
) -> Run:
    """Run frames and write the window's waveforms, and viewer files next to them.

    options: of `sim.machine.machine.Machine.run`
    """
    path, window = recording.path, recording.window

    def settings(areas: Areas) -> dict[str, str]:
        return window.settings(areas) | {"scope": f"{recording.levels} {recording.scope}"}

    with TemporaryDirectory(prefix="splatcore") as name:
        options |= {"settings": settings, "keep": Path(name)}
        run = simulate(machine, jobs, timing, label, **options)
        if run.report.window is None:
            raise InputError(f"--waves {path}: the run ended before the window began")
        [made] = Path(name).glob("waves.*")
        names = list(signals(made))
        shutil.move(made, path)
    for end, made_of in VIEWS.items():
        write(path.with_suffix(end), made_of(path, run.report.window, names).encode())
    return run


def names_of(machine: Machine) -> list[Signal]:
    """All signals whose waveforms a machine can write."""
    with TemporaryDirectory(prefix="splatcore") as name:
        folder = Path(name)
        (folder / "settings").write_text("names all\n")
        subprocess.run([machine.program, name], check=True, stdout=subprocess.DEVNULL)
        [made] = folder.glob("waves.*")
        return list(signals(made))


def streams_of(names: list[Signal]) -> Iterator[tuple[str, dict[str, dict[str, int]]]]:
    """Modules with streams: for each stream its valid, ready, payload and fields, with widths."""
    modules = defaultdict(dict)
    for signal in names:
        modules[signal.scope][signal.name] = signal.width
    modules.pop(WHOLE, None)
    for scope, widths in modules.items():
        ends = (name.removesuffix("__valid") for name in widths if name.endswith("__valid"))
        found = {}
        for stream in (each for each in ends if f"{each}__ready" in widths):
            payload = f"{stream}__payload"
            members = [f"{stream}__valid", f"{stream}__ready", payload]
            members += [name for name in widths if name.startswith(f"{payload}.")]
            found[stream] = {name: widths[name] for name in members if name in widths}
        if found:
            yield scope, found


def clocks(names: list[Signal]) -> list[str]:
    """Paths of clock and reset, if recorded."""
    recorded = {signal.name for signal in names if signal.scope == WHOLE}
    return [f"{WHOLE}.{name}" for name in CLOCK if name in recorded]


def gtkwave(path: Path, window: tuple[int, int], names: list[Signal]) -> str:
    """GTKWave save file: one group per stream, by module."""
    lines = [f'[dumpfile] "{path.absolute()}"', f"[timestart] {10 * window[0]}"]
    lines += ["[signals_width] 320", "[sst_expanded] 1"]
    lines += [f"{BINARY}\n{name}" for name in clocks(names)]
    for scope, streams in streams_of(names):
        lines += ["@200", f"-{scope}"]
        for stream, members in streams.items():
            lines += [GROUP, f"-{stream}"]
            for name, width in members.items():
                bits = f"[{width - 1}:0]" if width > 1 else ""
                lines += [HEXADECIMAL if bits else BINARY, f"{scope}.{name}{bits}"]
            lines += [GROUP_END, f"-{stream}"]
    return "\n".join(lines) + "\n"


def surfer(path: Path, window: tuple[int, int], names: list[Signal]) -> str:
    """Surfer command file: each module's streams after a divider. Payloads are shown as a whole, as
    Surfer takes a dot in a name for the end of a module's name."""
    lines = [f"load_file {path.absolute()}", *(f"variable_add {name}" for name in clocks(names))]
    for scope, streams in streams_of(names):
        lines.append(f"divider_add {scope}")
        for members in streams.values():
            lines += [f"variable_add {scope}.{name}" for name in members if "." not in name]
    return "\n".join([*lines, "zoom_fit"]) + "\n"


VIEWS = {".gtkw": gtkwave, ".sucl": surfer}
"""Viewer files written next to waveforms, which show the stages' streams: maker by suffix."""


def _two(text: str, option: str, between: str) -> tuple[int, int]:
    """Parse two numbers separated by `between`."""
    match = re.fullmatch(rf"(\d+){between}(\d+)", text)
    if not match:
        raise InputError(f"{option} '{text}': must be two numbers separated by '{between}'")
    return int(match[1]), int(match[2])
