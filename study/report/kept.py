"""Results kept in the repository: CSV tables in docs/results, which the report can read.

A result is one JSON object. Its fields (`study.results`) say which values are kept: each of its
lists becomes a table; its other values become lines "# key: value" above each table, first the
command and the version that produced it. A cell is empty if the row lacks the key, and `null` if
JSON has null.
"""

import csv
import io
import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import splatcore
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.frame.source import VIEW_SIZE
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from splatcore.study.results.fields import Leaf, Sheet, Step, Value, is_text, leaves, sheets
from splatcore.study.results.known import Result

FOLDER = Path(splatcore.__file__).parent / "results"
"""A link to docs/results in a checkout, a folder in an installed wheel."""

ORIGIN = ("command", "version")
"""Keys of the first lines of every table."""

PLACE = "out/report/results"  # the Makefile's default folder of results


@dataclass(frozen=True)
class Options:
    """Requested scenes, size and preset; empty or None for any."""

    scenes: tuple[str, ...] = ()
    size: str | None = None
    preset: str | None = None


def measured_with(facts: dict) -> Options:
    """Options to reproduce a result, without defaults and without scene files."""
    about = {**next(iter(facts.get("rows", ())), {}), **facts}
    size, preset = about.get("size"), about.get("preset")
    size = "x".join(map(str, size)) if isinstance(size, list) else size
    scenes = [facts.get("scene"), *(row.get("scene") for row in facts.get("rows", ()))]
    return Options(
        tuple(dict.fromkeys(scene for scene in scenes if scene in GENERATORS)),
        None if size == "x".join(map(str, VIEW_SIZE)) else size,
        None if preset == DEFAULT.name else preset,
    )


def make_command(result: Result, folder: Path | str, values: dict, *more: str) -> str:
    """The command that makes a result. values: of the variables that it may use, or None."""
    given = [f"{key}={text}" for key, text in values.items() if text and key in result.takes]
    return shlex.join(["make", *more, *given, str(Path(folder) / result.file)])


def reproducing(result: Result, facts: dict) -> str:
    """The command that reproduces a result; scene files are searched for in SPLATCORE_SCENES."""
    rows = facts.get("rows", ())
    scenes = [facts.get("scene"), *(row.get("scene") for row in rows), *facts.get("scenes", ())]
    options, points = measured_with(facts), list(facts.get("points", ()))
    values = {
        "SCENES": " ".join(dict.fromkeys(filter(None, scenes))),
        "SIZE": options.size,
        "PRESET": options.preset,
        "POINTS": None if any(" " in point for point in points) else " ".join(points),
    }
    return make_command(result, PLACE, values)


INDEX = Leaf("", int, Value(), True)  # index of a row of an outer table


def look(value: object, path: str) -> tuple[bool, object]:
    """Look up a dotted path: (whether it exists, its value)."""
    for key in filter(None, path.split(".")):
        if not isinstance(value, dict) or key not in value:
            return False, None
        value = value[key]
    return True, value


def items(value: object, path: tuple[Step, ...]) -> Iterator[tuple[list, object]]:
    """Yield the items at a place, each with the cells of the place's own columns."""
    if not path:
        yield [], value
        return
    step, *rest = path
    for at, item in _pairs(look(value, step.key)[1]):
        for more, last in items(item, tuple(rest)):
            yield [*([at] if step.column and (rest or step.bracket == "{") else []), *more], last


def _pairs(found: list | dict | None) -> Iterator[tuple]:
    """Indices or keys, and items."""
    yield from found.items() if isinstance(found, dict) else enumerate(found or ())


def put(value: dict, keys: list, item: object):
    """Put an item at a path of keys; a list is represented as an object of indices."""
    for key in keys[:-1]:
        value = value.setdefault(key, {})
    value[keys[-1]] = item


def listed(value: object) -> object:
    """Convert objects of indices, as made by `put`, into lists."""
    if not isinstance(value, dict):
        return value
    found = {key: listed(item) for key, item in value.items()}
    return list(found.values()) if found and all(isinstance(k, int) for k in found) else found


