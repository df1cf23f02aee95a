"""Performance counters by block: their names and meanings.

The counters of a half restart at 0 with each of its frames and stop when its frame ends. A counter
stops near its largest value instead of wrapping around.
"""

from splatcore.spec.axi import READERS, WRITERS
from splatcore.spec.config import Config
from splatcore.spec.stages import BLOCKS

COUNTER_BITS = 32
"""Width of a counter."""

POINTS = {
    "chunks": "chunk headers of the levels that are drawn",
    "skipped": "chunks skipped by their header",
    "points": "points read",
    "front": "points in front of the near plane",
    "inside": "points in the guard band",
    "projected": "Gaussians that entered the projection's array",
    "starved": "rounds of the array without a Gaussian, because none was ready",
    "blocked": "rounds of the array without a Gaussian, because binning was not ready for splats",
}
"""Counters of stages 0 and 1."""

BIN = {
    "splats": "splats",
    "kept": "splats that touch a tile",
    "rows": "tile rows visited",
    "entries": "entries of groups' lists",
    "bursts": "bursts of list slots",
    "blocked": "cycles in which memory was not ready for a write",
}
"""Counters of binning."""

SORT = {
    "entries": "entries received",
    "given": "entries output in order",
    "sorting": "cycles in which a sub-sorter had entries",
    "starved": "cycles in which a merge waited for an entry",
    "blocked": "cycles in which a merge waited for room at its output",
}
"""Counters of stage 2."""

RASTER = {
    "splats": "splats received, once per group",
    "dropped": "splats dropped, as none of their tiles has live pixels",
    "pairs": "pairs of a splat and a tile",
    "empty": "pairs that reach no block",
    "blocked": "cycles in which a pair waited to enter setup",
}
"""Counters of stage 3 as a whole."""

RASTERIZER = {
    "blended": "blocks blended by rasterizer",
    "waited": "cycles without a block, before the group's end, of rasterizer",
}
"""Counters of each rasterizer; its number is appended to name and meaning."""

HALF = {"cycles": "cycles with a frame"}
"""Counters of each half as a whole."""


def raster(config: Config) -> dict[str, str]:
    """Return the counters of stage 3."""
    each = {
        f"{name}{number}": f"{about} {number}"
        for name, about in RASTERIZER.items()
        for number in range(config.rasterizers)
    }
    return RASTER | each


def beats(half: int) -> dict[str, str]:
    """Return the counters of a half's memory traffic."""
    read = {f"read_{name}": f"beats read: {name}" for name, of in READERS.items() if of == half}
    return read | {
        f"write_{name}": f"beats written: {name}" for name, of in WRITERS.items() if of == half
    }


def counters(config: Config) -> dict[str, dict[str, str]]:
    """Return all counters: half or block → name → meaning."""
    of_block = {"points": POINTS, "bin": BIN, "sort": SORT, "raster": raster(config)}
    found = {}
    for number, (half, blocks) in enumerate(BLOCKS.items()):
        found |= {half: HALF | beats(number)} | {block: of_block[block] for block in blocks}
    return found
