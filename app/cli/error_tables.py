"""Tables of the command `error`."""

from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from splatcore.sim.common.output import console
from splatcore.sim.common.table import NONE, Column, Table, shown
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


SCENES = (
    Column("scene"),
    Column("visible", digits=0),
    Column("axes", digits=0, none="∞"),
    Column("on screen", digits=0),
)
"""Columns of the counts by scene."""


def decibels(result: dict, key: str = "psnr_db_machine") -> str:
    """Return a picture's PSNR as text."""
    return shown(result[key], ".1f", none="exact")


def print_tables(results: dict[str, dict], largest: dict[str, dict], machines: tuple[Config, ...]):
    """Print all tables: pictures and counts by scene, errors by field; one column per machine."""
    from splatcore.study.accuracy.points import heading

    packing = attrgetter("position", "colour_index", "sh_index")
    names, headings = [config.name for config in machines], [*map(heading, machines)]
    other = [config.name for config in machines if packing(config) != packing(DEFAULT)]
    with_packing = [*headings, *(f"{name} and\npacking" for name in other)]
    title = "PSNR of the pictures, dB, machine: against the reference on the same packed model"
    show(title, [Column("scene")], with_packing, pictures(results, other))
    for kind, name in (("scenes", "scenes"), ("hard", "hard cases")):
        if kind in largest:
            title = f"Errors over the {name}: largest RMS, maximum; relative unless in a unit"
            show(title, [Column("field")], headings, fields(largest[kind], names))
    show(COUNT_TITLE, SCENES, headings, counts(results))
    show("All together", [Column("Gaussians")], headings, totals(results, names))


def show(title: str, columns: Sequence[Column], headings: list[str], rows: Iterable[list]):
    """Print a table of some columns and one with each of the headings."""
    console.print(f"\n{title}")
    more = (Column(heading, digits=0) for heading in headings)
    Table("error", "", [*columns, *more], list(rows)).print()


def pictures(results: dict[str, dict], other: list[str]) -> Iterator[list]:
    """Yield PSNR by scene. other: machines that pack models unlike DEFAULT"""
    for scene, facts in results.items():
        cells = [decibels(result) for result in facts["machines"].values()]
        cells += [decibels(facts["machines"][name], "psnr_db_default_model") for name in other]
        yield [scene, *cells]


def fields(largest: dict[str, dict], names: list[str]) -> Iterator[list]:
    """Yield errors by field."""
    for field in next(iter(largest.values())):
        label = LABELS.get(field, field.replace("_", " "))
        for key, text in (("rms", label), ("max", "  largest")):
            yield [text, *(shown(largest[name][field][key], ".1e") for name in names)]


def counts(results: dict[str, dict]) -> Iterator[list]:
    """Yield visible Gaussians, their axis ratios, and those lost by each machine."""
    for scene, facts in results.items():
        found = ((each["lost"], each["not_finite"]) for each in facts["machines"].values())
        cells = (f"{lost}+{broken}" if lost or broken else NONE for lost, broken in found)
        yield [scene, facts["visible"], facts["axis_ratio"], facts["screen_ratio"], *cells]


def totals(results: dict[str, dict], names: list[str]) -> Iterator[list]:
    """Yield counts over all scenes."""
    for key, label in COUNTS.items():
        yield [label, *(sum(f["machines"][n][key] for f in results.values()) for n in names)]
