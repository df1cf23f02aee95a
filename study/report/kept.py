"""Results kept in the repository: CSV tables in docs/results, which the report can read.

A result is one JSON object. Each of its lists that the report reads becomes a table; its other
values become lines "# key: value" above each table, first the command and the version that
produced it. A cell is empty if the row lacks the key, and `null` if JSON has null.
"""

import csv
import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import splatcore
from splatcore.spec.error import InputError
from splatcore.study.report.kept_columns import TABLES, TEXTS, Sheet

FOLDER = Path(splatcore.__file__).parent / "results"
"""A link to docs/results in a checkout, a folder in an installed wheel."""

ORIGIN = ("command", "version")
"""Keys of the first lines of every table."""


@dataclass(frozen=True)
class Step:
    """One level of a sheet's place.

    key: dotted
    bracket: `[` for a list, `{` for an object
    column: for the list's index or the object's key; empty: no column
    """

    key: str
    bracket: str
    column: str


def steps(place: str) -> list[Step]:
    """Parse a place such as `rows[row].parts[]`."""
    found = re.findall(r"([a-z_.]+)?([\[{])([a-z]*)[\]}]", place)
    return [Step(key.strip("."), bracket, column) for key, bracket, column in found]


def columns(sheet: Sheet) -> list[str]:
    """Headings of a sheet's columns."""
    own = [step.column for step in steps(sheet.place) if step.column]
    return own + sheet.columns.split()


def look(value: object, path: str) -> tuple[bool, object]:
    """Look up a dotted path: (whether it exists, its value)."""
    for key in filter(None, path.split(".")):
        if not isinstance(value, dict) or key not in value:
            return False, None
        value = value[key]
    return True, value


def items(value: object, path: list[Step]) -> Iterator[tuple[list, object]]:
    """Yield the items at a place, each with the cells of the place's own columns."""
    if not path:
        yield [], value
        return
    there, found = look(value, path[0].key)
    if not there:
        return
    for at, item in enumerate(found) if path[0].bracket == "[" else found.items():
        for more, last in items(item, path[1:]):
            yield [*([at] if path[0].column else []), *more], last


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


def encoded(key: str, there: bool, value: object) -> str:
    """Encode a value as a cell; empty if it does not exist."""
    if not there:
        return ""
    if isinstance(value, str) and key.split(".")[-1] in TEXTS:
        return value
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def decoded(key: str, cell: str) -> object:
    """Decode a cell; ValueError if it is invalid. Text in brackets is JSON (for a size)."""
    if key.split(".")[-1] in TEXTS and cell != "null" and not cell.startswith("["):
        return cell
    return json.loads(cell, parse_constant=float)  # the report rejects NaN in JSON files only


def files(name: str, folder: Path) -> dict[Path, Sheet]:
    """A result's sheets by file."""
    sheets = TABLES[name].sheets
    return {folder / f"{name}{'-' * bool(end)}{end}.csv": sheet for end, sheet in sheets.items()}


def tables(name: str, facts: dict, command: str, folder: Path) -> dict[Path, str]:
    """CSV text of each file of a result."""
    origin = {"command": command, "version": facts.get("version", "not said")}
    keys = TABLES[name].lines.split()
    found = {key: look(facts, key) for key in keys}
    about = origin | {key: encoded(key, *value) for key, value in found.items() if value[0]}
    texts = {}
    for path, sheet in files(name, folder).items():
        out = io.StringIO()
        out.writelines(f"# {key}: {value}\n" for key, value in about.items())
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(columns(sheet))
        for own, item in items(facts, steps(sheet.place)):
            cells = ((key, *look(item, key)) for key in sheet.columns.split())
            writer.writerow([*own, *(encoded(*cell) for cell in cells)])
        texts[path] = out.getvalue()
    return texts


def read_kept(name: str, folder: Path) -> dict:
    """Read a result's object, with `command` and `version`.

    Raises InputError that names the file and the column or line.
    """
    value: dict = {}
    for path, sheet in files(name, folder).items():
        try:
            lines = path.read_text().splitlines()
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}") from None
        head = dict(line[2:].partition(": ")[::2] for line in lines if line.startswith("# "))
        for key in (*ORIGIN, *TABLES[name].lines.split()):
            if key not in head:
                raise InputError(f"{path}: has no line '# {key}: …'")
            cell = head[key]
            put(value, key.split("."), cell if key in ORIGIN else _value(path, key, key, cell))
        _rows(path, sheet, lines[len(head) :], len(head), value)
    return listed(value)


def _rows(path: Path, sheet: Sheet, lines: list[str], above: int, value: dict):
    """Put the rows of a table into the object `value`. above: number of lines above the table."""
    heading, *rows = csv.reader(lines) if lines else [[]]
    wanted, place = columns(sheet), steps(sheet.place)
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
            at = cells[step.column] if step.column else number
            keys += filter(None, step.key.split("."))
            keys.append(_value(path, where, "", str(at)) if step.bracket == "[" else at)
        for key in sheet.columns.split():
            if (cell := cells[key]) != "":
                put(item, key.split("."), _value(path, f"{where}: {key}", key, cell))
        put(value, keys, item)


def _value(path: Path, where: str, key: str, cell: str) -> object:
    try:
        return decoded(key, cell)
    except ValueError:
        raise InputError(f"{path}: {where}: '{cell}' is not a value") from None
