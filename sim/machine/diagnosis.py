"""Where a simulated frame leaves its twin: the first pixel, its tile, its splats, the stage."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.sim.machine.areas import WORK_AREAS
from splatcore.sim.machine.machine import Run
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.group import feature_record, group_grid
from splatcore.spec.record import Record
from splatcore.spec.work import FEATURE, SLOT, table_record

SHOWN = 24
"""Splats of a tile that are told."""


@dataclass(frozen=True)
class Diagnosis:
    """pixel: x, y of the first one that differs, row by row. machine, twin: its colours. pixels:
    how many differ. tile: column, row. splats: those of the tile in the twin's order. stage: the
    first one whose results in memory differ, and in what.
    """

    pixel: tuple[int, int]
    machine: tuple[int, ...]
    twin: tuple[int, ...]
    pixels: int
    tile: tuple[int, int]
    splats: np.ndarray
    stage: str

    def __str__(self) -> str:
        splats = ", ".join(map(str, self.splats[:SHOWN]))
        splats += ", …" if len(self.splats) > SHOWN else ""
        return (
            f"{self.pixels} pixels differ from the golden model's, first {self.pixel} of tile "
            f"{self.tile}: {self.machine} instead of {self.twin}\n{self.stage}\n"
            f"{len(self.splats)} splats of this tile in order: {splats}"
        )


def diagnose(config: Config, run: Run, number: int, twin: Frame) -> Diagnosis | None:
    """How frame `number` of a run differs from its twin; None if it does not."""
    pixels = run.frames[number].pixels
    wrong = (pixels != twin.pixels).any(2)
    if not wrong.any():
        return None
    y, x = (int(place) for place in np.argwhere(wrong)[0])
    tile = x // TILE, y // TILE
    if number >= len(run.frames) - WORK_AREAS:
        stage = difference_in_memory(config, run, number, twin)
    else:
        stage = "its lists and features in memory have been overwritten by later frames'"
    return Diagnosis(
        (x, y),
        tuple(map(int, pixels[y, x])),
        tuple(map(int, twin.pixels[y, x])),
        int(wrong.sum()),
        tile,
        tile_splats(config, twin, tile),
        stage,
    )


def tile_splats(config: Config, twin: Frame, tile: tuple[int, int]) -> np.ndarray:
    """Numbers of the splats of a tile (column, row), front to back."""
    group, bit = place_in_group(config, twin, tile)
    order = twin.order[twin.start[group] : twin.start[group + 1]]
    mask = twin.binned.entries["mask"][order].astype(np.uint64)
    return twin.binned.entries["splat"][order][(mask >> np.uint64(bit) & np.uint64(1)) > 0]


def place_in_group(config: Config, twin: Frame, tile: tuple[int, int]) -> tuple[int, int]:
    """A tile's group and its number there."""
    height, width = twin.pixels.shape[:2]
    (row, y), (column, x) = divmod(tile[1], config.group), divmod(tile[0], config.group)
    return row * group_grid(config, width, height)[1] + column, y * config.group + x


def difference_in_memory(config: Config, run: Run, number: int, twin: Frame) -> str:
    """What the first half has left in memory, against the twin's."""
    area, binned = number % WORK_AREAS, twin.binned

    def memory(name: str) -> np.ndarray:
        return run.areas.read(run.memory, f"{name}{area}")

    count = len(binned.kept)
    record = feature_record(config)
    features = memory("features")[: count * FEATURE].reshape(-1, FEATURE)[:, : record.size]
    wrong = first_difference(record, features.copy(), binned.features)
    if wrong:
        return f"preprocessing: splat {wrong[0]} has {wrong[1]}"
    lists, record = binned.lists, table_record()
    table = memory("groups")[: len(lists.count) * SLOT].reshape(-1, SLOT)
    pages = record.unpack(table.copy())["page"]
    expected = {
        "page": np.where(lists.count > 0, lists.page, pages),
        "count": lists.count,
        "reserved": np.zeros_like(lists.count),
    }
    wrong = first_difference(record, table.copy(), expected)
    if wrong:
        return f"binning: group {wrong[0]} has {wrong[1]} in the table"
    slots = memory("lists").view("<u8")
    bursts = slots[: len(slots) // config.burst * config.burst].reshape(-1, config.burst)
    given = bursts[lists.address]
    different = np.argwhere((given != lists.slots) & (lists.slots != 0))
    if len(different):
        burst, slot = different[0]
        return (
            f"binning: slot {slot} of burst {lists.address[burst]} in the lists is "
            f"0x{given[burst, slot]:x} instead of 0x{lists.slots[burst, slot]:x}"
        )
    return "sorting or rasterizing: features and lists in memory are the twin's"


def first_difference(record: Record, rows: np.ndarray, codes: dict) -> tuple[int, str] | None:
    """The first of the rows uint8 [N, size] that is not as the codes say, and its first field."""
    found = record.unpack(_masked(rows, record.width))
    best = None
    for name, _ in record.fields:
        wrong = np.flatnonzero(found[name] != np.asarray(codes[name]))
        if len(wrong) and (best is None or wrong[0] < best[0]):
            k = int(wrong[0])
            best = k, f"{name} {int(found[name][k])} instead of {int(codes[name][k])}"
    return best


def _masked(rows: np.ndarray, width: int) -> np.ndarray:
    """Rows without what is above a record's bits."""
    rows = rows.copy()
    if width % 8:
        rows[:, width // 8] &= (1 << width % 8) - 1
    return rows
