"""Plant faults in hdl/ and count how many the tests catch.

    python -m tb.planted.mutate [--count N] [--seed S] [--results FILE] [--again] [FILE …]

A fault is one change in one Python file: an operator, a constant, an index, a condition that always
holds, a handshake that is always high. The tests of its file, of its stage and of the machine run
in separate processes until one catches it. Faults that cannot be built are not counted. Some faults
have no effect, such as the sign of a zero or a bit that is cut off: read the missed ones. The
results table keeps a verdict as long as the faulty file's text is the same, so a run continues
where the last one stopped.
"""

import argparse
import csv
import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

from rich.console import Console
from rich.progress import track

from splatcore.sim.common.cache import kept_json
from splatcore.sim.common.output import write
from splatcore.sim.common.table import Column, Table
from splatcore.spec.cache import cache_root
from tb.helpers.command import ROOT
from tb.planted.fault import Fault, draw, faults
from tb.planted.judges import judges
from tb.planted.verdict import CAUGHT, NOT_BUILT

HDL = ROOT / "hdl"

COUNT = 40
PROCESSES = 2

RESULTS = ROOT / "docs" / "results" / "planted.csv"
COLUMNS = ("file", "line", "kind", "before", "after", "verdict", "tests", "text")
"""Columns of the results. tests: that gave the verdict; text: hash of the file with the fault."""

TIMEOUT = 3600  # seconds, compiling included, after which tests count as hung

CHOICE = "-p no:cacheprovider -m 'not scenes and not verify'"
PYTEST = f"-x -q -p tb.planted.verdict {CHOICE}"
PASSED = 0
VERDICTS = {PASSED: "missed", CAUGHT: "caught", NOT_BUILT: "not built"}


