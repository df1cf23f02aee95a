"""Waveforms of a part of a run: a VCD file, and beside it a view of the stages' streams."""

import re
import shutil
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
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.error import InputError
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.work import PIXEL, SLOT, page_bytes, stride

SCOPES = (3, 4)
"""Depths of modules whose streams the view shows: the halves with the bus, and the stages."""


@dataclass(frozen=True)
class Window:
    """The part of a run that is recorded: cycles, or frame 0's group of a tile, from the reading of
    its list to the last of its pixels.

    offset: where its list begins in list memory (in_lists), or its place in the table of groups if
    it has none. rectangle: x0, x1, y0, y1 of the group's pixels.
    """

    cycles: tuple[int, int] | None = None
    in_lists: bool = False
    offset: int = 0
    width: int = 0
    rectangle: tuple[int, int, int, int] = (0, 0, 0, 0)

    @classmethod
    def of(cls, config: Config, window: str | None, tile: str | None, golden: Frame) -> "Window":
        """The window of --window or --tile; InputError for what does not exist."""
        if window:
            first, last = _two(window, "--window", ":")
            if not 0 <= first <= last:
                raise InputError(f"--window {window}: ends before it begins")
            return cls((first, last))
        column, row = _two(tile, "--tile", ",")
        height, width = golden.pixels.shape[:2]
        if not (0 <= column * TILE < width and 0 <= row * TILE < height):
            raise InputError(f"--tile {tile}: is not within the image of {width}x{height}")
        group, _ = place_in_group(config, golden, (column, row))
        side, lists = group_pixels(config), golden.binned.lists
        y, x = (k * side for k in divmod(group, group_grid(config, width, height)[1]))
        rectangle = x, min(x + side, width), y, min(y + side, height)
        if lists.count[group]:
            return cls(None, True, int(lists.page[group]) * page_bytes(config), width, rectangle)
        return cls(None, False, group * SLOT, width, rectangle)

    def settings(self, areas: Areas) -> dict[str, str]:
        """Lines for the program."""
        if self.cycles:
            return {"window": f"{self.cycles[0]} {self.cycles[1]}"}
        x0, x1, y0, y1 = self.rectangle
        start = areas.registers["LISTS" if self.in_lists else "GROUPS"] + self.offset
        numbers = start, areas.images[0], stride(self.width), x0 * PIXEL, x1 * PIXEL, y0, y1
        return {"watch": " ".join(map(str, numbers))}


def write_waves(
    machine: Machine, jobs: list[Job], timing: Timing, window: Window, path: Path, label: str
) -> Run:
    """Run frames, write what happens in the window to a VCD file, and a view beside it."""
    with TemporaryDirectory(prefix="splatcore") as name:
        run = simulate(machine, jobs, timing, label, settings=window.settings, keep=Path(name))
        if run.report.window is None:
            raise InputError(f"--waves {path}: the run ended before the window began")
        shutil.move(Path(name) / "waves.vcd", path)
    write(path.with_suffix(".gtkw"), view(path, run.report.window).encode())
    return run


def view(path: Path, window: tuple[int, int]) -> str:
    """GTKWave's save file: the streams of the stages, module by module."""
    lines = [f'[dumpfile] "{path.absolute()}"', f"[timestart] {10 * window[0]}"]
    lines += ["[signals_width] 320", "[sst_expanded] 1", "@28", "TOP.clk", "TOP.rst"]
    modules = defaultdict(dict)
    for scope, name, width in signals(path):
        modules[scope][name] = width
    for scope, names in modules.items():
        streams = [
            name.removesuffix("__valid")
            for name in names
            if name.endswith("__valid") and name.removesuffix("__valid") + "__ready" in names
        ]
        if not streams:
            continue
        lines += ["@200", f"-{scope}"]
        for stream in streams:
            lines += ["@28", *(f"{scope}.{stream}__{end}" for end in ("valid", "ready"))]
            if width := names.get(f"{stream}__payload", 0):
                bits = f"[{width - 1}:0]" if width > 1 else ""
                lines += ["@22" if bits else "@28", f"{scope}.{stream}__payload{bits}"]
    return "\n".join(lines) + "\n"


def signals(path: Path) -> Iterator[tuple[str, str, int]]:
    """Scope, name and width of the signals of a VCD file that are in `SCOPES`."""
    scopes = []
    with open(path) as file:
        for line in file:
            words = line.split()
            if words[:1] == ["$scope"]:
                scopes.append(words[2])
            elif words[:1] == ["$upscope"]:
                scopes.pop()
            elif words[:1] == ["$var"] and len(scopes) in SCOPES:
                yield ".".join(scopes), words[4], int(words[2])
            elif words[:1] == ["$enddefinitions"]:
                return


def _two(text: str, option: str, between: str) -> tuple[int, int]:
    """Two numbers with a character between them."""
    match = re.fullmatch(rf"(\d+){between}(\d+)", text)
    if not match:
        raise InputError(f"{option} '{text}': is not two numbers with '{between}' between them")
    return int(match[1]), int(match[2])
