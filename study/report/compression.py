"""The report's section on compression: size and loss after each step, ratio against loss, power."""

from collections.abc import Iterator

from splatcore.spec.error import InputError
from splatcore.study.report.kept_columns import BESIDE
from splatcore.study.report.page import MILLI, MILLION, Card, Column, Item, Table
from splatcore.study.report.results import Facts, Results, in_units

SIZES = (
    Column("Gaussians", "", 0), Column("degree", "", 0), Column("size", "MB", 3),
    Column("ratio", "×", 1), Column("PSNR", "dB", 2), Column("PSNR, lowest", "dB", 2),
    Column("SSIM", "", 4), Column("PSNR off the path", "dB", 2),
    Column("frames per second", "", 0), Column("bytes per Gaussian of the original", "", 2),
)  # fmt: skip


def sizes(row: Facts) -> list:
    """Cells of `SIZES`; empty for a ratio that was not reached."""
    size = row.get("bytes")
    keys = ("gaussians", "sh_degree", "ratio", "psnr_db", "psnr_db_min", "ssim", BESIDE)
    gaussians, degree, *rest = (row.get(key) for key in keys)
    fps = row.get("work", {}).get("fps_at_800mhz")
    return [gaussians, degree, size and size / MILLION, *rest, fps, row.get("bytes_each")]


POWER = (
    Column("model", "MB", 3), Column("cycles", "k", 0), Column("max frames per second", "", 0),
    Column("traffic per frame", "MB", 2), Column("at frames per second", "", 0),
    Column("power", "mW", 0), Column("leakage", "mW", 0), Column("power in cells", "mW", 0),
    Column("DRAM", "mW", 0),
)  # fmt: skip


def power_cells(row: Facts) -> list:
    """A step's name and the cells of `POWER`."""
    keys = ("power_w", "leakage_w", "cells_w", "dram_w")
    milliwatts = [in_units(row, key, MILLI) for key in keys]
    return [
        row["step"], row["bytes"] / MILLION, row["cycles"] / 1000, row["fps_at_800mhz"],
        row["traffic_bytes"] / MILLION, row["fps"], *milliwatts,
    ]  # fmt: skip


def compressed(results: Results) -> Iterator[Item]:
    """The tables of the parts that were measured."""
    facts = results.campaign("compression")
    scenes = {
        scene: found
        for scene, found in facts["scenes"].items()
        if not results.options.scenes or scene in results.options.scenes
    }
    steps = [
        [scene, row["step"], *sizes(row), row["seconds"]]
        for scene, found in scenes.items()
        for row in found.get("steps", {}).get("rows", ())
    ]
    points = [
        [scene, row["target_ratio"], *sizes(row)]
        for scene, found in scenes.items()
        for row in found.get("curve", {}).get("points", ())
    ]
    powers = [
        [scene, *power_cells(row)]
        for scene, found in scenes.items()
        for row in found.get("power", {}).get("rows", ())
    ]
    if not steps and not points and not powers:
        raise InputError(f"{facts.file}: holds no steps, no curve and no power")
    if steps:
        best = max((row for row in steps if row[5]), key=lambda row: row[5])
        yield Card(
            "Gain of each idea", f"{best[5]:.0f} ×",
            f"smaller than the scene as float32 PLY after {best[1]} ({best[0]})",
        )  # fmt: skip
        yield Table(
            "compression-steps",
            "Size and quality after each step of compression. PSNR and SSIM: the reference's 8-bit "
            "pictures in held-out views, mean, against photographs or, for scene files, against "
            "the original scene. Off the path: views moved away from the camera path.",
            [Column("scene"), Column("after"), *SIZES, Column("took", "s", 0)],
            steps, ("compression",),
        )  # fmt: skip
    if points:
        yield Table(
            "compression-curve",
            "Compression ratio against loss, with the same metrics. Target “packing”: packing "
            "alone. Frames per second: at 800 MHz by the cycle model.",
            [Column("scene"), Column("target", "×", 1, none="packing"), *SIZES],
            points, ("compression",),
        )  # fmt: skip
    if powers:
        yield Table(
            "compression-power",
            "ESTIMATE of the machine's power after each step, from frames simulated in RTL, at the "
            "paper's frames per second or the machine's maximum if that is lower. DRAM is not "
            "included in the power. Power in cells: with cells of a library, scaled to 28 nm.",
            [Column("scene"), Column("after"), *POWER],
            powers, ("compression",),
        )  # fmt: skip


COMPRESSION = (compressed,)
