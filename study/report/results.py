"""Results for a report: files written by rules of the Makefile, or else the repository's kept
tables."""

import json
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.frame.source import VIEW_SIZE
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.report.kept import files, read_kept

ALL = "SCENES SIZE PRESET"

SOURCES = {
    "scenes": ("scenes/scenes.csv", ALL),
    "budget": ("budget.json", ALL),
    "quality": ("quality/quality.json", ALL),
    "sweep": ("sweep/sweep.json", "SCENES SIZE POINTS"),
    "synth": ("synth.json", "PRESET"),
    "memories": ("memories.json", "PRESET"),
    "ablation": ("ablation/ablation.json", ALL),
    "power": ("power.json", ALL),
    "hard": ("hard/hard.json", "PRESET"),
    "hard-rtl": ("hard-rtl/hard.json", ""),
    "hard-paper": ("hard-paper/hard.json", ""),
    "fpga-tiny": ("fpga-tiny.json", ""),
    "fpga": ("fpga.json", "PRESET"),
    "fpga-whole": ("fpga-whole.json", ""),
    "compression": ("compression/compression.json", "SCENES"),
}
"""File of each result, and the make variables of its rule. `fit` has no rule, as its targets are up
to the user."""


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
    """Convert all objects in a value into `Facts`."""
    if isinstance(value, dict):
        return Facts(value, file, place)
    if isinstance(value, list):
        return [_facts(item, file, f"{place}[{n}]") for n, item in enumerate(value)]
    return value


def in_units(facts: dict, key: str | None, unit: float) -> float | None:
    """A number in another unit; None if it is missing."""
    value = facts.get(key)
    return None if value is None else value / unit


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


@dataclass(frozen=True)
class Options:
    """Requested scenes, size and preset; empty or None for any."""

    scenes: tuple[str, ...] = ()
    size: str | None = None
    preset: str | None = None


def measured_with(facts: dict) -> Options:
    """Options to reproduce a result, without defaults and without scene files."""
    size, preset = facts.get("size"), facts.get("preset")
    size = "x".join(map(str, size)) if isinstance(size, list) else size
    scenes = [facts.get("scene"), *(row.get("scene") for row in facts.get("rows", ()))]
    return Options(
        tuple(dict.fromkeys(scene for scene in scenes if scene in GENERATORS)),
        None if size == "x".join(map(str, VIEW_SIZE)) else size,
        None if preset == DEFAULT.name else preset,
    )


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
        (file, takes), asked = SOURCES[name], self.options
        found = self._found.get(name, Options())
        values = {
            "SCENES": " ".join(asked.scenes or found.scenes),
            "SIZE": asked.size or found.size,
            "PRESET": asked.preset or found.preset,
        }
        given = [f"{key}={value}" for key, value in values.items() if value and key in takes]
        return shlex.join(["make", f"RESULTS={self.folder}", *given, str(self.folder / file)])

    def version(self, name: str) -> str:
        """The version that produced a result; empty if unknown or not read yet."""
        return self._versions.get(name, "")

    def is_kept(self, name: str) -> bool:
        """Whether a result has to be read from the kept tables, as the folder lacks it."""
        if self.kept is None or (self.folder / SOURCES[name][0]).exists():
            return False
        return any(path.exists() for path in files(name, self.kept))

    def from_kept(self, name: str) -> Facts:
        """A kept result's content; its command and version are stored in it."""
        self.used.append(name)
        found = Facts(read_kept(name, self.kept), str(next(iter(files(name, self.kept)))))
        self._commands[name], self._versions[name] = found["command"], found["version"]
        return found

    def folder_of(self, name: str) -> Path:
        """The folder of a result and its pictures."""
        self.used.append(name)
        return self.kept if self.is_kept(name) else self.path(name).parent

    def path(self, name: str) -> Path:
        """A result's file; raises InputError if it is missing."""
        self.used.append(name)
        path = self.folder / SOURCES[name][0]
        if not path.exists():
            raise InputError(f"{path}: does not exist; create with: {self.command(name)}")
        return path

    def facts(self, name: str) -> Facts:
        """A result's content; raises InputError if its size or preset is not the requested one."""
        if self.is_kept(name):
            found = self.from_kept(name)
        else:
            found = read(self.path(name))
            self._found[name] = measured_with(found)
            self._versions[name] = found.get("version", "")
        self.check(found, SOURCES[name][1])
        return found

    def campaign(self, name: str) -> Facts:
        """A campaign's result; its failures are added to the troubles."""
        facts = self.facts(name)
        for failed in facts["failed"]:
            self.troubles.append(f"{facts.file}: {failed['what']}: {failed['why']}")
        return facts

    def rows(self, name: str) -> tuple[Facts, list[Facts]]:
        """A campaign's result and its rows of the requested scenes.

        Raises InputError if there is none.
        """
        facts = self.campaign(name)
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

    def check(self, found: Facts, takes: str = ALL):
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

    def several(self, name: str, pattern: str) -> Iterator[Facts]:
        """Yield the contents of all JSON files in a result's folder, or a kept result's rows."""
        if self.is_kept(name):
            yield from self.from_kept(name)["rows"]
            return
        versions: dict[str, None] = {}
        for path in sorted(self.path(name).parent.glob(pattern)):
            found = read(path)
            self._found[name] = measured_with(found)
            versions[found.get("version", "")] = None
            self._versions[name] = "; ".join(filter(None, versions))
            yield found
