"""The command `coverage`: branches and lines of the hardware that simulations have reached."""

from collections import Counter
from pathlib import Path

from splatcore.app.cli.options import argument, command
from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError

KEYS = ("lines_reached", "lines", "branches_taken", "branches")

COLUMNS = (
    Column("file"),
    *(
        Column(name, digits=0, get=key)
        for name, key in zip(("lines", "of", "branches", "of"), KEYS, strict=True)
    ),
    Column("%", digits=1, get=lambda row: 100 * row["branches_taken"] / row["branches"]),
)


@command("coverage")
def coverage_command(
    folder: Path = argument(..., "DIR", "Folder with the counts of simulations."),
) -> dict:
    """Show which branches and lines of hdl/ simulations have reached.

    Lists those not reached. Simulations write counts to DIR if the environment variable
    SPLATCORE_COVERAGE names it; `make coverage` runs the tests of the whole machine that way. A
    branch is an arm of a condition, taken by any instance of a part; a line is reached if an arm of
    its conditions is taken.
    """
    from splatcore.sim.rtl.coverage import arms

    if not [*folder.glob("*.dat")]:
        raise InputError(f"{folder}: holds no counts of simulations; see --help")
    found = arms(folder)
    lines = Counter()
    for arm, count in found.items():
        lines[arm.place] += count
    rows = []
    for file in sorted({place.file for place in lines}):
        taken = [count > 0 for arm, count in found.items() if arm.place.file == file]
        reached = [count > 0 for place, count in lines.items() if place.file == file]
        numbers = sum(reached), len(reached), sum(taken), len(taken)
        rows.append({"file": file} | dict(zip(KEYS, numbers, strict=True)))
    rows.append({"file": "all"} | {key: sum(row[key] for row in rows) for key in KEYS})
    missed = [f"{arm.place} {arm.target}: {arm.arm}" for arm in sorted(found) if not found[arm]]
    for line in missed:
        console.print(line)
    Table.of("coverage", str(folder), COLUMNS, rows).print()
    return {"files": rows, "missed": missed}
