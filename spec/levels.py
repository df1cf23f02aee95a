"""Levels of detail in a packed model: coarser chunks, and where a view stops refining.

A group is `PER_GROUP` coarser chunks in a row that were merged from the chunks of its child groups,
or from finest chunks. Chunks are stored depth first: the group's own, then each child's whole
subtree; the finest chunks keep the order, and the bits, that they have without levels. Before each
chunk header is a record (`LEVEL`); the records of a group are equal except for `last`. A machine
visits the chunks in order:

- A finest chunk (error 0) is drawn, subject to its bounds as in any model.
- A group is out of view if |x| > side: x and z are coordinates of its sphere's centre, and
  side = z · wide + surround · around is as far as its Gaussians can reach sideways, with wide a
  little above the guard band's slope (`wider`), for roundings. The walk goes on at `jump`. Machines
  that skip no chunks beside the image do without this test.
- Else it is coarse enough if error < lod · z − lod · radius with lod = `Camera.lod_pixels` /
  max(fx, fy). If it is, its chunks are drawn, and the walk goes on at `jump`. If not, they are
  skipped, and the walk goes on with the first child.

All is in `Config.arithmetic` (program `level`). So each place in view is drawn exactly once,
whatever the errors, spheres and roundings are. If the sphere touches the plane through the camera,
z ≤ radius and the group is refined: rounding keeps order. With 0 pixels only finest chunks are
drawn.
"""

from collections.abc import Iterator

import numpy as np

from splatcore.spec.memory import CHUNK_HEADER, LEVEL_SIZE, ORIGIN_BITS, REACH
from splatcore.spec.number import Bits, Fixed, Float
from splatcore.spec.record import Array, Record

WIDER_BITS = 6  # wide is up to 2^-6 above the guard band's slope

PER_GROUP = 2
"""Coarser chunks of a group. They are whole: only the model's last chunk may be short."""

LEVEL = Record(
    "level",
    {
        "centre": Array(Fixed(ORIGIN_BITS - 1, 0, signed=True), 3),  # grid steps
        "last": Bits(1),  # the next chunk is of another group; set in finest chunks
        # radius and reach of the subtree's farthest-reaching Gaussian, at least; 0: unknown, and
        # the group is never out of view
        "around": REACH,
        "spare": Bits(22 - REACH.width),
        "error": REACH,  # of the group, scene units; 0: a finest chunk
        "radius": REACH,  # of the sphere around the centres of the group's whole subtree
        "jump": Bits(24),  # number of the first chunk after the group's subtree
        "beats": Bits(32),  # beats of attributes of all chunks before `jump`, over CHUNK
        "reserved": Bits(25),
    },
)
"""The record before a chunk header. Centre and radius are in the bits of the header's origin and
reach, so that a machine tests a sphere with the steps that find a chunk's bounds."""

PLACES = {field: LEVEL.offset(field) for field in ("centre", "radius")}

if LEVEL.size != LEVEL_SIZE or list(PLACES.values()) != [
    CHUNK_HEADER.offset(field) for field in ("origin", "reach")
]:
    raise ValueError(f"a level's record has {LEVEL.size} bytes, fields at {PLACES}")

Levels = dict[str, np.ndarray]
"""Values [C] of the records' fields."""


def wider(format: Float, guard: float) -> float:
    """Return the slope for a guard band's: its code plus 2^-`WIDER_BITS` of its leading bit."""
    code = format.encode(np.array([guard])) + (1 << format.fraction - WIDER_BITS)
    return float(format.decode(code)[0])


def fault(levels: Levels, chunk_beats: np.ndarray) -> tuple[str, str] | None:
    """Return the field of a record that contradicts the others, and why; None if none does.

    chunk_beats: [C] beats of attributes per Gaussian of each chunk
    """
    count, coarse = len(chunk_beats), levels["error"] > 0
    if not count:
        return None
    number, jump = np.arange(count), levels["jump"].astype(np.int64)
    first = np.concatenate([[0], np.cumsum(chunk_beats)])
    fields = ("centre", "radius", "around", "error", "jump", "beats")
    record = np.column_stack([levels[field].astype(np.float64) for field in fields])
    alike = np.zeros(count, bool)  # the next chunk has the same record
    alike[:-1] = (record[1:] == record[:-1]).all(1)
    alone = (levels["last"] == 0) & ~alike
    tests = (
        ("jump", jump <= number, "is not forward"),
        ("jump", jump > count, f"is beyond the end, {count}"),
        ("error", ~coarse & (jump != number + 1), "is not positive, but finer chunks follow"),
        ("jump", coarse & (jump == number + 1), "has no finer chunk"),
        ("last", ~coarse & (levels["last"] == 0), "is not set in a finest chunk"),
        ("last", alone, "is not set, but the next chunk is of another group"),
        ("beats", levels["beats"] != first[np.minimum(jump, count)], "is not where `jump` begins"),
    )
    for field, wrong, why in tests:
        if wrong.any():
            return field, f"of chunk {int(wrong.argmax())} {why}"
    enclosing = [count]
    for start, _, end in groups(levels):
        while enclosing[-1] <= start:
            enclosing.pop()
        if end > enclosing[-1]:
            return "jump", f"of chunk {start} is behind that of a group around it"
        enclosing.append(end)
    return None


def groups(levels: Levels) -> Iterator[tuple[int, int, int]]:
    """Yield the first chunk of each group, the chunk after its own ones, and its `jump`."""
    coarse = levels["error"] > 0
    ends = np.flatnonzero(coarse & (levels["last"] > 0))
    before = np.append(True, ~coarse[:-1] | (levels["last"][:-1] > 0))
    starts = np.flatnonzero(coarse & before[: len(coarse)])
    yield from zip(starts.tolist(), (ends + 1).tolist(), levels["jump"][ends].tolist(), strict=True)


def heights(levels: Levels) -> np.ndarray:
    """Return the level [C] of each chunk: 0 is the finest."""
    found = np.zeros(len(levels["error"]), np.int64)
    for start, end, jump in reversed(list(groups(levels))):
        found[start:end] = found[end:jump].max() + 1
    return found


def jumped(levels: Levels, enough: np.ndarray) -> np.ndarray:
    """Return the chunks [C] that a walk leaves out: those below a group that is coarse enough.

    enough: [C] whether the chunk's group is coarse enough; False for finest chunks
    """
    ends = enough & (levels["last"] > 0)
    inside = np.zeros(len(enough) + 1, np.int64)
    inside[np.flatnonzero(ends) + 1] += 1
    np.subtract.at(inside, levels["jump"][ends].astype(np.int64), 1)
    return np.cumsum(inside[:-1]) > 0
