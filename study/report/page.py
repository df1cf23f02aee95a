"""A report's tables, figures and texts, as an HTML page, a JSON object and CSV tables."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure as Canvas

from splatcore.sim.common.plot import plot

TEMPLATE = "report.html.jinja"

NONE = "–"  # in place of a missing number
LONG_TABLE = 28  # rows from which a table may break across printed pages

QUESTIONS = ("How fast", "How exact", "How large", "Gain of each idea")
"""Headings of the summary at the top of the page."""

MILLI, THOUSAND, MILLION = 1e-3, 1e3, 1e6


@dataclass(frozen=True)
class Column:
    """A table's column.

    digits: decimals; None for text
    none: text of a missing value
    wide: for long texts
    """

    name: str
    unit: str = ""
    digits: int | None = None
    none: str = NONE
    wide: bool = False

    @property
    def heading(self) -> str:
        """Name and unit, for JSON and CSV."""
        return f"{self.name}, {self.unit}" if self.unit else self.name

    @property
    def style(self) -> str:
        """CSS class of its cells; numbers are right-aligned."""
        return "right" if self.digits is not None else "wide" if self.wide else "left"

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
    sources: names of the results that it shows
    strong: numbers of highlighted rows
    commands, versions: that produced these results
    """

    key: str
    caption: str
    columns: Sequence[Column]
    rows: list[Sequence[object]]
    sources: Sequence[str] = ()
    strong: frozenset[int] = frozenset()
    commands: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)

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


@dataclass
class Figure:
    """A plot (SVG, inserted unchanged) or a picture (data URI). about: its text alternative."""

    key: str
    caption: str
    about: str
    svg: str = ""
    uri: str = ""
    sources: Sequence[str] = ()
    commands: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)

    def facts(self) -> dict:
        """The figure as a JSON object."""
        return {"caption": self.caption, "commands": self.commands, "versions": self.versions}


def plotted(
    key: str, caption: str, about: str, height: float, draw: Callable[[Canvas], None], source: str
) -> Figure:
    """A figure drawn by `draw` on a canvas of `height` inches, from one result (`source`)."""
    return Figure(key, caption, about, plot(key, height, draw), sources=(source,))


@dataclass
class Text:
    """A paragraph."""

    text: str


@dataclass
class Card:
    """A number in the summary, below one of `QUESTIONS`. section: name of its section."""

    question: str
    value: str
    about: str
    section: str = ""


Item = Table | Figure | Text | Card


@dataclass
class Part:
    """A section of the page. problems: lines about missing results."""

    name: str
    title: str
    about: str
    items: list[Item] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def shown(self, kind: str) -> list[Item]:
        """Its items of one kind: table, figure, text or card."""
        return [item for item in self.items if kind_of(item) == kind]


def kind_of(item: Item) -> str:
    """An item's kind: table, figure, text or card."""
    return type(item).__name__.lower()


def html(parts: list[Part]) -> str:
    """The whole page as HTML."""
    loader = PackageLoader("splatcore.study.report", package_path="")
    environment = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.tests["kind"] = lambda item, kind: kind_of(item) == kind
    cards = [card for part in parts for card in part.shown("card")]
    asked = {q: [card for card in cards if card.question == q] for q in QUESTIONS}
    return environment.get_template(TEMPLATE).render(
        parts=parts,
        questions={question: found for question, found in asked.items() if found},
        numbers=numbers(parts),
        long_table=LONG_TABLE,
        problems=[(part, text) for part in parts for text in part.problems],
    )


def numbers(parts: list[Part]) -> dict[str, str]:
    """Names of tables and figures ("Table 1", …) by key, numbered through the page."""
    found = {}
    for kind in ("table", "figure"):
        items = [item for part in parts for item in part.shown(kind)]
        for number, item in enumerate(items, 1):
            if item.key in found:
                raise ValueError(f"two items of a report are called {item.key}")
            found[item.key] = f"{kind.capitalize()} {number}"
    return found


def facts(parts: list[Part]) -> dict:
    """The whole report as a JSON object."""
    return {
        "sections": {
            part.name: {
                "title": part.title,
                "summary": [vars(card) for card in part.shown("card")],
                "tables": {table.key: table.facts() for table in part.shown("table")},
                "figures": {figure.key: figure.facts() for figure in part.shown("figure")},
                "problems": part.problems,
            }
            for part in parts
        }
    }
