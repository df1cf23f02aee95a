"""The command `bench rule`: faintness rules, cycles against error."""

from splatcore.sim.cli import bench
from splatcore.sim.cli.options import (
    AntialiasedOption,
    AxesOption,
    NearOption,
    PresetOption,
    QualityOption,
)
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.table import new_table, print_whole
from splatcore.spec.preset import find_preset


@bench.bench.command("rule")
def rule_command(
    output: bench.FolderOption,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    near: NearOption = None,
    quality: QualityOption = "compact",
    preset: PresetOption = "DEFAULT",
    scheduler: bench.SchedulerOption = None,
):
    """Compare faintness rules: cycles of stage 3 against error.

    Under rule A, B, C, once T is below 2^-A, a splat that would take less than 2^-B of the light
    is skipped, and one that would leave less than 2^-C takes all of it. Tries A = 4, 5, 6, B = 9,
    11, 13, C = B − 2, 3DGS's own rule and some others, by golden and cycle model. dB and maximum
    error compare 8-bit pictures with the reference's of the same packed model under 3DGS's rule.
    Writes DIR/rule.json, rule.md and rule.csv.
    """
    from splatcore.sim.bench.rule import cells, measure_rules

    config = find_preset(preset)
    found = bench.look(
        output, scene, cameras, size, [config], quality, Reading(antialiased, axes, near)
    )
    facts = measure_rules(config, found, output, scheduler)
    rows = {name: cells(summary) for name, summary in facts["rules"].items()}
    if rows:
        table = new_table(
            "rule", next(iter(rows.values())), "means over views, against 3DGS's rule"
        )
        for name, row in rows.items():
            table.add_row(name, *row.values())
        print_whole(table)
    bench.finish(output / "rule.json", facts)
