"""The report's section on published accelerators, with this machine in the first row."""

from collections.abc import Iterator

from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.error import InputError
from splatcore.study.report.page import THOUSAND, Item
from splatcore.study.report.published_figures import PUBLISHED
from splatcore.study.report.quality import PACKINGS, fps
from splatcore.study.report.results import Results

OPEN = "open"  # a value that the source does not have


def own(results: Results) -> list:
    """This machine's row; a missing result leaves its cell open and is added to the troubles."""
    gates = memory = speed = size = None
    for facts in results.each(("synth",)):
        gates = facts["top"]["nand2"] / THOUSAND
    for facts in results.each(("memories",)):
        memory = facts["kilobytes"]
    try:
        facts, rows = results.rows("quality")
        found = [fps(row) for row in rows if row["asked"] == PACKINGS[0]]
        size = facts["size"].replace("x", "×")
        speed = f"{min(found):.0f} to {max(found):,.0f} (views of this report, cycle model)"
    except (InputError, ValueError) as error:
        results.troubles.append(str(error))
    return [
        "Splatcore", "Verilog, synthesis to NAND2", "–", CLOCK_HZ / 1e6, gates, memory, None, None,
        size, speed, "this report",
    ]  # fmt: skip


def published(results: Results) -> Iterator[Item]:
    """Table of this machine and all published ones."""
    yield Table(
        "published",
        "Published accelerators with their authors' figures and their sources; open: not stated in "
        "the source. Frame rates are for different scenes, models and resolutions, so they do not "
        "show which machine is better. The same frames on two machines: docs/performance.md.",
        [
            Column("machine"), Column("kind"), Column("process", none=OPEN),
            Column("clock", "MHz", 0, OPEN), Column("gates", "k NAND2", 1, OPEN),
            Column("memory", "KB", 1, OPEN), Column("area", "mm²", 2, OPEN),
            Column("power", "W", 3, OPEN), Column("resolution", none=OPEN),
            Column("FPS", none=OPEN), Column("source", wide=True),
        ],
        [own(results), *map(list, PUBLISHED)],
        frozenset({0}),
    )  # fmt: skip


PUBLISHED_SECTION = (published,)
