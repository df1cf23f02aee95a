"""The command `bench rule`: faintness rules, cycles against error."""

from dataclasses import replace

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    MACHINE,
    PresetOption,
    option,
)
from splatcore.model.formats.model_file import is_packed
from splatcore.model.pack.quality import COMPACT, QUALITIES
from splatcore.sim.frame.reading import Reading
from splatcore.spec.preset import find_preset

QualityOption = option(
    str | None,
    "NAME",
    f"Packing of the scenes: {', '.join(QUALITIES)}. Default: {COMPACT}.",
    "--quality",
    panel=MACHINE,
)


@bench.bench.command("rule")
def rule_command(
    output: bench.FolderOption,
    reading: Reading,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    quality: QualityOption = None,
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
    config = find_preset(preset)
    found = bench.look(output, scene, cameras, size, [config], quality, reading)
    from splatcore.study.bench.rule import measure_rules, over_all

    found = [
        view if view.quality or is_packed(view.scene) else replace(view, quality=COMPACT)
        for view in found
    ]
    facts = measure_rules(config, found, output, scheduler)
    over_all(facts).print()
    bench.finish(output / "rule.json", facts)
