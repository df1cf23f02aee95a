"""Keys of each result that are kept in docs/results; docs/json.md explains them."""

from typing import NamedTuple

from splatcore.spec.stages import NAMES


class Sheet(NamedTuple):
    """A table.

    place: path of its rows in the result's object, see `kept.steps`
    columns: dotted keys of a row; the place's own columns come first
    """

    place: str
    columns: str


class Kept(NamedTuple):
    """The kept part of a result.

    lines: dotted keys of values outside the tables
    sheets: tables by END of the file name NAME-END.csv; empty for NAME.csv
    pictures: files in the result's folder
    """

    lines: str
    sheets: dict[str, Sheet]
    pictures: tuple[str, ...] = ()


AGAINST = ("psnr_db", "ssim", "max_error")


def errors(*truths: str) -> str:
    return " ".join(f"{metric}_{truth}" for truth in truths for metric in AGAINST)


def cycles(key: str, *more: str) -> str:
    return " ".join(f"{key}.{name}" for name in (*more, "preprocessing", "rendering", "frame"))


VIEW = "scene camera"

TRAFFIC = (
    "read_model read_positions read_attributes write_features read_features write_lists read_lists "
    "write_groups read_groups read_long_lists write_buckets write_pixels"
)

BESIDE = "psnr_db_beside_mean"  # in views off the path

MODEL = "gaussians sh_degree bytes ratio psnr_db psnr_db_min ssim max_error"

CASES = Kept(
    "preset engine",
    {"": Sheet("cases{case}", "about bound psnr_db_machine max_error_machine passed")},
)

PLACED = "luts flip_flops multipliers block_rams fmax_mhz begin end"

DEVICE = Kept("preset device speed failed", {"": Sheet("parts{part}", PLACED)})

TABLES = {
    "scenes": Kept("", {"": Sheet(
        "rows[]",
        f"{VIEW} quality bytes_per_gaussian size preset timing.name identical ended "
        f"{errors('machine', 'scene')} {cycles('cycles')} cycles.fps_at_800mhz "
        f"{cycles('model_cycles', *NAMES)} "
        + " ".join(f"traffic_bytes.{cause}" for cause in TRAFFIC.split()),
    )}),
    "quality": Kept("preset size failed", {"": Sheet(
        "rows[]",
        f"{VIEW} asked gaussians sh_degree bytes bytes_per_gaussian model_bytes "
        f"{errors('scene', 'packing', 'machine')} {cycles('cycles', *NAMES)}",
    )}),
    "budget": Kept("preset size", {
        "": Sheet(
            "rows[]",
            f"{VIEW} quality bytes_per_gaussian {errors('packing', 'machine', 'scene')}",
        ),
        "parts": Sheet("rows[row].parts[]", "of part psnr_db max_error share"),
    }),
    "sweep": Kept("size failed", {
        "points": Sheet(
            "points{point}",
            "knob value nand2 memory_kb views frame_cycles_max frame_cycles_mean fps_min "
            "psnr_db_machine_min psnr_db_machine_mean max_error_machine_max front rtl.scene "
            "rtl.camera rtl.size rtl.cycles rtl.model_cycles rtl.identical",
        ),
        "rows": Sheet(
            "rows[]", f"point {VIEW} cycles.frame fps_at_800mhz {errors('machine', 'scene')}",
        ),
    }),
    "synth": Kept("preset top.nand2 top.speed_nand2", {"": Sheet(
        "top.parts{part}", "stage count nand2 depth speed_nand2 speed_depth flip_flops",
    )}),
    "memories": Kept("preset kilobytes", {"": Sheet("stages{stage}[]", "words bits count")}),
    "ablation": Kept("preset size failed", {
        "steps": Sheet("steps[]", "name paper_fps"),
        "rows": Sheet(
            "rows[]", f"{VIEW} step cycles.frame fps_at_800mhz rtl_cycles rtl_identical"
        ),
    }),
    "power": Kept(
        "preset scene camera size fps power_w dram_w pixels_per_j paper",
        {
            "": Sheet("stages{stage}", "nand2 flip_flops activity switching clock leakage"),
            "memories": Sheet("stage_memories{stage}", "kilobits reads writes access leakage"),
        },
    ),
    "hard": CASES._replace(pictures=("hard-cases.png",)),
    "hard-rtl": CASES,
    "hard-paper": CASES,
    "fpga-tiny": DEVICE,
    "fpga": DEVICE,
    "fpga-whole": DEVICE._replace(sheets={"": Sheet("seeds[]", f"{PLACED} logic routing")}),
    "compression": Kept("preset size degree quality beside failed", {
        "steps": Sheet(
            "scenes{scene}.steps.rows[]",
            f"step kind {MODEL} {BESIDE} seconds work.tile_pairs work.pairs work.fps_at_800mhz",
        ),
        "curve": Sheet(
            "scenes{scene}.curve.points[]",
            f"target_ratio {MODEL} bytes_each {BESIDE} work.fps_at_800mhz note",
        ),
        "power": Sheet(
            "scenes{scene}.power.rows[]",
            "step kind gaussians sh_degree bytes cycles fps_at_800mhz fps traffic_bytes power_w "
            "leakage_w frame_j dram_w cells_w",
        ),
    }),
}  # fmt: skip
"""By the names of `results.SOURCES`."""

TEXTS = {
    "scene", "camera", "quality", "size", "preset", "name", "ended", "asked", "of", "part", "knob",
    "value", "point", "step", "stage", "engine", "about", "bound", "device", "begin", "end", "kind",
    "note",
}  # fmt: skip
"""Keys of text values (last part of a dotted key); all other values are JSON."""
