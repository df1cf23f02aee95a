"""Plant faults in hdl/ and say how many the benches catch.

    python -m tb.mutate [--count N] [--seed S] [FILE …]

A fault is one change to the Python text of one file: an operator, a constant, an index, a condition
that always holds, a handshake that is always high. Each is judged in a process of its own by the
check that the tests use: the hardware's outputs, under stalls, against the twin's. Faults that
cannot be built say nothing about the benches and are not counted. Some change nothing, as a sign
of zero or a bit that is cut off again: what is missed has to be read. `sim.planted.mutation` does
the like with many more faults in generated Verilog.
"""

import argparse
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

from tb.planted.fault import Fault, draw

HDL = Path(__file__).parent.parent / "hdl"

JUDGES = {
    "chunk": "chunk", "cull": "cull", "position": "cull", "place": "place", "array": "place",
    "project": "project", "slots": "project", "codebook": "project", "multiply": "arithmetic",
    "add": "arithmetic", "multiply_add": "arithmetic", "float": "arithmetic",
    "shift": "arithmetic", "convert": "arithmetic", "compare": "arithmetic",
    "bin": "bin", "outline": "bin", "rows": "bin", "row_end": "bin", "gather": "bin",
    "lists": "bin", "sort": "sort", "subsort": "sort", "merge": "sort", "runs": "sort",
    "refill": "sort", "prepare": "prepare", "expand": "raster", "setup": "raster",
    "mark": "raster", "evaluate": "raster", "blend": "raster", "rasterizer": "raster",
    "raster": "raster",
} | dict.fromkeys(
    "load model binned preprocess groups entries scratch features pixels render frame unpack store "
    "line fetch axi registers top".split(),
    "machine",
)  # fmt: skip
"""Files and what judges their faults (`tb.planted.judge`)."""

COUNT = 40
PROCESSES = 2
CAUGHT, MISSED = 1, 0
"""Exit status of `tb.planted.judge`; anything else: not built."""


def judged(fault: Fault) -> int:
    """Run the judge on a copy of hdl/ with the fault in it."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "hdl"
        copy.mkdir()
        for path in HDL.glob("*.py"):
            (copy / path.name).write_text(path.read_text())
        (copy / f"{fault.file}.py").write_text(fault.text)
        done = subprocess.run(
            [sys.executable, "-m", "tb.planted.judge", JUDGES[fault.file], folder],
            cwd=HDL.parent, capture_output=True, check=False,
        )  # fmt: skip
    return done.returncode


def main(arguments: Sequence[str] | None = None) -> float:
    """Print what was missed and a table by kind; the share that was caught."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="*", help=f"some of {', '.join(JUDGES)}; all by default")
    parser.add_argument("--count", type=int, default=COUNT, help="faults to judge")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    sources = {name: (HDL / f"{name}.py").read_text() for name in options.file or JUDGES}
    faults = draw(sources, options.count, options.seed)
    console, verdicts = Console(), []
    with ThreadPoolExecutor(PROCESSES) as pool:
        results = pool.map(judged, faults)
        for fault, status in zip(faults, track(results, "judging", len(faults)), strict=True):
            verdict = {CAUGHT: "caught", MISSED: "missed"}.get(status, "not built")
            verdicts.append((fault.kind, verdict))
            console.print(
                f"{verdict:9} {fault}", markup=False, highlight=False, emoji=False, soft_wrap=True
            )
    counts = Counter(verdicts)
    table = Table("kind", "caught", "missed", "not built")
    for kind in sorted({kind for kind, _ in verdicts}):
        row = (counts[kind, verdict] for verdict in ("caught", "missed", "not built"))
        table.add_row(kind, *map(str, row))
    console.print(table)
    caught = sum(n for (_, verdict), n in counts.items() if verdict == "caught")
    built = sum(n for (_, verdict), n in counts.items() if verdict != "not built")
    console.print(f"{caught} of {built} faults caught: {caught / max(built, 1):.1%}")
    return caught / max(built, 1)


if __name__ == "__main__":
    main()