def tested(folder: Path, tests: str, cache: Path, fault: Fault | None = None) -> int:
    """Run tests on a copy of hdl/ with a fault; pytest's exit status.

    folder: empty, for the copy
    tests: arguments of pytest
    cache: folder of compiled simulations
    Raises RuntimeError for another status than those in `VERDICTS`.
    """
    package = folder / "splatcore"
    package.mkdir()
    for name in ("tb", "pyproject.toml"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("spec", "model", "golden", "sim", "eda", "study", "app"):
        (package / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "src" / "splatcore" / "__init__.py", package)
    shutil.copytree(HDL, package / "hdl")
    if fault:
        (package / "hdl" / f"{fault.file}.py").write_text(fault.text)
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *shlex.split(PYTEST), *shlex.split(tests)],
        cwd=folder, env=os.environ | {"SPLATCORE_CACHE": str(cache)}, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        log, _ = process.communicate(timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return CAUGHT
    if process.returncode not in VERDICTS:
        raise RuntimeError(f"pytest {tests}: status {process.returncode}\n{log}")
    return process.returncode


def verdict(tests: str, cache: Path, fault: Fault | None = None) -> str:
    """The verdict of tests on a fault, or on hardware without a fault."""
    with TemporaryDirectory() as folder:
        return VERDICTS[tested(Path(folder), tests, cache, fault)]


class Court:
    """Judges faults; first checks that the tests pass without a fault.

    cache: folder of compiled simulations of hardware with faults
    """

    def __init__(self, cache: Path):
        self.cache = cache
        self.lock = Lock()

    def judged(self, fault: Fault) -> tuple[str, str]:
        """A verdict, and the tests that gave it; RuntimeError if tests fail without a fault."""
        for tests in judges(fault.file):
            self.check(tests)
            if (found := verdict(tests, self.cache, fault)) != VERDICTS[PASSED]:
                return found, tests
        return VERDICTS[PASSED], ""

    def check(self, tests: str) -> None:
        """RuntimeError if tests fail without a fault."""

        def passes() -> bool:
            if verdict(tests, cache_root()) != VERDICTS[PASSED]:
                raise RuntimeError(f"pytest {tests}: fails without a fault")
            return True

        with self.lock:
            kept_json("planted", [tests, sources("hdl"), sources("tb")], passes)


class Results:
    """Verdicts, and the tests that gave them, by fault, stored in a table on disk."""

    def __init__(self, path: Path):
        self.path, self.rows, self.lock = path, {}, Lock()
        if path.exists():
            with path.open(newline="") as file:
                self.rows = {row["text"]: row for row in csv.DictReader(file)}

    def __getitem__(self, fault: Fault) -> tuple[str, str] | None:
        row = self.rows.get(_hash(fault))
        return (row["verdict"], row["tests"]) if row else None

    def __setitem__(self, fault: Fault, found: tuple[str, str]):
        about = (fault.file, fault.line, fault.kind, fault.before, fault.after)
        with self.lock:
            row = dict(zip(COLUMNS, (*about, *found, _hash(fault)), strict=True))
            self.rows[_hash(fault)] = row
            self._write()

    def _write(self):
        listed = sorted(self.rows.values(), key=lambda row: (row["file"], int(row["line"])))
        text = StringIO(newline="")
        table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(listed)
        write(self.path, text.getvalue().encode())

    def keep(self, faults: Iterable[Fault]):
        """Remove the verdicts on all other faults."""
        known = set(map(_hash, faults))
        self.rows = {key: row for key, row in self.rows.items() if key in known}


def _hash(fault: Fault) -> str:
    return hashlib.sha256(f"{fault.file}\0{fault.text}".encode()).hexdigest()[:16]


def judged(faults: list[Fault], results: Results, again: bool = False) -> list[str]:
    """Judge faults and print the verdicts; RuntimeError if tests fail without a fault.

    again: whether to judge missed faults again
    """
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    with TemporaryDirectory() as cache, ThreadPoolExecutor(PROCESSES) as pool:
        court = Court(Path(cache))

        def one(fault: Fault) -> str:
            known = results[fault]
            if known is None or (again and known[0] == VERDICTS[PASSED]):
                known = results[fault] = court.judged(fault)
            found, tests = known
            console.print(f"{found:9} {fault}" + f"   by {tests}" * bool(tests))
            return found

        verdicts = pool.map(one, faults)
        return list(track(verdicts, "judging", len(faults), console=console, transient=True))


@cache
def sources(folder: str) -> dict[str, str]:
    """Text of the Python files in a folder of the project, by name."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {str(path.relative_to(ROOT)): path.read_text() for path in paths}


def texts_of(files: Iterable[str]) -> dict[str, str]:
    """Text of files in hdl/, by name."""
    return {name: (HDL / f"{name}.py").read_text() for name in files}


def main(arguments: Sequence[str] | None = None) -> float:
    """Judge faults, print verdicts and a table by kind. Returns the share of caught faults."""
    files = sorted(str(path.relative_to(HDL).with_suffix("")) for path in HDL.rglob("*.py"))
    files = [name for name in files if not name.endswith("__init__")]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="*", help=f"some of {', '.join(files)}; all by default")
    parser.add_argument("--count", type=int, default=COUNT, help="faults to judge")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--results", type=Path, default=RESULTS, help="table that is kept from run to run"
    )
    parser.add_argument("--again", action="store_true", help="judge missed faults again")
    options = parser.parse_args(arguments)
    texts = texts_of(options.file or files)
    drawn = draw(texts, options.count, options.seed)
    results = Results(options.results)
    results.keep(fault for name, text in texts_of(files).items() for fault in faults(name, text))
    verdicts = judged(drawn, results, options.again)
    counts = Counter((fault.kind, found) for fault, found in zip(drawn, verdicts, strict=True))
    outcomes = ("caught", "missed", "not built")
    kinds = sorted({fault.kind for fault in drawn})
    rows = [(kind, *(counts[kind, found] for found in outcomes)) for kind in kinds]
    columns = [Column("kind"), *(Column(outcome, digits=0) for outcome in outcomes)]
    caught = verdicts.count("caught")
    built = len(verdicts) - verdicts.count("not built")
    Table("planted", "", columns, rows).print()
    Console().print(f"{caught} of {built} faults caught: {caught / max(built, 1):.1%}")
    return caught / max(built, 1)


if __name__ == "__main__":
    main()
