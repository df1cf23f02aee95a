"""A report's tables, figures and texts, as an HTML page and a JSON object."""

from collections.abc import Callable
from dataclasses import dataclass, field

from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure as Canvas

from splatcore.sim.common.plot import plot
from splatcore.sim.common.table import Table

TEMPLATE = "report.html.jinja"

LONG_TABLE = 28  # rows from which a table may break across printed pages

QUESTIONS = ("How fast", "How exact", "How large", "Gain of each idea")
"""Headings of the summary at the top of the page."""

MILLI, THOUSAND, MILLION = 1e-3, 1e3, 1e6


@dataclass
class Figure:
    """A plot (SVG, inserted unchanged) or a picture (data URI). about: its text alternative."""

    key: str
    caption: str
    about: str
    svg: str = ""
    uri: str = ""
    commands: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)

    def facts(self) -> dict:
        """The figure as a JSON object."""
        return {"caption": self.caption, "commands": self.commands, "versions": self.versions}


def plotted(
    key: str, caption: str, about: str, height: float, draw: Callable[[Canvas], None]
) -> Figure:
    """A figure drawn by `draw` on a canvas of `height` inches."""
    return Figure(key, caption, about, plot(key, height, draw))


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
