"""Composition of a report from sections. A missing result affects only its own section."""

import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError
from splatcore.study.report import (
    budget,
    campaigns,
    compression,
    other,
    paper_tables,
    published,
    quality,
    scenes,
    sweep,
)
from splatcore.study.report.kept import items
from splatcore.study.report.page import Card, Figure, Item, Part, facts, html
from splatcore.study.report.results import Results
from splatcore.study.report.titles import titles
from splatcore.study.results.fields import columns, sheets
from splatcore.study.results.known import RESULTS

Block = Callable[[Results], Iterable[Item]]  # part of a section that succeeds or fails as a whole

BLOCKS: dict[str, tuple[Block, ...]] = {
    "scenes": scenes.BLOCKS,
    "quality": quality.QUALITY,
    "budget": budget.BUDGET,
    "sweep": sweep.BLOCKS,
    "paper": paper_tables.BLOCKS,
    "published": published.PUBLISHED_SECTION,
    "ablation": campaigns.ABLATION,
    "compression": compression.COMPRESSION,
    "power": other.POWER,
    "hard": other.HARD,
    "fpga": other.FPGA,
    "fit": other.FIT,
}
"""Blocks of each section, in order; of a result's own section: its tables."""


def own_tables(name: str, results: Results) -> Iterator[Table]:
    """The kept tables of a result."""
    result, facts = RESULTS[name], results.facts(name)
    for sheet in sheets(result.schema):
        keys = [leaf.key for leaf in sheet.kept]
        outer = sheet.columns[: -len(keys)]
        shown = [*map(Column, outer), *columns(sheet.schema, " ".join(keys))]
        rows = [
            dict(zip(outer, own, strict=True)) | item for own, item in items(facts, sheet.place)
        ]
        yield Table.of(f"{name}{'-' * bool(sheet.end)}{sheet.end}", "", shown, rows)


def compose(name: str, results: Results) -> Part:
    """Compose a section; the error of a failed block becomes a problem of the section."""
    part = Part(name, *titles()[name])
    for block in BLOCKS.get(name) or (partial(own_tables, name),):
        results.used.clear()
        try:
            part.items += made_by(block, name, results)
        except InputError as error:
            part.problems.append(str(error))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            names = ", ".join(dict.fromkeys(results.used)) or "results"
            kind = type(error).__name__
            part.problems.append(f"{names}: invalid content ({kind}: {error})")
        part.problems += results.troubles
        results.troubles.clear()
    part.problems = list(dict.fromkeys(part.problems))
    return part


def made_by(block: Block, name: str, results: Results) -> list[Item]:
    """The items of a block, with the commands and versions that made the results which it read."""
    items, used = list(block(results)), dict.fromkeys(results.used)
    for item in items:
        if isinstance(item, Table | Figure):
            item.commands = item.commands or list(map(results.command, used))
            item.commands = item.commands or [f"splatcore report --section {name} -o DIR"]
            item.versions = list(dict.fromkeys(filter(None, map(results.version, used))))
        elif isinstance(item, Card):
            item.section = name
    return items


def write_report(folder: Path, parts: list[Part]) -> list[Path]:
    """Write the page, the JSON file and the tables; return their paths."""
    files = {
        folder / "report.html": html(parts),
        folder / "report.json": json.dumps(facts(parts), indent=1, ensure_ascii=False) + "\n",
    }
    place = folder / "tables"
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{place}: {error.strerror}") from None
    for table in (table for part in parts for table in part.shown("table")):
        files[place / f"{table.key}.csv"] = table.comma_separated()
    for path, text in files.items():
        write(path, text.encode())
    return list(files)
