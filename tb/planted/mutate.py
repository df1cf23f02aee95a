"""Plants faults in hdl/ and says how many the tests catch.

    python -m tb.planted.mutate [--count N] [--seed S] [FILE …]

A fault is one change to the Python text of one file: an operator, a constant, an index, a condition
that always holds, a handshake that is always high. Each meets the tests of its file, of its stage
and of the machine, in processes of their own, until one catches it. Faults that cannot be built say
nothing about the tests and are not counted. Some change nothing, as a sign of zero or a bit that is
cut off again: what is missed has to be read. Verdicts are kept (see `splatcore cache`) until a file
of hdl/ or tb/ changes.
"""

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

from rich.console import Console
from rich.progress import track
from rich.table import Table

from splatcore.sim.common.cache import cache_root, kept_json
from tb.helpers.command import ROOT
from tb.planted.fault import Fault, draw
from tb.planted.judges import judges
from tb.planted.verdict import CAUGHT, NOT_BUILT

HDL = ROOT / "hdl"

COUNT = 40
PROCESSES = 2

TIMEOUT = 900  # seconds after which tests, compiling included, count as hung

PYTEST = "-x -q -p no:cacheprovider -p tb.planted.verdict -m 'not scenes and not verify'"
PASSED = 0
VERDICTS = {PASSED: "missed", CAUGHT: "caught", NOT_BUILT: "not built"}


def tested(folder: Path, tests: str, cache: Path, fault: Fault | None = None) -> int:
    """Exit status of tests, in an empty folder, of a copy of hdl/ with a fault in it.

    cache: keeps compiled simulations. RuntimeError if pytest fails for reasons of its own.
    """
    package = folder / "splatcore"
    package.mkdir()
    for name in ("tb", "pyproject.toml"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("spec", "model", "golden", "sim"):
        (package / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "splatcore" / "__init__.py", package)
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
    """The verdict of tests on a fault, or of hardware without one."""
    with TemporaryDirectory() as folder:
        return VERDICTS[tested(Path(folder), tests, cache, fault)]


class Court:
    """Judges faults, and finds out first whether tests pass without any.

    cache: keeps the compiled simulations of hardware with faults in it.
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


def judged(faults: list[Fault]) -> list[str]:
    """Verdicts on faults, each printed as it comes; RuntimeError if tests fail without a fault."""
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    listed = []
    with TemporaryDirectory() as cache, ThreadPoolExecutor(PROCESSES) as pool:
        court = Court(Path(cache))

        def one(fault: Fault) -> list[str]:
            made_from = [fault, judges(fault.file), sources("hdl"), sources("tb")]
            return kept_json("planted", made_from, lambda: court.judged(fault))

        verdicts = track(
            pool.map(one, faults), "judging", len(faults), console=console, transient=True
        )
        for fault, (found, tests) in zip(faults, verdicts, strict=True):
            console.print(f"{found:9} {fault}" + f"   by {tests}" * bool(tests))
            listed.append(found)
    return listed


@cache
def sources(folder: str) -> dict[str, str]:
    """The Python files of a folder of the project, by name."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {str(path.relative_to(ROOT)): path.read_text() for path in paths}


def main(arguments: Sequence[str] | None = None) -> float:
    """Print what was missed and a table by kind; the share that was caught."""
    files = sorted(str(path.relative_to(HDL).with_suffix("")) for path in HDL.rglob("*.py"))
    files = [name for name in files if not name.endswith("__init__")]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="*", help=f"some of {', '.join(files)}; all by default")
    parser.add_argument("--count", type=int, default=COUNT, help="faults to judge")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    texts = {name: (HDL / f"{name}.py").read_text() for name in options.file or files}
    faults = draw(texts, options.count, options.seed)
    verdicts = judged(faults)
    counts = Counter((fault.kind, found) for fault, found in zip(faults, verdicts, strict=True))
    table = Table("kind", "caught", "missed", "not built")
    for kind in sorted({fault.kind for fault in faults}):
        row = (counts[kind, found] for found in ("caught", "missed", "not built"))
        table.add_row(kind, *map(str, row))
    caught = verdicts.count("caught")
    built = len(verdicts) - verdicts.count("not built")
    Console().print(table)
    Console().print(f"{caught} of {built} faults caught: {caught / max(built, 1):.1%}")
    return caught / max(built, 1)


if __name__ == "__main__":
    main()
