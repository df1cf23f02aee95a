"""The report's section on the error budget of a picture, part by part."""

from collections.abc import Iterator

from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.metric import LEVELS
from splatcore.study.accuracy.budget import SUM, TITLES, WHOLES, draw_budget
from splatcore.study.report.page import Card, Item, plotted
from splatcore.study.report.results import Facts, Results
from splatcore.study.report.scenes import count_of, name, names
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import BudgetRow

BAR, AROUND = 0.07, 1.6  # inches of a plot per bar; for its axis and legend


def lines(rows: list[Facts], key: str, scale: float = 1) -> list[list]:
    """One row per part that any view has: its group, its name, one number per view."""
    known = [{(each["of"], each["part"]): each[key] for each in row["parts"]} for row in rows]
    parts = sorted(dict.fromkeys(k for found in known for k in found), key=lambda k: order(*k))
    numbers = ([found.get(part) for found in known] for part in parts)
    return [
        [*part, *(None if n is None else n * scale for n in of_part)]
        for part, of_part in zip(parts, numbers, strict=True)
    ]  # fmt: skip


def order(of: str, part: str) -> tuple[int, int]:
    """Sort key of a row: parts in their order, then their sum, then the whole."""
    last = (SUM, TITLES[of])
    return WHOLES.index(of), last.index(part) + 1 if part in last else 0


def parts(results: Results) -> Iterator[Item]:
    """PSNR and largest errors of all parts."""
    _, rows = results.rows("budget")
    decibels = lines(rows, "psnr_db")
    strong = frozenset(n for n, (of, part, *_) in enumerate(decibels) if part == TITLES[of])
    head = [Column("group"), Column("part")]
    worst = min(rows, key=lambda row: row["psnr_db_scene"] or float("inf"))
    if worst["psnr_db_scene"] is not None:
        yield Card(
            "How exact", f"{worst['psnr_db_scene']:.1f} dB",
            f"golden model against the scene as trained, all harmonics, the lowest of "
            f"{count_of(rows)} ({name(worst)}, packed as {worst['quality']})",
        )  # fmt: skip
    yield Table(
        "budget",
        "PSNR per view of pictures in which only one part is inexact. Packing: the reference with "
        "one part of the Gaussians packed, against the reference on the scene as trained. Machine: "
        "one part of the machine inexact, against the reference on the same packed model. Scene: "
        "everything, against the scene as trained. Only the part “8 bits” is rounded to 8 bits. "
        "Sum: squared errors added. –: equal pictures, or a part that the scene does not have.",
        [*head, *(Column(text, "dB", 1) for text in names(rows))],
        decibels, strong,
    )  # fmt: skip
    yield Table(
        "budget-largest",
        f"Largest error per channel of the same pictures, in steps of 1/{LEVELS}.",
        [*head, *(Column(text, "", 1) for text in names(rows))],
        [line for line in lines(rows, "max_error", LEVELS) if line[1] != SUM],
    )  # fmt: skip
    yield Table.of(
        "budget-wholes",
        "The same views measured as in the other tables, between 8-bit pictures. Packing: the "
        "reference on the packed model against the reference on the scene as trained. Machine: the "
        "golden model against the reference on the same packed model. Scene: the golden model "
        "against the reference on the scene as trained.",
        columns(
            BudgetRow,
            "scene camera quality bytes_per_gaussian psnr_db_packing psnr_db_machine psnr_db_scene",
        ),
        rows,
    )  # fmt: skip


def bars(results: Results) -> Iterator[Item]:
    """RMS errors of the parts."""
    _, rows = results.rows("budget")
    count = sum(len(row["parts"]) for row in rows)
    yield plotted(
        "budget-bars",
        "RMS error of pictures in which only one part is inexact, and of all parts together (x "
        "axis, steps of 1/255, logarithmic); one bar per view, in the colours of the legend.",
        f"Bars of parts for {count_of(rows)}, logarithmic.",
        AROUND + BAR * count, lambda figure: draw_budget(figure, rows),
    )  # fmt: skip


BUDGET = (parts, bars)
