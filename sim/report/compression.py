"""The report's section of compression: size and loss after each step, and ratio against loss."""

from collections.abc import Iterator

from splatcore.sim.report.page import MILLION, Card, Column, Item, Table
from splatcore.sim.report.results import Facts, Results
from splatcore.spec.error import InputError

SIZES = (
    Column("Gaussians", "", 0), Column("degree", "", 0), Column("size", "MB", 3),
    Column("ratio", "×", 1), Column("PSNR", "dB", 2), Column("PSNR, lowest", "dB", 2),
    Column("SSIM", "", 4),
)  # fmt: skip


def sizes(row: Facts) -> list:
    """Cells of `SIZES`; a point that was not reached has none."""
    size = row.get("bytes")
    keys = ("gaussians", "sh_degree", "ratio", "psnr_db", "psnr_db_min", "ssim")
    gaussians, degree, *rest = (row.get(key) for key in keys)
    return [gaussians, degree, size and size / MILLION, *rest]


def compressed(results: Results) -> Iterator[Item]:
    """Both tables, as far as their parts were measured."""
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
    if not steps and not points:
        raise InputError(f"{facts.file}: holds neither steps nor a curve")
    if steps:
        best = max((row for row in steps if row[5]), key=lambda row: row[5])
        yield Card(
            "What each idea buys", f"{best[5]:.0f} ×",
            f"smaller than the scene as float32 PLY after {best[1]} ({best[0]})",
        )  # fmt: skip
        yield Table(
            "compression-steps",
            "After each step of compression: what is left, and PSNR and SSIM of the reference's "
            "8-bit pictures of views that were not learned from, against photographs or, without "
            "any, against the original scene's.",
            [Column("scene"), Column("after"), *SIZES, Column("took", "s", 0)],
            steps, ("compression",),
        )  # fmt: skip
    if points:
        yield Table(
            "compression-curve",
            "Ratio against loss, the same metrics; asked for: none is packing alone.",
            [Column("scene"), Column("asked for", "×", 1, none="packing"), *SIZES],
            points, ("compression",),
        )  # fmt: skip


COMPRESSION = (compressed,)
