"""The command `bench quality`: bytes against error of packed models."""

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    MACHINE,
    PresetOption,
    option,
)
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.frame.reading import Reading
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.bench.quality import TARGETS, quality

AGAINST = ("scene", "packing", "machine")

TargetsOption = option(
    str, "DB,DB,…", "Also pack the smallest model for each PSNR.", "--psnr", panel=MACHINE
)


@bench.bench.command("quality")
def quality_command(
    output: bench.FolderOption,
    reading: Reading,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    psnr: TargetsOption = TARGETS,
    preset: PresetOption = "DEFAULT",
    scheduler: bench.SchedulerOption = None,
):
    """Measure bytes per Gaussian against dB for each way to pack.

    dB of the golden model's 8-bit pictures: against the reference's picture of the original scene
    ("scene") and of the same packed model ("machine"). Writes DIR/quality.json, a plot and
    pictures.
    """
    try:
        targets = [float(text) for text in psnr.split(",") if text.strip()]
    except ValueError:
        raise InputError(f"--psnr '{psnr}': must be numbers separated by commas") from None
    config = find_preset(preset)
    found = bench.look(output, scene, cameras, size, [config], reading=reading)
    facts = quality(config, found, targets, output, scheduler)
    headings = "bytes|dB, scene|dB, packing|dB, machine|max error, machine|k cycles|model MB read"
    table = new_table("view", headings.split("|"), "by golden and cycle model", ["packing"])
    for row in facts["rows"]:
        decibels = [shown(row[f"psnr_db_{name}"], ".2f", none="∞") for name in AGAINST]
        table.add_row(
            f"{row['scene']} {row['camera']}", f"{row['bytes_per_gaussian']:.2f}", *decibels,
            f"{row['max_error_machine']:.3f}", f"{row['cycles']['frame'] / 1000:,.0f}",
            f"{row['model_bytes'] / 1e6:.2f}", row["asked"],
        )  # fmt: skip
    print_whole(table)
    bench.finish(output / "quality.json", facts)
