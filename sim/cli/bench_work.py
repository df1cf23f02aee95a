"""The command `bench work`: work that scenes give the machine, by every camera."""

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
from splatcore.sim.common.table import new_table, print_whole
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
    """Work of scenes for the machine by every camera: culling, early termination, busy PEs, tiles.

    Writes DIR/work.json, with how many splats reach each tile.
    """
    config, found = find_preset(preset), look(output, scene, cameras, size)
    if cameras is None:
        found = work_campaign.every_camera(found)
    facts = work_campaign.work(config, found, output, scheduler)
    headings = ("behind", "culled", "pairs ended early", "PEs busy", "pairs")
    table = new_table("view", headings, "percent")
    for row in facts["rows"]:
        names = ("near_rate", "culling_rate", "early_termination_rate", "pe_utilisation")
        rates = [f"{100 * row[name]:.1f}" for name in names]
        table.add_row(f"{row['scene']} {row['camera']}", *rates, f"{row['tile_pairs']:,}")
    print_whole(table)
    finish(output / work_campaign.RESULT, facts)
