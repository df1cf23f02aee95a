"""Memory that work on many Gaussians needs, and memory that is available: `check_need`.

`NEEDS` is measured: `splatcore bench scale` prints its rows (and writes them to scale.json).
"""

import os
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from splatcore.spec.error import InputError

PROC, GROUPS = Path("/proc"), Path("/sys/fs/cgroup")

GIGA = 1e9


class Need(NamedTuple):
    """Peak of a process's anonymous memory: base + gaussians · (gaussian + coefficients ·
    coefficient).

    base: bytes of an empty scene
    gaussian: bytes per Gaussian without harmonics
    coefficient: bytes per Gaussian and coefficient of its harmonics, of (degree + 1)²
    scene: whether that includes a scene that was opened before
    label: the work, `{}` stands for the Gaussians
    less: what needs less
    """

    base: float
    gaussian: float
    coefficient: float
    scene: bool
    label: str
    less: str

    def bytes(self, count: int, degree: int) -> float:
        """Bytes for `count` Gaussians of an SH degree."""
        return self.base + count * (self.gaussian + self.coefficient * (degree + 1) ** 2)


FEWER = "fewer Gaussians"

NEEDS = {
    "reading": Need(34e6, 130, 13, False, "reading {}", f"{FEWER}, or a coarser --lod, need less"),
    "packing": Need(
        500e6, 350, 20, True, "packing {}", f"{FEWER}, or splatcore pack --sh-degree 1, need less"
    ),
    "reference": Need(
        300e6, 300, 15, True, "rendering {} by the reference",
        f"{FEWER} need less, and a packed model with --engine golden --no-compare",
    ),
    "golden": Need(
        300e6, 400, 0, False, "rendering {} by the golden model",
        f"{FEWER} need less, and a model from splatcore pack instead of a scene",
    ),
}  # fmt: skip
"""By kind of work, rounded up."""


def check_need(work: str, count: int, degree: int, name: str):
    """Raise InputError if the memory for some work on a scene or model is not available.

    work: a key of `NEEDS`
    name: of the scene or model
    """
    need, room = NEEDS[work], available()
    if room is None:
        return
    if need.scene:  # it has its memory already
        room += min(anonymous() or 0, NEEDS["reading"].bytes(count, degree))
    if (wanted := need.bytes(count, degree)) > room:
        label = need.label.format(f"{count:,} Gaussians of SH degree {degree}")
        raise InputError(
            f"{name}: {label} needs {wanted / GIGA:.1f} GB of memory, but {room / GIGA:.1f} GB are "
            f"available; {need.less}"
        )


def available() -> int | None:
    """Return the bytes that this process can still get: free memory and swap, at most what its
    control groups allow; None if the system does not say."""
    try:
        found = _numbers(PROC / "meminfo")
    except OSError:
        return None
    free = 1024 * (found.get("MemAvailable", 0) + found.get("SwapFree", 0))
    return min([free, *_group_rooms()])


def _group_rooms() -> Iterator[int]:
    """Yield the bytes that each control group above this process still allows."""
    try:
        text = (PROC / "self" / "cgroup").read_text()
    except OSError:
        return
    for line in text.splitlines():
        _, kinds, path = line.split(":", 2)
        if kinds and "memory" not in kinds.split(","):
            continue
        root = GROUPS / "memory" if kinds else GROUPS
        inner = [root, *(root / part for part in accumulate(Path(path).parts[1:], os.path.join))]
        for folder in inner:
            if (room := _group_room(folder, *(_V1 if kinds else _V2))) is not None:
                yield room


_V1 = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
_V2 = "memory.max", "memory.current", "inactive_file"
"""Files of limit and usage, and key of the file pages that the system may drop: versions 1 and 2 of
control groups."""


def _group_room(folder: Path, limit: str, usage: str, dropped: str) -> int | None:
    """Return the bytes that a control group still allows; None if it has no limit."""
    try:
        most = int((folder / limit).read_text())
        used = int((folder / usage).read_text())
        spare = _numbers(folder / "memory.stat").get(dropped, 0)
    except (OSError, ValueError):  # no such file, or "max"
        return None
    return max(most - used + spare, 0)


def _numbers(path: Path) -> dict[str, int]:
    """Return the numbers of a file of lines `NAME: NUMBER UNIT`."""
    rows = (line.replace(":", " ").split() for line in path.read_text().splitlines())
    return {row[0]: int(row[1]) for row in rows if len(row) > 1 and row[1].isdecimal()}


def anonymous(process: int | str = "self") -> int | None:
    """Return the bytes of anonymous memory of a process and its children; None if unknown."""
    try:
        found = 1024 * _numbers(PROC / str(process) / "status").get("RssAnon", 0)
        tasks = list((PROC / str(process) / "task").iterdir())
    except OSError:  # ended, or no such system
        return None
    for task in tasks:
        try:
            children = (task / "children").read_text().split()
        except OSError:
            continue
        found += sum(anonymous(child) or 0 for child in children)
    return found
