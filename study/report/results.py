"""Results for a report: files written by rules of the Makefile, or else the repository's kept
tables."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.report.kept import Options, files, make_command, measured_with, read_kept
from splatcore.study.results.known import RESULTS, VARIABLES


class Facts(dict):
    """An object of a JSON file; a missing key raises an InputError with file and place."""

    def __init__(self, values: dict, file: str, place: str = ""):
        super().__init__()
        self.file, self.place = file, place
        for key, value in values.items():
            self[key] = _facts(value, file, f"{place}.{key}" if place else key)

    def __missing__(self, key):
        where = f"{self.place} has" if self.place else "has"
        raise InputError(f"{self.file}: {where} no key '{key}'")


def _facts(value: object, file: str, place: str) -> object:
    """Convert all objects in a value into `Facts`, except those that are."""
    if isinstance(value, Facts):
        return value
    if isinstance(value, dict):
        return Facts(value, file, place)
    if isinstance(value, list):
        return [_facts(item, file, f"{place}[{n}]") for n, item in enumerate(value)]
    return value


def _refuse(word: str):
    """Refuse NaN and infinity in JSON."""
    raise ValueError(f"{word} is not a number")


def read(path: Path) -> Facts:
    """Read a JSON file that holds an object; raise InputError with the file's name."""
    try:
        value = json.loads(path.read_text(), parse_constant=_refuse)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error})") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: is not a JSON object")
    return Facts(value, str(path))


def read_result(path: Path, several: str) -> Facts:
    """Read a result's file, or its rows from files of its folder: a pattern, if not empty."""
    if not several:
        return read(path)
    rows = [read(each) for each in sorted(path.parent.glob(several))]
    versions = dict.fromkeys(row.get("version", "") for row in rows)
    return Facts({"rows": rows, "version": "; ".join(filter(None, versions))}, str(path.parent))


@dataclass
class Results:
    """A folder of results.

    options: requested scenes, size and preset
    kept: folder of tables to use for missing results
    used: names of the results read since this list was cleared
    troubles: problems that do not prevent a result from being shown
    """

    folder: Path
    options: Options = field(default_factory=Options)
    kept: Path | None = None
    used: list[str] = field(default_factory=list)
    troubles: list[str] = field(default_factory=list)
    _found: dict[str, Options] = field(default_factory=dict)
    _commands: dict[str, str] = field(default_factory=dict)
    _versions: dict[str, str] = field(default_factory=dict)

    def command(self, name: str) -> str:
        """The command that produces a result, with the options recorded in it."""
        if name in self._commands:
            return self._commands[name]
        asked, found = self.options, self._found.get(name, Options())
        values = {
            "SCENES": " ".join(asked.scenes or found.scenes),
            "SIZE": asked.size or found.size,
            "PRESET": asked.preset or found.preset,
        }
        return make_command(RESULTS[name], self.folder, values, f"RESULTS={self.folder}")

    def version(self, name: str) -> str:
        """The version that produced a result; empty if unknown or not read yet."""
        return self._versions.get(name, "")

    def is_kept(self, name: str) -> bool:
        """Whether a result has to be read from the kept tables, as the folder lacks it."""
        if self.kept is None or (self.folder / RESULTS[name].file).exists():
            return False
        return any(path.exists() for path in files(RESULTS[name], self.kept))

    def from_kept(self, name: str) -> Facts:
        """A kept result's content; its command and version are stored in it."""
        self.used.append(name)
        first = next(iter(files(RESULTS[name], self.kept)))
        found = Facts(read_kept(RESULTS[name], self.kept), str(first))
        self._commands[name], self._versions[name] = found["command"], found["version"]
        return found

    def folder_of(self, name: str) -> Path:
        """The folder of a result and its pictures."""
        self.used.append(name)
        return self.kept if self.is_kept(name) else self.path(name).parent

    def path(self, name: str) -> Path:
        """A result's file; raises InputError if it is missing."""
        self.used.append(name)
        path = self.folder / RESULTS[name].file
        if not path.exists():
            raise InputError(f"{path}: does not exist; create with: {self.command(name)}")
        return path

    def facts(self, name: str) -> Facts:
        """A result's content; failures of a campaign are added to the troubles.

        Raises InputError if its size or preset is not the requested one.
        """
        if self.is_kept(name):
            found = self.from_kept(name)
        else:
            found = read_result(self.path(name), RESULTS[name].several)
            self._found[name] = measured_with(found)
            self._versions[name] = found.get("version", "")
        self.check(found, RESULTS[name].takes)
        if isinstance(failed := found.get("failed"), list):
            self.troubles += [f"{found.file}: {each['what']}: {each['why']}" for each in failed]
        return found

    def rows(self, name: str) -> tuple[Facts, list[Facts]]:
        """A result and its rows of the requested scenes; raises InputError if there is none."""
        facts = self.facts(name)
        if not (rows := self.of_scenes(facts["rows"])):
            raise InputError(f"{facts.file}: holds no row")
        return facts, rows

    def each(self, names: Iterable[str]) -> Iterator[Facts]:
        """Yield the contents of several results; errors of the others are added to the troubles."""
        for name in names:
            try:
                yield self.facts(name)
            except InputError as error:
                self.troubles.append(str(error))

    def check(self, found: Facts, takes: Sequence[str] = VARIABLES):
        """Raise InputError if a result's size or preset is not the requested one."""
        preset = self.options.preset and find_preset(self.options.preset).name
        for key, asked in (("size", self.options.size), ("preset", preset)):
            value = found.get(key)
            text = "x".join(map(str, value)) if isinstance(value, list) else value
            if key.upper() in takes and asked and text and asked != text:
                raise InputError(
                    f"{found.file}: is for {key} {text}, not {asked}; move it away, or use another "
                    "folder --results"
                )

    def of_scenes(self, rows: Iterable[Facts]) -> list[Facts]:
        """The rows of the requested scenes; a scene without rows is added to the troubles."""
        asked, rows = {Path(scene).name for scene in self.options.scenes}, list(rows)
        missing = sorted(asked - {row["scene"] for row in rows})
        if missing and rows:
            self.troubles.append(f"{rows[0].file}: has no rows of {', '.join(missing)}")
        return [row for row in rows if not asked or row["scene"] in asked]
