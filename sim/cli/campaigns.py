"""The commands `bench sweep`, `bench ablation` and `bench work`: campaigns over scenes."""

from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.bench import ablation as ablation_campaign
from splatcore.sim.bench import sweep_campaign
from splatcore.sim.bench import workload as work_campaign
from splatcore.sim.bench.scenes import View, views
from splatcore.sim.bench.sweep_points import Point, points
from splatcore.sim.cli.bench import bench
from splatcore.sim.cli.options import PresetOption
from splatcore.sim.common.output import check_writable, console, messages
from splatcore.sim.common.result import write_json
from splatcore.sim.common.source import VIEW_SIZE, parse_size
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

FolderOption = Annotated[
    Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for results; kept results stay.")
]
ScenesArgument = Annotated[
    list[str] | None,
    typer.Argument(metavar="SCENE …", help="Default: all in the folder SPLATCORE_SCENES."),
]
CamerasOption = Annotated[
    str | None, typer.Option(metavar="ID,ID,…", help="Default: each scene's first, and more.")
]
PixelsOption = Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A Dask scheduler, like tcp://host:8786, whose workers do the work; they read the "
        "scene files at the same paths. Default: processes here, one for each core.",
    ),
]
SIZE = "x".join(map(str, VIEW_SIZE))


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
    """Speed against error and gates: many machines on many scenes, by twins and cycle model.

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
    console.print(table_of(facts))
    finish(output / sweep_campaign.RESULT, facts)


@bench.command("ablation")
def ablation_command(
    output: FolderOption,
    scene: ScenesArgument = None,
    cameras: CamerasOption = None,
    size: PixelsOption = SIZE,
    rtl: Annotated[
        list[str] | None,
        typer.Option("--rtl", metavar="SCENE[:ID]", help="Simulate all steps on this view in RTL."),
    ] = None,
    preset: PresetOption = "DEFAULT",
    scheduler: SchedulerOption = None,
):
    """What culling, zero skipping and early termination buy, one after the other.

    Each step is a machine of its own, with the features that are off left out of it. Cycles are the
    cycle model's; pictures and counts the twins'. Writes DIR/ablation.json.
    """
    config, found = find_preset(preset), look(output, scene, cameras, size)
    simulated = [view_of(text, found[0].size) for text in rtl or ()]
    facts = ablation_campaign.ablation(config, found, output, scheduler, simulated)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title="frames a second at 800 MHz")
    table.add_column("view", no_wrap=True)
    for step in facts["steps"]:
        table.add_column(step["name"], justify="right")
    cells: dict[str, list[str]] = {}
    for row in facts["rows"]:
        title = f"{row['scene']} {row['camera']}"
        simulated = f" ({row['rtl_cycles'] / 1000:,.0f} k in RTL)" if row["rtl_cycles"] else ""
        cells.setdefault(title, []).append(f"{row['fps_at_800mhz']:.1f}{simulated}")
    for title, values in cells.items():
        table.add_row(title, *values)
    table.add_row("the paper", *(str(step["paper_fps"] or "–") for step in facts["steps"]))
    console.print(table)
    finish(output / ablation_campaign.RESULT, facts)


@bench.command("work")
def work_command(
    output: FolderOption,
    scene: ScenesArgument = None,
    cameras: CamerasOption = None,
    size: PixelsOption = SIZE,
    preset: PresetOption = "DEFAULT",
    scheduler: SchedulerOption = None,
):
    """What scenes ask of the machine by every camera: culling, early termination, busy PEs, tiles.

    Writes DIR/work.json, with how many splats reach each tile.
    """
    config, found = find_preset(preset), look(output, scene, cameras, size)
    if cameras is None:
        found = work_campaign.every_camera(found)
    facts = work_campaign.work(config, found, output, scheduler)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title="percent")
    table.add_column("view", no_wrap=True)
    for heading in ("behind", "culled", "pairs ended early", "PEs busy", "pairs"):
        table.add_column(heading, justify="right")
    for row in facts["rows"]:
        names = ("near_rate", "culling_rate", "early_termination_rate", "pe_utilisation")
        rates = [f"{100 * row[name]:.1f}" for name in names]
        table.add_row(f"{row['scene']} {row['camera']}", *rates, f"{row['tile_pairs']:,}")
    console.print(table)
    finish(output / work_campaign.RESULT, facts)


def look(output: Path, scene: list[str] | None, cameras: str | None, size: str) -> list[View]:
    """The views to measure; makes the folder."""
    size = "x".join(map(str, parse_size(size)))
    found = views(list(scene or ()), cameras, size)
    check_writable(output / "x" if output.is_dir() else output)
    output.mkdir(exist_ok=True)
    return found


def view_of(text: str, size: str) -> View:
    """The view of SCENE[:ID]."""
    scene, _, camera = text.partition(":")
    return View(scene, camera, size)


def some(all_points: list[Point], names: list[str] | None) -> list[Point]:
    """The points of these names; InputError tells which there are."""
    by_name = {point.name: point for point in all_points}
    if unknown := [name for name in names or () if name not in by_name]:
        raise InputError(f"--point '{unknown[0]}': unknown (there are {', '.join(by_name)})")
    return [by_name[name] for name in names] if names else all_points


def table_of(facts: dict) -> Table:
    """The points of a sweep."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title="slowest and worst view of each")
    table.add_column("machine", no_wrap=True)
    for heading in (
        "k cycles",
        "FPS",
        "dB least",
        "dB mean",
        "max error",
        "k gates",
        "KB",
        "front",
    ):
        table.add_column(heading, justify="right")

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


def finish(path: Path, facts: dict):
    """Write the result; what failed is listed again, and is an exit status of 1."""
    write_json(path, facts)
    console.print(str(path), soft_wrap=True)
    if facts["failed"]:
        for failure in facts["failed"]:
            messages.print(f"missing: {failure['what']}: {failure['why']}", markup=False)
        raise typer.Exit(1)
