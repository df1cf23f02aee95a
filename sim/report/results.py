"""The results that a report is made of: files that other commands leave in a folder.

A file that is not there is made by the command that makes it, as a process of its own.
"""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from splatcore.sim.common.output import messages
from splatcore.sim.report.options import Options, said
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PROGRAM = "splatcore"
"""As the command is typed."""

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""What moves a terminal's cursor or sets its colours."""


@dataclass(frozen=True)
class Source:
    """A result and its command. file: in the folder of results; command: its words, DIR stands for
    that folder; takes: options that the command has, of `scenes`, `scene`, `size`, `preset`; fails:
    whether exit status 1 says something about the machine, not about the command.
    """

    file: str
    command: str
    takes: str = ""
    fails: bool = False


SOURCES = {
    "scenes": Source(
        "scenes/scenes.csv", "bench scenes --out DIR/scenes", "scenes size preset", True
    ),
    "sweep": Source("sweep/sweep.json", "bench sweep --out DIR/sweep", "scenes size"),
    "programs": Source("programs.json", "programs --json DIR/programs.json", "preset"),
    "programs-paper": Source(
        "programs-paper.json", "programs --preset PAPER --json DIR/programs-paper.json"
    ),
    "synth": Source("synth.json", "synth --stage top --json DIR/synth.json", "preset"),
    "memories": Source("memories.json", "memories --json DIR/memories.json", "preset"),
    "ablation": Source(
        "ablation/ablation.json", "bench ablation --out DIR/ablation", "scenes size preset"
    ),
    "work": Source("work/work.json", "bench work --out DIR/work", "scenes size preset"),
    "power": Source("power.json", "power --json DIR/power.json", "scene size preset"),
    "hard": Source(
        "hard/hard.json",
        "hard --engine golden -o DIR/hard --json DIR/hard/hard.json", "preset", True,
    ),
    "hard-rtl": Source(
        "hard-rtl/hard.json",
        "hard --engine rtl --preset TINY -o DIR/hard-rtl --json DIR/hard-rtl/hard.json", "", True,
    ),
    "hard-paper": Source(
        "hard-paper/hard.json",
        "hard --engine golden --preset PAPER -o DIR/hard-paper --json DIR/hard-paper/hard.json",
        "", True,
    ),
    "fpga-tiny": Source(
        "fpga-tiny.json", "fpga --preset TINY --json DIR/fpga-tiny.json", "", True
    ),
    "fpga": Source("fpga.json", "fpga --json DIR/fpga.json", "preset", True),
}  # fmt: skip
"""By name; `fit` has none, as nobody but its user knows what to ask it for."""


class Facts(dict):
    """An object of a JSON file; a key that it lacks is an InputError that names file and place."""

    def __init__(self, values: dict, file: str, place: str = ""):
        super().__init__()
        self.file, self.place = file, place
        for key, value in values.items():
            self[key] = _facts(value, file, f"{place}.{key}" if place else key)

    def __missing__(self, key):
        where = f"{self.place} has" if self.place else "has"
        raise InputError(f"{self.file}: {where} no key '{key}'")


def _facts(value: object, file: str, place: str) -> object:
    """A value with all objects in it as `Facts`."""
    if isinstance(value, dict):
        return Facts(value, file, place)
    if isinstance(value, list):
        return [_facts(item, file, f"{place}[{n}]") for n, item in enumerate(value)]
    return value


def _refuse(word: str):
    """JSON has no NaN and no infinity."""
    raise ValueError(f"{word} is no number")


def read(path: Path) -> Facts:
    """A JSON file that holds an object; InputError names the file."""
    try:
        value = json.loads(path.read_text(), parse_constant=_refuse)
    except FileNotFoundError:
        raise InputError(f"{path}: is not there") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error})") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: holds no object")
    return Facts(value, str(path))


