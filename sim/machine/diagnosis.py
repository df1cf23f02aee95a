"""First difference of a simulated frame from the golden model: pixel, tile, splats, stage."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.sim.machine.areas import WORK_AREAS
from splatcore.sim.machine.machine import Run
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.feature import feature_record
from splatcore.spec.group import group_grid
from splatcore.spec.record import Record
from splatcore.spec.work import FEATURE, SLOT, table_record

SHOWN = 24  # splats of a tile that are listed


@dataclass(frozen=True)
class Diagnosis:
    """A frame's difference from the golden model's.

    pixel: (x, y) of the first wrong pixel, row by row
    tile: column and row of its tile
    pixels: number of wrong pixels
    stage: the first stage whose results in memory differ, and the difference
    text: all of this as text
    """

    pixel: tuple[int, int]
    tile: tuple[int, int]
    pixels: int
    stage: str
    text: str

    def __str__(self) -> str:
        return self.text


def diagnose(config: Config, run: Run, number: int, golden: Frame) -> Diagnosis | None:
    """Compare frame `number` of a run with the golden model's; None if all pixels agree."""
    pixels = run.frames[number].pixels
    wrong = (pixels != golden.pixels).any(2)
    if not wrong.any():
        return None
    y, x = (int(place) for place in np.argwhere(wrong)[0])
    tile, count = (x // TILE, y // TILE), int(wrong.sum())
    if number >= len(run.frames) - WORK_AREAS:
        stage = difference_in_memory(config, run, number, golden)
    else:
        stage = "later frames have overwritten its lists and features in memory"
    found, right = (tuple(map(int, colours[y, x])) for colours in (pixels, golden.pixels))
    splats = tile_splats(config, golden, tile)
    listed = ", ".join(map(str, splats[:SHOWN])) + (", …" if len(splats) > SHOWN else "")
    text = (
        f"{count} pixels differ from the golden model's, first {(x, y)} of tile {tile}: "
        f"{found} instead of {right}\n{stage}\n{len(splats)} splats of this tile in order: {listed}"
    )
    return Diagnosis((x, y), tile, count, stage, text)


def tile_splats(config: Config, golden: Frame, tile: tuple[int, int]) -> np.ndarray:
    """Splat numbers of a tile (column, row), front to back."""
    group, bit = place_in_group(config, golden, tile)
    order = golden.order[golden.start[group] : golden.start[group + 1]]
    mask = golden.binned.entries["mask"][order].astype(np.uint64)
    return golden.binned.entries["splat"][order][(mask >> np.uint64(bit) & np.uint64(1)) > 0]


def place_in_group(config: Config, golden: Frame, tile: tuple[int, int]) -> tuple[int, int]:
    """Number of a tile's group, and the tile's number in it."""
    height, width = golden.pixels.shape[:2]
    (row, y), (column, x) = divmod(tile[1], config.group), divmod(tile[0], config.group)
    return row * group_grid(config, width, height)[1] + column, y * config.group + x


def difference_in_memory(config: Config, run: Run, number: int, golden: Frame) -> str:
    """The first difference in preprocessing's results in memory, as text."""
    area, binned = number % WORK_AREAS, golden.binned

    def memory(name: str) -> np.ndarray:
        return run.areas.read(run.memory, f"{name}{area}")

    count = len(binned.kept)
    record = feature_record(config)
    features = memory("features")[: count * FEATURE].reshape(-1, FEATURE)[:, : record.size]
    wrong = first_difference(record, features, binned.features)
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
    wrong = first_difference(record, table, expected)
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
    return "sorting or rasterizing: features and lists in memory are the golden model's"


def first_difference(record: Record, rows: np.ndarray, codes: dict) -> tuple[int, str] | None:
    """The first row that differs from the codes.

    rows: uint8 [N, size], packed records
    codes: expected codes [N] by field
    Returns the row's number and its first wrong field as text; None if all rows agree.
    """
    rows = rows.copy()
    if record.width % 8:
        rows[:, record.width // 8] &= (1 << record.width % 8) - 1
    found, best = record.unpack(rows), None
    for name, _ in record.fields:
        wrong = np.flatnonzero(found[name] != np.asarray(codes[name]))
        if len(wrong) and (best is None or wrong[0] < best[0]):
            k = int(wrong[0])
            best = k, f"{name} {int(found[name][k])} instead of {int(codes[name][k])}"
    return best
