"""The tables of keys in docs/json.md, written from the fields of results: `make commands`.

A table stands between the lines `<!-- keys of MODULE.CLASS -->` and `<!-- end -->`.
"""

import re
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from itertools import groupby
from pathlib import Path

from splatcore.study.results.fields import about, items_of, kind

BEGIN, END = "<!-- keys of {} -->", "<!-- end -->"

BLOCK = re.compile(r"<!-- keys of (\w+)\.(\w+) -->\n.*?<!-- end -->", re.S)


def documented(schema: type, depth: int = 0) -> Iterator[tuple[int, str, str]]:
    """Yield a result's keys: depth in objects, key, meaning; inner ones after their object."""
    inner = []
    for each in fields(schema):
        yield depth, each.name, about(each).meaning
        inside = items_of(each.type) or kind(each)
        if is_dataclass(inside):
            inner += documented(inside, depth + 1)
            yield from inner
            inner = []


def table(schema: type) -> str:
    """A result's keys in Markdown; neighbours of one meaning share a line."""
    lines = ["| key | meaning |", "|---|---|"]
    for (depth, meaning), some in groupby(documented(schema), lambda row: (row[0], row[2])):
        keys = ", ".join(f"`{key}`" for _, key, _ in some)
        lines.append(f"| {'… ' * depth}{keys} | {meaning} |")
    return "\n".join(lines)


def written(page: str) -> str:
    """The page with the tables of today's fields."""

    def block(found: re.Match) -> str:
        module, name = found.groups()
        schema = getattr(import_module(f"splatcore.study.results.{module}"), name)
        return f"{BEGIN.format(f'{module}.{name}')}\n\n{table(schema)}\n\n{END}"

    return BLOCK.sub(block, page)


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(written(path.read_text()))
