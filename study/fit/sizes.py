"""Sizes for `splatcore fit`: the smallest machine whose halves both finish in time.

Both halves work at the same time on neighbouring frames, so each is sized on its own. The points'
half: PEs. The tiles' half: rasterizers first, which are largest, then the cheapest sorting.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product

from amaranth.hdl import UnusedElaboratable

from splatcore.golden.pipeline import Frame
from splatcore.hdl.points.project import Project
from splatcore.sim.cycles.frame import Cycles, frame_cycles
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import PES_MIN
from splatcore.spec.stages import HALVES
from splatcore.study.fit.gates import sort_gates

# Components are created to query them and never elaborated.
warnings.filterwarnings("ignore", category=UnusedElaboratable)

MEMORY_MARGIN = 0.025
"""Share of a frame's time reserved for memory, which the cycle model takes as ideal: RTL with
LPDDR4 was 0.1 to 2.2 % slower than with ideal memory."""

MODEL_MARGIN = 0.03  # share of a frame's time reserved for the cycle model's error
ARRAYS, PES = 4, 16  # maximum arrays of PEs, and PEs per array

RASTERIZERS = (1, 2, 4, 8, 16)
SORTERS = (1, 2, 3, 4, 6, 8)
ENTRIES = (16, 32, 64, 128, 256)
WAYS = (2, 4, 8, 16)  # values to try, the smallest first


def budget(fps: float) -> int:
    """Maximum cycles per frame by the cycle model, with margins for memory and for the model."""
    return int(CLOCK_HZ / fps * (1 - MEMORY_MARGIN - MODEL_MARGIN))


@dataclass(frozen=True)
class Missed(Exception):
    """No size is fast enough; `cycles` are the half's in the largest machine."""

    half: str
    stage: str
    view: str
    cycles: int


class Speed:
    """Cycles of the views' frames in any machine. frames: by view."""

    def __init__(self, frames: dict[str, Frame], progress: Callable[[str], None]):
        self.frames, self.progress = frames, progress
        self.known: dict[tuple[Config, str], Cycles] = {}

    def cycles(self, config: Config, view: str) -> Cycles:
        key = config, view
        if key not in self.known:
            self.known[key] = frame_cycles(config, self.frames[view])
        return self.known[key]

    def slowest(self, config: Config, half: str = "frame") -> tuple[str, int]:
        """The slowest view, and its cycles."""
        times = {view: getattr(self.cycles(config, view), half) for view in self.frames}
        view = max(times, key=times.get)
        return view, times[view]

    def fits(self, config: Config, half: str, most: int) -> bool:
        """True if all views take at most `most` cycles; tries the view that failed last first."""
        if not _buildable(config):
            return False
        for view in list(self.frames):
            if getattr(self.cycles(config, view), half) > most:
                self.frames = {view: self.frames[view]} | self.frames
                return False
        return True

    def choose(self, config: Config, most: int) -> Config:
        """Choose the smallest machine that takes at most `most` cycles per frame.

        Raises Missed if even the largest takes more.
        """
        config = self._smallest(config, points(config), "preprocessing", most)
        sorting = {"sub_sorters": sorters(config)[-1], "sub_sorter_entries": ENTRIES[-1]}
        sorting["merge_ways"] = WAYS[-1]
        lanes = [replace(config, rasterizers=n, **sorting) for n in rasterizers(config)]
        chosen = self._smallest(config, lanes, "rendering", most).rasterizers
        return self._sorting(replace(config, rasterizers=chosen), most)

    def _smallest(self, config: Config, choices: list[Config], half: str, most: int) -> Config:
        """The first choice that fits; each is at least as fast as the one before."""
        self.progress(half)
        if not self.fits(choices[-1], half, most):
            view, cycles = self.slowest(choices[-1], half)
            stages = asdict(self.cycles(choices[-1], view))
            stage = max(HALVES[half], key=stages.get)
            raise Missed(half, stage, view, cycles)
        low, high = 0, len(choices) - 1  # choices[high] fits, nothing below low does
        while low < high:
            middle = (low + high) // 2
            if self.fits(choices[middle], half, most):
                high = middle
            else:
                low = middle + 1
        return choices[high]

    def _sorting(self, config: Config, most: int) -> Config:
        """The cheapest sub-sorters and merge that fit.

        Choices no larger in every size than one that was too slow are skipped.
        """
        failed: list[tuple[int, ...]] = []
        for choice in sortings(config):
            sizes = choice.sub_sorters, choice.sub_sorter_entries, choice.merge_ways
            if any(all(a <= b for a, b in zip(sizes, slow, strict=True)) for slow in failed):
                continue
            self.progress(f"rendering with {sizes[0]} × {sizes[1]} entries, {sizes[2]} ways")
            if self.fits(choice, "rendering", most):
                return choice
            failed.append(sizes)
        raise AssertionError("the largest sorting was fast enough before")


def points(config: Config) -> list[Config]:
    """Machines by rising number of PEs; some cannot be built."""
    found = {}
    for arrays, pes in product(range(ARRAYS, 0, -1), range(1, PES + 1)):
        if arrays * pes >= PES_MIN:
            found[arrays * pes] = replace(config, pe_arrays=arrays, pes=pes)
    return [found[pes] for pes in sorted(found)]


@cache
def _buildable(config: Config) -> bool:
    """True if the projection can be scheduled; with very few PEs it cannot."""
    try:
        Project(config)
    except ValueError:
        return False
    return True


def rasterizers(config: Config) -> tuple[int, ...]:
    """Numbers of rasterizers to choose from; two share lanes in quads."""
    return RASTERIZERS[1:] if config.lanes == "quads" else RASTERIZERS


def sorters(config: Config) -> tuple[int, ...]:
    """Numbers of sub-sorters to choose from; a cascade needs only one."""
    return SORTERS if config.sub_sorter == "trees" else (1,)


def sortings(config: Config) -> Iterator[Config]:
    """Machines with all combinations of sorting sizes, by rising gates, then memory."""
    found = []
    for count, entries, ways in product(sorters(config), ENTRIES, WAYS):
        try:
            choice = replace(config, sub_sorters=count, sub_sorter_entries=entries, merge_ways=ways)
        except InputError:
            continue
        found.append((sort_gates(choice), entries * ways, choice))
    return (choice for _, _, choice in sorted(found, key=lambda item: item[:2]))


def smaller(config: Config, name: str) -> Config | None:
    """The machine with the next smaller value of a size; None if it has the smallest."""
    if name == "pes":
        total = config.pes * config.pe_arrays
        fewer = (c for c in reversed(points(config)) if c.pes * c.pe_arrays < total)
        return next(filter(_buildable, fewer), None)
    values = {
        "rasterizers": rasterizers(config), "sub_sorters": sorters(config),
        "sub_sorter_entries": ENTRIES, "merge_ways": WAYS,
    }[name]  # fmt: skip
    less = [value for value in values if value < getattr(config, name)]
    return replace(config, **{name: less[-1]}) if less else None


SIZES = {
    "pes": "preprocessing", "rasterizers": "rendering", "sub_sorters": "rendering",
    "sub_sorter_entries": "rendering", "merge_ways": "rendering",
}  # fmt: skip
"""Each size, and the half whose time depends on it."""
