"""The command `bench work`: work that scenes give the machine, by every camera."""

from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.bench import workload as work_campaign
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
)
from splatcore.sim.cli.options import PresetOption
from splatcore.sim.common.output import console
from splatcore.spec.preset import find_preset


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
