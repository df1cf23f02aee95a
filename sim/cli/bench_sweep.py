"""The command `bench sweep`: speed against error and gates, over machines and scenes."""

from typing import Annotated

import typer
from rich.table import Table

from splatcore.sim.bench import sweep_campaign
from splatcore.sim.bench.sweep_points import Point, points
from splatcore.sim.cli.bench import (
    SIZE,
    CamerasOption,
    FolderOption,
    PixelsOption,
    ScenesArgument,
    SchedulerOption,
    bench,
    finish,
    look,
    view_of,
)
from splatcore.sim.common.output import console
from splatcore.sim.common.table import new_table, print_whole
from splatcore.spec.error import InputError


@bench.command("sweep")
def sweep_command(
    output: FolderOption,
    scene: ScenesArgument = None,
    cameras: CamerasOption = None,
    size: PixelsOption = SIZE,
    only: Annotated[
        list[str] | None,
        typer.Option("--point", metavar="NAME", help="Only these machines; see --list."),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Print the machines and end.")] = False,
    confirm: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE[:ID]", help="Simulate the machines of the front on this view in RTL."
        ),
    ] = None,
    scheduler: SchedulerOption = None,
):
    """Speed against error and gates: many machines, many scenes, by golden and cycle model.

    Writes DIR/sweep.json: cycles, PSNR and largest error of each machine on each view, gates and
    memories of each, and which of them no other one beats in cycles, gates and PSNR together.
    Gates are those of the parts that differ, synthesised, and of DEFAULT for the rest.
    """
    chosen = some(list(points()), only)
    if listed:
        for point in chosen:
            console.print(f"{point.name:22} {point.fields}", markup=False, soft_wrap=True)
        return
    found = look(output, scene, cameras, size)
    facts = sweep_campaign.sweep(chosen, found, output, scheduler)
    if confirm:
        sweep_campaign.confirm(chosen, facts, view_of(confirm, found[0].size), output)
    print_whole(table_of(facts))
    finish(output / sweep_campaign.RESULT, facts)


def some(all_points: list[Point], names: list[str] | None) -> list[Point]:
    """The points of these names; InputError tells which there are."""
    by_name = {point.name: point for point in all_points}
    if unknown := [name for name in names or () if name not in by_name]:
        raise InputError(f"--point '{unknown[0]}': unknown (there are {', '.join(by_name)})")
    return [by_name[name] for name in names] if names else all_points


def table_of(facts: dict) -> Table:
    """The points of a sweep."""
    headings = "k cycles|FPS|dB least|dB mean|max error|k gates|KB|front".split("|")
    table = new_table("machine", headings, "slowest and worst view of each")

    def cell(facts: dict, name: str, form: str, scale: float = 1) -> str:
        value = facts.get(name)
        return "–" if value is None else format(value / scale, form)

    for name, found in facts["points"].items():
        table.add_row(
            name,
            cell(found, "frame_cycles_max", ",.0f", 1000), cell(found, "fps_min", ".1f"),
            cell(found, "psnr_db_min", ".1f"), cell(found, "psnr_db_mean", ".1f"),
            cell(found, "max_error_max", ".3f"), cell(found, "nand2", ",.0f", 1000),
            cell(found, "memory_kb", ".1f"), "*" if found["front"] else "",
        )  # fmt: skip
    return table
