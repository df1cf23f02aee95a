"""Performance counters: their names and what each counts, by block.

Those of a half begin at 0 with each of its frames and stand still when the frame is through; each
stops near its largest value instead of beginning again.
"""

from splatcore.spec.axi import READERS, WRITERS
from splatcore.spec.config import Config
from splatcore.spec.stages import BLOCKS

COUNTER_BITS = 32

POINTS = {
    "chunks": "chunk headers",
    "skipped": "chunks that were skipped by their header",
    "points": "points read",
    "front": "points in front of the near plane",
    "inside": "points in the guard band",
    "projected": "Gaussians that entered the projection's array",
    "starved": "rounds of the array without a Gaussian, because none was there",
    "blocked": "rounds of the array without a Gaussian, because splats were not taken",
}

BIN = {
    "splats": "splats",
    "kept": "splats that touch a tile",
    "rows": "tile rows looked at",
    "entries": "entries of groups' lists",
    "bursts": "bursts of list slots",
    "blocked": "cycles in which something that goes to memory was not taken",
}

SORT = {
    "entries": "entries taken",
    "given": "entries given out in order",
    "sorting": "cycles in which a sub-sorter had entries",
    "starved": "cycles in which a merge waited for an entry",
    "blocked": "cycles in which a merge waited for the one before to be taken",
}

RASTER = {
    "splats": "splats taken, once for each group",
    "dropped": "of these, those without a tile that has live pixels",
    "pairs": "pairs of a splat and a tile",
    "empty": "pairs without a block that is reached",
    "blocked": "cycles in which a pair waited",
}

RASTERIZER = {
    "blended": "blocks blended by rasterizer",
    "waited": "cycles without a block, before a group's end, of rasterizer",
}
"""The same for each rasterizer, with its number behind the name."""

HALF = {"cycles": "cycles at work"}
"""Of each half as a whole."""


def raster(config: Config) -> dict[str, str]:
    """Counters of stage 3."""
    each = {
        f"{name}{number}": f"{about} {number}"
        for name, about in RASTERIZER.items()
        for number in range(config.rasterizers)
    }
    return RASTER | each


def beats(half: int) -> dict[str, str]:
    """Counters of a half's traffic."""
    read = {f"read_{name}": f"beats read: {name}" for name, of in READERS.items() if of == half}
    return read | {
        f"write_{name}": f"beats written: {name}" for name, of in WRITERS.items() if of == half
    }


def counters(config: Config) -> dict[str, dict[str, str]]:
    """All of them: by half and block, name → what it counts."""
    of_block = {"points": POINTS, "bin": BIN, "sort": SORT, "raster": raster(config)}
    found = {}
    for number, (half, blocks) in enumerate(BLOCKS.items()):
        found |= {half: HALF | beats(number)} | {block: of_block[block] for block in blocks}
    return found
