"""Plants faults in hdl/ and says how many the tests catch.

    python -m tb.planted.mutate [--count N] [--seed S] [FILE …]

A fault is one change to the Python text of one file: an operator, a constant, an index, a condition
that always holds, a handshake that is always high. Each is judged in a process of its own by quick
tests of the file. Faults that cannot be built say nothing about the tests and are not counted. Some
change nothing, as a sign of zero or a bit that is cut off again: what is missed has to be read.
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
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import track
from rich.table import Table

from tb.helpers.command import ROOT
from tb.helpers.stage_cases import STAGES
from tb.planted.fault import Fault, draw
from tb.planted.verdict import CAUGHT, NOT_BUILT

HDL = ROOT / "hdl"
MACHINE = (
    "tb/machine/test_machine.py tb/machine/test_faults.py "
    "-k 'garden or sizes or path or short_lists or long_list or empty or first'"
)
STAGE = "tb/hdl/test_points.py -k 'stages and {}'"
BLENDED = "tb/hdl/test_raster.py -k 'tiles or groups or queues or stop'"
RASTER = ("blend", "evaluate", "mark", "raster", "rasterizer", "setup")

JUDGES = {
    "": MACHINE,
    "arithmetic": "tb/hdl/test_float.py -k 'every_pair or every_triple or enable or conversions'",
    "arithmetic/minmax": "tb/hdl/test_float.py -k clamp",
    "arithmetic/unary": "tb/hdl/test_unary.py -k rtl",
    "arithmetic/unary_ends": "tb/hdl/test_unary.py -k rtl",
    "lib/counters": "tb/hdl/test_counters.py",
    "lib/shift": "tb/hdl/test_float.py -k 'every_pair or every_triple or conversions'",
    "lib/stream": "tb/hdl/test_stream.py -k verilator",
    "memory/axi": "tb/hdl/test_axi.py",
    "memory/bus": "tb/hdl/test_axi.py",
    "memory/fetch": "tb/hdl/test_fetch.py",
    "memory/store": MACHINE,
    "memory/share": "tb/hdl/test_groups.py",
    "memory/write_combiner": "tb/hdl/test_write_combiner.py",
    "points/array": "tb/hdl/test_array.py -k stalls",
    "points/codebook": "tb/hdl/test_codebook.py -k equals",
    "points/position": STAGE.format("cull"),
    "points/slots": STAGE.format("project"),
    **{f"points/{name}": STAGE.format(name) for name in STAGES},
    "points/chunk": "tb/hdl/test_chunk.py -k mixed",
    "points/load": "tb/hdl/test_model_reader.py",
    "points/model_reader": "tb/hdl/test_model_reader.py",
    "binning": "tb/hdl/test_bin.py -k '(hardware_equals and SHORT) or an_entry or buffers'",
    "binning/binned": MACHINE,
    "binning/row_end": "tb/hdl/test_row_end.py",
    "sorting": "tb/hdl/test_sort.py -k 'tiny or TINY or counters or stop'",
    "sorting/deal": "tb/hdl/test_deal.py -k 'not found'",
    "sorting/subsort": "tb/hdl/test_subsort.py -k 'equals or two_cycles or drop'",
    "raster/groups": "tb/hdl/test_groups.py",
    "raster/pixels": "tb/hdl/test_pixels.py -k 'not eight and not one'",
    "raster/prepare": "tb/hdl/test_raster.py -k 'prepare and DEFAULT'",
    **{f"raster/{name}": BLENDED for name in RASTER},
}
"""Tests that judge the faults of a file of hdl/ or of a folder's files, as arguments of pytest."""

COUNT = 40
PROCESSES = 2

TIMEOUT = 900  # seconds after which tests, compiling included, count as hung

PYTEST = "-x -q -p no:cacheprovider -p tb.planted.verdict -m 'not scenes'"
PASSED = 0
VERDICTS = {PASSED: "missed", CAUGHT: "caught", NOT_BUILT: "not built"}


def judge(file: str) -> str:
    """The tests of a file, named as in `points/cull`."""
    return next(JUDGES[name] for name in (file, file.split("/")[0], "") if name in JUDGES)


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


def verdict(fault: Fault | None, tests: str, cache: Path) -> str:
    """The verdict of tests on a fault, or of hardware without one."""
    with TemporaryDirectory() as folder:
        return VERDICTS[tested(Path(folder), tests, cache, fault)]


def judged(faults: list[Fault]) -> list[str]:
    """Verdicts on faults, each printed as it comes; RuntimeError if tests fail without a fault."""
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    with TemporaryDirectory() as cache, ThreadPoolExecutor(PROCESSES) as pool:

        def verdicts(faults: list[Fault | None], tests: list[str], label: str):
            found = pool.map(verdict, faults, tests, [Path(cache)] * len(tests))
            return track(found, label, len(tests), console=console, transient=True)

        used = list(dict.fromkeys(judge(fault.file) for fault in faults))
        for tests, found in zip(used, verdicts([None] * len(used), used, "trying"), strict=True):
            if found != VERDICTS[PASSED]:
                raise RuntimeError(f"pytest {tests}: fails without a fault")
        listed = []
        tests = [judge(fault.file) for fault in faults]
        for fault, found in zip(faults, verdicts(faults, tests, "judging"), strict=True):
            console.print(f"{found:9} {fault}")
            listed.append(found)
        return listed


def main(arguments: Sequence[str] | None = None) -> float:
    """Print what was missed and a table by kind; the share that was caught."""
    files = sorted(str(path.relative_to(HDL).with_suffix("")) for path in HDL.rglob("*.py"))
    files = [name for name in files if not name.endswith("__init__")]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="*", help=f"some of {', '.join(files)}; all by default")
    parser.add_argument("--count", type=int, default=COUNT, help="faults to judge")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    sources = {name: (HDL / f"{name}.py").read_text() for name in options.file or files}
    faults = draw(sources, options.count, options.seed)
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