def encoded(leaf: Leaf, value: object) -> str:
    """Encode a value as a cell. Text stands as it is, everything else is JSON; an empty cell is a
    value that is not there."""
    if isinstance(value, str) and value and is_text(leaf.kind):
        return value
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def decoded(leaf: Leaf, cell: str) -> object:
    """Decode a cell; ValueError if it is invalid."""
    if is_text(leaf.kind) and cell not in ("null", '""'):
        return cell
    return json.loads(cell, parse_constant=float)  # the report rejects NaN in JSON files only


def files(result: Result, folder: Path) -> dict[Path, Sheet]:
    """A result's tables by file."""
    found = {sheet.end: sheet for sheet in sheets(result.schema)}
    return {folder / f"{result.name}{'-' * bool(end)}{end}.csv": found[end] for end in found}


def lines(result: Result) -> list[Leaf]:
    """The values that are kept above the tables."""
    return [leaf for leaf in leaves(result.schema) if leaf.kept]


def tables(result: Result, facts: dict, command: str, folder: Path) -> dict[Path, str]:
    """CSV text of each file of a result."""
    about = {"command": command, "version": facts.get("version", "not said")}
    for leaf in lines(result):
        there, value = look(facts, leaf.key)
        about |= {leaf.key: encoded(leaf, value)} if there else {}
    texts = {}
    for path, sheet in files(result, folder).items():
        out = io.StringIO()
        out.writelines(f"# {key}: {value}\n" for key, value in about.items())
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(sheet.columns)
        for own, item in items(facts, sheet.place):
            cells = ((leaf, *look(item, leaf.key)) for leaf in sheet.kept)
            texts_of = (encoded(leaf, value) if there else "" for leaf, there, value in cells)
            writer.writerow([*own, *texts_of])
        texts[path] = out.getvalue()
    return texts


def read_kept(result: Result, folder: Path) -> dict:
    """Read a result's object, with `command` and `version`.

    Raises InputError that names the file and the column or line.
    """
    value: dict = {}
    for path, sheet in files(result, folder).items():
        try:
            text = path.read_text().splitlines()
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}") from None
        head = dict(line[2:].partition(": ")[::2] for line in text if line.startswith("# "))
        known = {key: None for key in ORIGIN} | {leaf.key: leaf for leaf in lines(result)}
        for key, leaf in known.items():
            if key not in head:
                raise InputError(f"{path}: has no line '# {key}: …'")
            put(value, key.split("."), _value(path, key, leaf, head[key]) if leaf else head[key])
        _rows(path, sheet, text[len(head) :], len(head), value)
    return listed(value)


def _rows(path: Path, sheet: Sheet, lines: list[str], above: int, value: dict):
    """Put the rows of a table into the object `value`. above: number of lines above the table."""
    heading, *rows = csv.reader(lines) if lines else [[]]
    wanted, place = sheet.columns, sheet.place
    for column in wanted:
        if column not in heading:
            raise InputError(f"{path}: column '{column}' is missing")
    for column in heading:
        if column not in wanted or heading.count(column) > 1:
            raise InputError(f"{path}: column '{column}' is unknown or occurs twice")
    put(value, place[0].key.split("."), look(value, place[0].key)[1] or {})
    for number, row in enumerate(rows):
        where = f"line {above + 2 + number}"
        if len(row) != len(heading):
            raise InputError(f"{path}: {where}: has {len(row)} cells, not {len(heading)}")
        cells = dict(zip(heading, row, strict=True))
        keys, item = [], {}
        for step in place:
            at = cells.get(step.column, number)
            keys += filter(None, step.key.split("."))
            keys.append(_value(path, where, INDEX, str(at)) if step.bracket == "[" else at)
        for leaf in sheet.kept:
            if (cell := cells[leaf.key]) != "":
                put(item, leaf.key.split("."), _value(path, f"{where}: {leaf.key}", leaf, cell))
        put(value, keys, item)


def _value(path: Path, where: str, leaf: Leaf, cell: str) -> object:
    try:
        return decoded(leaf, cell)
    except ValueError:
        raise InputError(f"{path}: {where}: '{cell}' is not a value") from None
