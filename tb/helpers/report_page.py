"""Access to the report's page and its other files in tests."""

import json
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

from tb.helpers.command import run

VOID = {"meta", "img", "br", "link", "hr", "input"}


@dataclass
class Figure:
    """Tags within a figure of the page, and its command."""

    tags: set[str] = field(default_factory=set)
    command: str = ""


class Page(HTMLParser):
    """Parts of a page; raises AssertionError for tags that do not match."""

    def __init__(self, text: str):
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.figures: list[Figure] = []
        self.sections: dict[str, str] = {}
        self.images: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.handle_startendtag(tag, attributes)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        attributes = dict(attributes)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        self.links += [attributes[k] for k in ("href", "xlink:href", "src") if k in attributes]
        if tag == "img":
            self.images.append(attributes["src"])
        if tag == "section" and "id" in attributes:
            self.sections[attributes["id"]] = ""
        if tag == "figure":
            self.figures.append(Figure())
        if "figure" in self.open:
            self.figures[-1].tags.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "section" in self.open and self.sections:
            self.sections[list(self.sections)[-1]] += data
        if "figcaption" in self.open and "code" in self.open:
            self.figures[-1].command += data


@dataclass
class Report:
    """Output folder of the command, its exit status and messages."""

    folder: Path
    status: int
    messages: str

    @property
    def text(self) -> str:
        return (self.folder / "report.html").read_text()

    @property
    def sections(self) -> dict:
        return json.loads((self.folder / "report.json").read_text())["sections"]

    def table(self, section: str, key: str) -> list[dict]:
        """Rows of a table, by heading."""
        found = self.sections[section]["tables"][key]
        return [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]


def report(folder: Path, capsys, *arguments: str) -> Report:
    """Run the command on the results in a folder."""
    out = folder / "out"
    words = ["report", "-o", str(out), "--results", str(folder / "results"), *arguments]
    status = run(*words)
    return Report(out, status, capsys.readouterr().err)
