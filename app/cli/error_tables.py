"""Tables of the command `error`."""

from collections.abc import Iterable
from operator import attrgetter

from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table, shown
from splatcore.spec.config import DEFAULT, Config

LABELS = {
    "depth_stage_0": "depth, stage 0",
    "u": "u, pixels",
    "v": "v, pixels",
    "colour": "colour, of full scale",
}
"""Names of fields in the tables, if they differ. A field without a unit is relative."""

COUNT_TITLE = (
    "Visible Gaussians lost + splats that are not finite.\n"
    "axes: longest over shortest axis of a visible Gaussian; on screen: of a splat, with blur"
)

COUNTS = {
    "projected": "projected",
    "lost": "lost: visible, not projected",
    "gained": "gained: projected, not visible",
    "not_finite": "with a field that is not finite",
    "not_positive": "not positive definite",
}
"""Counts per machine and their names in the table."""


def decibels(result: dict, key: str = "psnr_db_machine") -> str:
    """Return a picture's PSNR as text."""
    return shown(result[key], ".1f", none="exact")


def print_tables(results: dict[str, dict], largest: dict[str, dict], machines: tuple[Config, ...]):
    """Print all tables: pictures and counts by scene, errors by field."""
    from splatcore.study.accuracy.points import heading

    headings = [*map(heading, machines)]
    title = "PSNR of the pictures, dB, machine: against the reference on the same packed model"
    tables = {title: picture_table(results, machines, headings)}
    for kind, name in (("scenes", "scenes"), ("hard", "hard cases")):
        if kind in largest:
            title = f"Errors over the {name}: largest RMS, maximum; relative unless in a unit"
            tables[title] = field_table(largest[kind], machines, headings)
    tables[COUNT_TITLE] = count_table(results, machines, headings)
    tables["All together"] = total_table(results, machines, headings)
    for title, table in tables.items():
        console.print(f"\n{title}")
        table.print()


def with_machines(columns: Iterable[Column], headings: list[str], rows: list[list]) -> Table:
    """A table with columns, then one column per machine."""
    machines = (Column(heading, digits=0) for heading in headings)
    return Table("error", "", [*columns, *machines], rows)


def picture_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Return a table of PSNR by scene; with packing if models differ from DEFAULT's."""
    packing = attrgetter("position", "colour_index", "sh_index")
    other = [config.name for config in machines if packing(config) != packing(DEFAULT)]
    headings = [*headings, *(f"{name} and\npacking" for name in other)]
    rows = []
    for name, facts in results.items():
        cells = [decibels(result) for result in facts["machines"].values()]
        cells += [decibels(facts["machines"][name], "psnr_db_default_model") for name in other]
        rows.append([name, *cells])
    return with_machines([Column("scene")], headings, rows)


def field_table(
    largest: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Return a table of errors by field and machine."""
    rows = []
    for field in next(iter(largest.values())):
        name = LABELS.get(field, field.replace("_", " "))
        for key, text in (("rms", name), ("max", "  largest")):
            sizes = [largest[config.name][field][key] for config in machines]
            rows.append([text, *(shown(size, ".1e") for size in sizes)])
    return with_machines([Column("field")], headings, rows)


def count_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Return a table of visible Gaussians, their axis ratios, and those lost by each machine."""
    columns = [
        Column("scene"), Column("visible", digits=0), Column("axes", digits=0, none="∞"),
        Column("on screen", digits=0),
    ]  # fmt: skip
    rows = []
    for name, facts in results.items():
        rows.append([name, facts["visible"], facts["axis_ratio"], facts["screen_ratio"]])
        for result in facts["machines"].values():
            lost, broken = result["lost"], result["not_finite"]
            rows[-1].append(f"{lost}+{broken}" if lost or broken else "–")
    return with_machines(columns, headings, rows)


def total_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Return a table of counts over all scenes by machine."""
    rows = [
        [name, *(sum(f["machines"][c.name][key] for f in results.values()) for c in machines)]
        for key, name in COUNTS.items()
    ]
    return with_machines([Column("Gaussians")], headings, rows)
