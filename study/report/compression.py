"""The report's section on compression: size and loss after each step, ratio against loss, power."""

from collections.abc import Iterator

from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError
from splatcore.study.report.page import Card, Item
from splatcore.study.report.results import Facts, Results
from splatcore.study.results.compression import Point, PowerRow, StepRow
from splatcore.study.results.fields import columns

SIZES = (
    "gaussians sh_degree bytes ratio psnr_db psnr_db_min ssim psnr_db_beside_mean "
    "work.fps_at_800mhz bytes_each"
)
POWER = "bytes cycles fps_at_800mhz traffic_bytes fps power_w leakage_w cells_w dram_w"
"""Keys of columns."""


def rows(scenes: dict[str, Facts], part: str, key: str) -> list[dict]:
    """Rows of one part of all scenes."""
    return [
        {"scene": scene} | row
        for scene, found in scenes.items()
        for row in found.get(part, {}).get(key, ())
    ]


def compressed(results: Results) -> Iterator[Item]:
    """The tables of the parts that were measured."""
    facts = results.facts("compression")
    scenes = {
        scene: found
        for scene, found in facts["scenes"].items()
        if not results.options.scenes or scene in results.options.scenes
    }
    steps, points = rows(scenes, "steps", "rows"), rows(scenes, "curve", "points")
    powers = rows(scenes, "power", "rows")
    if not steps and not points and not powers:
        raise InputError(f"{facts.file}: holds no steps, no curve and no power")
    if steps:
        best = max((row for row in steps if row["ratio"]), key=lambda row: row["ratio"])
        yield Card(
            "Gain of each idea", f"{best['ratio']:.0f} ×",
            f"smaller than the scene as float32 PLY after {best['step']} ({best['scene']})",
        )  # fmt: skip
        yield Table.of(
            "compression-steps",
            "Size and quality after each step of compression. PSNR and SSIM: the reference's 8-bit "
            "pictures in held-out views, mean, against photographs or, for scene files, against "
            "the original scene. Off the path: views moved away from the camera path.",
            [Column("scene"), *columns(StepRow, f"step {SIZES} seconds")],
            steps,
        )  # fmt: skip
    if points:
        yield Table.of(
            "compression-curve",
            "Compression ratio against loss, with the same metrics. Target “packing”: packing "
            "alone. Frames per second: at 800 MHz by the cycle model.",
            [Column("scene"), *columns(Point, f"target_ratio {SIZES}")],
            points,
        )  # fmt: skip
    if powers:
        yield Table.of(
            "compression-power",
            "ESTIMATE of the machine's power after each step, from frames simulated in RTL, at the "
            "paper's frames per second or the machine's maximum if that is lower. DRAM is not "
            "included in the power. Power in cells: with cells of a library, scaled to 28 nm.",
            [Column("scene"), *columns(PowerRow, f"step {POWER}")],
            powers,
        )  # fmt: skip


COMPRESSION = (compressed,)
