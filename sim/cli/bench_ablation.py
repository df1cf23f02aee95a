"""The command `bench ablation`: the gain of culling, zero skipping and early termination."""

from typing import Annotated

import typer

from splatcore.sim.bench import ablation as ablation_campaign
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
from splatcore.sim.cli.options import PresetOption
from splatcore.sim.common.table import new_table, print_whole
from splatcore.spec.preset import find_preset


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
    """Gain of culling, zero skipping and early termination, one after the other.

    Each step is a machine of its own, with the features that are off left out of it. Cycles are the
    cycle model's; pictures and counts the golden model's. Writes DIR/ablation.json.
    """
    config, found = find_preset(preset), look(output, scene, cameras, size)
    simulated = [view_of(text, found[0].size) for text in rtl or ()]
    facts = ablation_campaign.ablation(config, found, output, scheduler, simulated)
    names = [step["name"] for step in facts["steps"]]
    table = new_table("view", names, "frames a second at 800 MHz")
    cells: dict[str, list[str]] = {}
    for row in facts["rows"]:
        title = f"{row['scene']} {row['camera']}"
        simulated = f" ({row['rtl_cycles'] / 1000:,.0f} k in RTL)" if row["rtl_cycles"] else ""
        cells.setdefault(title, []).append(f"{row['fps_at_800mhz']:.1f}{simulated}")
    for title, values in cells.items():
        table.add_row(title, *values)
    table.add_row("the paper", *(str(step["paper_fps"] or "–") for step in facts["steps"]))
    print_whole(table)
    finish(output / ablation_campaign.RESULT, facts)
