"""Streamed SOG scenes: lod-meta.json, a tree whose leaves name parts of SOG scenes by level.

Source: PlayCanvas' splat-transform 3.7.0, `readLodSource` and its writer. Level 0 is the finest.
Each level of a leaf is the leaf's whole content; only the environment is added to it. Leaves may
lack levels: we take what PlayCanvas' engine 2.22 draws for them (`GSplatLodTable`).
"""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path, PurePosixPath

from splatcore.model.formats import file, sog
from splatcore.model.formats.file import input_error
from splatcore.model.formats.sog_files import beside
from splatcore.spec.scene import Scene, joined

META = "lod-meta.json"


@dataclass(frozen=True, order=True)
class Part:
    """Gaussians `start` … `end` − 1 of the SOG scene with this index in 'filenames'."""

    unit: int
    start: int
    end: int


def read(path: str | os.PathLike, level: int | None = None) -> Scene:
    """Read one level of a streamed scene (default: the finest), and its environment."""
    meta = file.checked(file.parse_json(file.read_bytes(path), path), dict, path)
    if (version := file.field(meta, "version", int, path, 1)) != 1:
        raise input_error(path, f"streamed SOG version {version} is not supported")
    level, levels = level or 0, file.field(meta, "lodLevels", int, path)
    if levels < 1:
        raise input_error(path, f"'lodLevels' is {levels}")
    if level >= levels:
        raise input_error(path, f"--lod {level}: has levels 0 (the finest) … {levels - 1}")
    units = _units(meta, path)
    parts, other, ended = _parts(meta, level, len(units), path)
    scenes = [
        piece
        for unit, pieces in groupby(parts, lambda part: part.unit)
        for piece in _pieces(path, units[unit], list(pieces))
    ]
    held = sum(map(len, scenes))
    notes = (f"level of detail {level} of 0 … {levels - 1} (see --lod): {held} Gaussians",)
    if name := file.field(meta, "environment", str, path, ""):
        scenes.append(sog.read(beside(path, name)))
        notes += (f"environment of {len(scenes[-1])} Gaussians added",)
    if other:
        notes += (f"leaves without level {level}, read at the nearest one: {other}",)
    if ended:
        notes += (f"leaves of which nothing is left at level {level}: {ended}",)
    file.check_count(sum(map(len, scenes)), path)
    found = dict.fromkeys(note for scene in scenes for note in scene.notes)
    return replace(joined(scenes), name=os.fspath(path), notes=(*notes, *found))


def _units(meta: dict, path: str | os.PathLike) -> list[str]:
    """Names of the files of SOG scenes, each once."""
    where = f"{path}: 'filenames'"
    units = [file.checked(n, str, where) for n in file.field(meta, "filenames", list, path)]
    if len(set(map(PurePosixPath, units))) < len(units):
        raise input_error(where, "names a file twice")
    return units


def _parts(
    meta: dict, level: int, units: int, path: str | os.PathLike
) -> tuple[list[Part], int, int]:
    """The parts of all leaves at a level, sorted; numbers of leaves at other levels, and of none.

    Raises InputError if parts overlap, so that the scene is never larger than its files.
    """
    parts, held, other, ended = [], 0, 0, 0
    for leaf, where in _leaves(meta, path):
        part = _part(leaf, level, units, where)
        if part is None and (levels := _levels(leaf, units, where)):
            finer = [each for each in levels if each < level]
            if level > max(levels):
                ended += 1  # all of the leaf has faded
                continue
            part = _part(leaf, max(finer) if finer else min(levels), units, where)
            other += 1
        elif part is not None:
            held += part.end - part.start
        if part is not None:
            parts.append(part)
    parts.sort()
    for part, after in pairwise(parts):
        if part.unit == after.unit and after.start < part.end:
            raise input_error(path, f"level {level}: leaves overlap in file {part.unit}")
    counts = file.field(meta, "counts", list, path, [])
    if "counts" in meta and counts[level : level + 1] != [held]:
        raise input_error(path, f"level {level}: leaves hold {held} Gaussians, 'counts' differs")
    return parts, other, ended


def _part(leaf: dict, level: int, units: int, where: str) -> Part | None:
    """The part of a leaf at a level; None if the leaf lacks it, or it holds no Gaussian."""
    if (entry := leaf.get(str(level))) is None:
        return None
    where = f"{where}: level {level}"
    entry = file.checked(entry, dict, where)
    names = ("file", "offset", "count")
    unit, start, count = (file.field(entry, name, int, where) for name in names)
    if not 0 <= unit < units:
        raise input_error(where, f"'file' {unit} is not among {units} files")
    if start < 0 or count < 0:
        raise input_error(where, f"'offset' {start} or 'count' {count} is negative")
    return Part(unit, start, start + count) if count else None


def _levels(leaf: dict, units: int, where: str) -> list[int]:
    """The levels at which a leaf holds Gaussians."""
    keys = (int(key) for key in leaf if re.fullmatch(r"0|[1-9][0-9]{,8}", key))
    return [level for level in keys if _part(leaf, level, units, where)]


def _leaves(meta: dict, path: str | os.PathLike) -> Iterator[tuple[dict, str]]:
    """Yield the 'lods' of all leaves of the tree, each with its location for messages."""
    nodes, index = [file.field(meta, "tree", dict, path)], 0
    while nodes:
        where = f"{path}: node {index}"
        node, index = file.checked(nodes.pop(), dict, where), index + 1
        yield file.field(node, "lods", dict, where, {}), where
        nodes.extend(reversed(file.field(node, "children", list, where, [])))


def _pieces(path: str | os.PathLike, name: str, parts: list[Part]) -> list[Scene]:
    """The parts of one SOG scene, which must exist in it."""
    unit = beside(path, name)
    scene = sog.read(unit)
    for part in parts:
        if part.end > len(scene):
            have = f"has {len(scene)} Gaussians"
            raise input_error(unit, f"{have}, {Path(path).name} takes {part.start} … {part.end}")
    return [scene[part.start : part.end] for part in parts]
