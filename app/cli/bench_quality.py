"""The command `bench quality`: bytes against error of packed models."""

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    MACHINE,
    PresetOption,
    option,
)
from splatcore.sim.common.table import Table
from splatcore.sim.frame.reading import Reading
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.bench.quality import TARGETS, quality
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import QualityRow

SHOWN = (
    "scene camera asked bytes_per_gaussian psnr_db_scene psnr_db_packing psnr_db_machine "
    "max_error_machine cycles.frame model_bytes"
)
"""Keys of columns."""

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
    Table.of(
        "quality", "by golden and cycle model", columns(QualityRow, SHOWN), facts["rows"]
    ).print()
    bench.finish(output / "quality.json", facts)
