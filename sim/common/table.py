"""Tables: on the terminal, in Markdown, as CSV, and in the report's page and JSON file."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable

from splatcore.sim.common.output import console

WIDEST = 1000  # characters, more than any table needs

NONE = "–"  # in place of a missing number


@dataclass(frozen=True)
class Column:
    """A table's column.

    digits: decimals; None for text
    none: text of a missing value
    wide: for long texts
    get: dotted key of the value in a row, or a function of the row; the column's name if empty
    per: the value is divided by this
    maybe: the row may lack the key, which is shown as None, or `NONE` where None has another text
    """

    name: str
    unit: str = ""
    digits: int | None = None
    none: str = NONE
    wide: bool = False
    get: str | Callable[[dict], object] = ""
    per: float = 1
    maybe: bool = True

    @property
    def heading(self) -> str:
        """Name and unit, for the terminal, JSON and CSV."""
        return f"{self.name}, {self.unit}" if self.unit else self.name

    @property
    def style(self) -> str:
        """CSS class of its cells; numbers are right-aligned."""
        return "right" if self.digits is not None else "wide" if self.wide else "left"

    def called(self, name: str, **changes) -> "Column":
        """The column with another name, and maybe unit, digits and so on."""
        return replace(self, name=name, **changes)

    def value(self, row: object) -> object:
        """Its value in a row, an object or its dict, in the column's unit."""
        if callable(self.get):
            found = self.get(row)
        else:
            found = row if isinstance(row, dict) else vars(row)
            for key in (self.get or self.name).split("."):
                if self.maybe and (not isinstance(found, dict) or key not in found):
                    return None if self.none == NONE else NONE
                found = found[key]
        scaled = self.per != 1 and isinstance(found, int | float)
        return found / self.per if scaled else found

    def cell(self, value: object) -> str:
        """A value as text."""
        if value is None:
            return self.none
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, int | float) and self.digits is not None:
            return f"{value:,.{self.digits}f}".replace("-", "−")
        return str(value)


@dataclass
class Table:
    """A table; each row has as many values as columns.

    key: name of its CSV file
    strong: numbers of highlighted rows, as sums
    commands, versions: that produced the results that it shows
    """

    key: str
    caption: str
    columns: Sequence[Column]
    rows: list[Sequence[object]]
    strong: frozenset[int] = frozenset()
    commands: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)

    @classmethod
    def of(
        cls, key: str, caption: str, columns: Sequence[Column], rows: Iterable[object], *more
    ) -> "Table":
        """A table of objects, one per row, from which each column takes its value."""
        values = [[column.value(row) for column in columns] for row in rows]
        return cls(key, caption, columns, values, *more)

    def cells(self) -> list[list[str]]:
        """All cells as text."""
        return [
            [column.cell(value) for column, value in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]

    def facts(self) -> dict:
        """The table as a JSON object."""
        about = {"caption": self.caption, "commands": self.commands, "versions": self.versions}
        headings = [column.heading for column in self.columns]
        return about | {"columns": headings, "rows": list(map(list, self.rows))}

    def comma_separated(self) -> str:
        """The table as CSV, with the values of the JSON file; missing values are empty."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(column.heading for column in self.columns)
        writer.writerows(self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """The table in Markdown, below its caption."""
        lines = ["| " + " | ".join(column.heading for column in self.columns) + " |"]
        lines += ["|---" * len(self.columns) + "|"]
        lines += [f"| {' | '.join(row)} |" for row in self.cells()]
        return f"{self.caption}\n\n" + ("\n".join(lines) if self.rows else "none")

    def print(self):
        """Print the table at its full width, on any terminal; highlighted rows are bold, below a
        line."""
        headed = any(column.heading for column in self.columns)
        drawn = RichTable(
            box=box.SIMPLE_HEAD if headed else None, padding=(0, 1, 0, 0), pad_edge=headed,
            show_header=headed, title=self.caption or None,
        )  # fmt: skip
        for number, column in enumerate(self.columns):
            right = column.digits is not None
            drawn.add_column(
                column.heading, justify="right" if right else "left", no_wrap=right or not number
            )
        for number, row in enumerate(self.cells()):
            strong = number in self.strong
            drawn.add_row(*row, style="bold" if strong else "")
            drawn.rows[-1].end_section = not strong and number + 1 in self.strong
        room = console.options.update(max_width=WIDEST)
        width = Measurement.get(console, room, drawn).maximum
        Console(width=width, highlight=False, markup=False).print(drawn)


def shown(value: float | None, form: str, scale: float = 1, none: str = NONE) -> str:
    """Format a number divided by `scale`; return `none` for None."""
    return none if value is None else format(value / scale, form)


def comma_separated(rows: Sequence[dict]) -> str:
    """Return rows as CSV, one column per key that occurs; empty if missing or None."""
    text, names = io.StringIO(), dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
