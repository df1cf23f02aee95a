"""Composition of a report from sections. A missing result affects only its own section."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from splatcore.sim.common.output import write
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
from splatcore.study.report.page import Item, Part, facts, html
from splatcore.study.report.results import Results
from splatcore.study.report.titles import SECTIONS

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
"""Blocks of each section, in order."""


def compose(name: str, results: Results) -> Part:
    """Compose a section; the error of a failed block becomes a problem of the section."""
    part = Part(name, *SECTIONS[name])
    for block in BLOCKS[name]:
        results.used.clear()
        try:
            part.items += list(block(results))
        except InputError as error:
            part.problems.append(str(error))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            names = ", ".join(dict.fromkeys(results.used)) or "results"
            kind = type(error).__name__
            part.problems.append(f"{names}: invalid content ({kind}: {error})")
        part.problems += results.troubles
        results.troubles.clear()
    part.problems = list(dict.fromkeys(part.problems))
    for card in part.shown("card"):
        card.section = name
    for item in (*part.shown("table"), *part.shown("figure")):
        item.commands += [results.command(source) for source in dict.fromkeys(item.sources)]
        versions = map(results.version, dict.fromkeys(item.sources))
        item.versions = list(dict.fromkeys(filter(None, versions)))
        item.commands = item.commands or [f"splatcore report --section {name} -o DIR"]
    return part


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