@dataclass
class Results:
    """A folder of results. run: whether commands may be run for what is missing in it.

    used: names of the results asked for since it was emptied; troubles: what is wrong, yet leaves
    a result to show.
    """

    folder: Path
    options: Options = field(default_factory=Options)
    run: bool = False
    used: list[str] = field(default_factory=list)
    troubles: list[str] = field(default_factory=list)
    _made: dict[str, InputError | None] = field(default_factory=dict)
    _said: dict[str, Options] = field(default_factory=dict)

    def arguments(self, name: str) -> list[str]:
        """The arguments that make a result; of one that is there, those that it tells of."""
        source, options = SOURCES[name], self.options
        if found := self._said.get(name):
            options = Options(
                options.scenes or found.scenes, options.size or found.size,
                options.preset or found.preset,
            )  # fmt: skip
        else:
            options = options.resolved()
        words = [
            word.replace("DIR", str(self.folder), 1) if word.startswith("DIR") else word
            for word in source.command.split()
        ]
        return words + options.words(source.takes.split())

    def command(self, name: str) -> str:
        """The command that makes a result, as it is typed."""
        return shlex.join([PROGRAM, *self.arguments(name)])

    def path(self, name: str) -> Path:
        """A result's file, made if need be and allowed; InputError if it cannot be had."""
        self.used.append(name)
        if name not in self._made:
            try:
                self._made[name] = self._make(name)
            except InputError as error:
                self._made[name] = error
        if error := self._made[name]:
            raise error
        return self.folder / SOURCES[name].file

    def facts(self, name: str) -> Facts:
        """What a result says; InputError if it is of another size or machine than was asked for."""
        found = read(self.path(name))
        self.check(found, SOURCES[name].takes.split())
        self._said[name] = said(found)
        return found

    def each(self, names: Iterable[str]) -> Iterator[Facts]:
        """Those of several results that can be had; why the others cannot is a trouble."""
        for name in names:
            try:
                yield self.facts(name)
            except InputError as error:
                self.troubles.append(str(error))

    def check(self, found: Facts, takes: Iterable[str] = ("size", "preset")):
        """InputError if a result is of another size or of another machine than was asked for."""
        preset = self.options.preset and find_preset(self.options.preset).name
        for key, asked in (("size", self.options.size), ("preset", preset)):
            value = found.get(key)
            text = "x".join(map(str, value)) if isinstance(value, list) else value
            if key in takes and asked and text and asked != text:
                raise InputError(
                    f"{found.file}: is for {key} {text}, not {asked}; move it away, or name other "
                    "--results"
                )

    def of_scenes(self, rows: Iterable[Facts]) -> list[Facts]:
        """The rows of the scenes that were asked for; a scene without any is a trouble."""
        asked, rows = {Path(scene).name for scene in self.options.scenes}, list(rows)
        missing = sorted(asked - {row["scene"] for row in rows})
        if missing and rows:
            self.troubles.append(f"{rows[0].file}: has nothing about {', '.join(missing)}")
        return [row for row in rows if not asked or row["scene"] in asked]

    def several(self, name: str, pattern: str) -> Iterator[Facts]:
        """All JSON files beside a result's own."""
        for path in sorted(self.path(name).parent.glob(pattern)):
            found = read(path)
            self._said[name] = said(found)
            yield found

    def _make(self, name: str) -> InputError | None:
        """Run a result's command if there is no such file; why there still is none, else None."""
        source = SOURCES[name]
        path, command = self.folder / source.file, self.command(name)
        if path.exists():
            return None
        if not self.run:
            return InputError(f"{path}: is not there; made by: {command}")
        path.parent.mkdir(parents=True, exist_ok=True)
        messages.print(f"$ {command}", markup=False, soft_wrap=True, style="bold")
        status, last = run(self.arguments(name))
        said = f"{command}: exit status {status}" + (f", {last}" if last else "")
        if not path.exists():
            return InputError(f"{said}; there is no {path}")
        if status and not (source.fails and status == 1):
            self.troubles.append(said)
        return None


def run(arguments: list[str]) -> tuple[int, str]:
    """Run a command of ours; its exit status, and the last line on its standard error.

    What it says on standard error is passed on as it comes; what it prints is dropped, as its
    result is in a file.
    """
    environment = dict(os.environ)
    if messages.is_terminal:
        environment |= {"FORCE_COLOR": "1", "COLUMNS": str(messages.width)}
    said = b""
    with subprocess.Popen(
        [sys.executable, "-m", "splatcore", *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment,
    ) as process:  # fmt: skip
        while part := os.read(process.stderr.fileno(), 4096):
            sys.stderr.write(part.decode(errors="replace"))
            sys.stderr.flush()
            said = (said + part)[-4096:]
    lines = ESCAPE.sub("", said.decode(errors="replace")).replace("\r", "\n").split("\n")
    lines = [line.strip() for line in lines if line.strip()]
    return process.returncode, lines[-1] if lines else ""
