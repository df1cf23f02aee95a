"""Tables: on the terminal, in Markdown, and as CSV."""

import csv
import io
from collections.abc import Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from splatcore.sim.common.output import console

WIDEST = 1000  # characters, more than any table needs


def new_table(
    first: str, headings: Iterable[str], title: str | None = None, texts: Iterable[str] = ()
) -> Table:
    """Return a table with one column of names, then columns of numbers, then columns of text.

    first: heading of the names
    headings: of the numbers
    texts: headings of the texts
    """
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    table.add_column(first, no_wrap=True)
    for text in headings:
        table.add_column(text, justify="right", no_wrap=True)
    for text in texts:
        table.add_column(text)
    return table


def shown(value: float | None, form: str, scale: float = 1, none: str = "–") -> str:
    """Format a number divided by `scale`; return `none` for None."""
    return none if value is None else format(value / scale, form)


def print_whole(table: Table):
    """Print a table at its full width, on any terminal."""
    room = Measurement.get(console, console.options.update(max_width=WIDEST), table).maximum
    Console(width=room).print(table)


def in_markdown(titles: Sequence[str], rows: Sequence[dict]) -> str:
    """Return a table in Markdown: one title per row, headings from the keys."""
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
    """Return rows as CSV, one column per key that occurs; empty if missing or None."""
    text, names = io.StringIO(), dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
