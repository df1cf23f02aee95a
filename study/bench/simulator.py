"""`splatcore bench simulator`: CPU time of building and of simulating a machine in RTL.

Commands run in processes of their own with an empty cache, here and, with --against, in another
checkout in turn.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.reading import Reading
from splatcore.spec.cache import VARIABLE
from splatcore.spec.error import InputError
from splatcore.study.bench.measured import Checkout

ROUNDS = 3  # of the simulated frame, in turn
TINY_SIZE = "16x16"  # of the frame that a program is built for

COLUMNS = (
    Column("figure", get="what"),
    Column("here", digits=1),
    Column("against", digits=1),
    Column("ratio", "×", digits=2),
)


def bench_simulator(
    preset: str, scene: str, reading: Reading, size: str, other: Path | None
) -> dict:
    """Measure the checkouts; return a list of rows, each with a figure here and there.

    Raises InputError if a command fails.
    """
    checkouts = [Checkout()] + ([Checkout(other.absolute())] if other else [])
    for checkout in checkouts:
        _ = checkout.words  # raises InputError for a folder without one
    with TemporaryDirectory(prefix="splatcore") as name, progress_bar("simulator") as advance:
        folders = [Path(name) / str(number) for number in range(len(checkouts))]
        for folder in folders:
            folder.mkdir()

        def seconds(number: int, engine: str, its: str, *more: str) -> float:
            """CPU seconds of a frame. its: size"""
            advance(0, None, f"checkout {number}, {engine}, {its}")
            words = ["render", scene, "--preset", preset, "--size", its, "--engine", engine]
            words += " ".join(reading.options).split()
            folder = folders[number]
            cost = checkouts[number].measured(
                [*words, "-o", "frame.png", *more], folder, {VARIABLE: str(folder / "cache")}
            )
            if cost.why:
                raise InputError(f"bench simulator, checkout {number}: {cost.why}")
            return cost.cpu_seconds

        builds, frames = [], [0.0] * len(checkouts)
        for number in range(len(checkouts)):
            seconds(number, "golden", TINY_SIZE)  # compiles what all engines use
            cold = seconds(number, "rtl", TINY_SIZE)
            builds.append(cold - seconds(number, "rtl", TINY_SIZE))
        for turn in range(ROUNDS):
            for number in list(range(len(checkouts)))[:: -1 if turn % 2 else 1]:
                frames[number] += seconds(number, "rtl", size, "--json", "frame.json")
                frames[number] -= seconds(number, "golden", size)  # and both comparisons
        results = [json.loads((folder / "frame.json").read_text()) for folder in folders]
    cycles = [sum(result["halves"].values()) for result in results]  # the machines may differ
    rates = [ROUNDS * many / max(each, 1e-3) for many, each in zip(cycles, frames, strict=True)]
    figures = {
        "program from nothing, CPU seconds": builds,
        "frame, CPU seconds": [each / ROUNDS for each in frames],
        "cycles per CPU second": rates,
    }
    rows = [_row(name, *(round(each, 3) for each in found)) for name, found in figures.items()]
    return {"preset": preset, "size": size, "scene": scene, "cycles": cycles[0], "rows": rows}


def _row(name: str, here: float, against: float | None = None) -> dict:
    ratio = round(here / against, 3) if against else None
    return {"what": name, "here": here, "against": against, "ratio": ratio}


def table(found: dict) -> Table:
    """The table of a result."""
    caption = f"{found['preset']}, a frame of {found['size']}: {found['cycles']:,} cycles"
    return Table.of("simulator", caption, COLUMNS, found["rows"])
