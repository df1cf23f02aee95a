"""Tables on the terminal, names on the left, numbers on the right; in Markdown and as CSV."""

import csv
import io
from collections.abc import Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from splatcore.sim.common.output import console

WIDEST = 1000  # more columns than a table has


def new_table(
    first: str, headings: Iterable[str], title: str | None = None, texts: Iterable[str] = ()
) -> Table:
    """A table of a column of names, columns of numbers and, behind them, columns of text."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    table.add_column(first, no_wrap=True)
    for text in headings:
        table.add_column(text, justify="right", no_wrap=True)
    for text in texts:
        table.add_column(text)
    return table


def shown(value: float | None, form: str, scale: float = 1, none: str = "–") -> str:
    """A number in a table, divided by `scale`; `none` where there is none."""
    return none if value is None else format(value / scale, form)


def print_whole(table: Table):
    """Print a table as wide as it is, on any terminal."""
    room = Measurement.get(console, console.options.update(max_width=WIDEST), table).maximum
    Console(width=room).print(table)


def in_markdown(titles: Sequence[str], rows: Sequence[dict]) -> str:
    """A table in Markdown: a title in front of each row, whose keys are the headings."""
    if not rows:
        return "none"
    names = list(rows[0])
    lines = ["| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    lines += [
        f"| {title} | " + " | ".join(str(row[name]) for name in names) + " |"
        for title, row in zip(titles, rows, strict=True)
    ]
    return "\n".join(lines)


def comma_separated(rows: Sequence[dict]) -> str:
    """Rows as CSV: a column for each key that occurs, empty where a row lacks it or has None."""
    text, names = io.StringIO(), dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
