"""Results of campaigns over machines: sweep, ablation, faintness rules."""

from splatcore.study.results.fields import LEVELS, Errors, errors, item, part, result, table
from splatcore.study.results.frames import (
    BY_MODEL,
    CYCLES,
    MILLION,
    THOUSAND,
    camera,
    counts,
    failed,
    fps,
    preset,
    scene,
    size,
)


@result
class Simulated:
    """A machine simulated in RTL."""

    scene: str = scene()
    camera: str = camera()
    size: str = size("the view")
    cycles: int = item("of the frame in RTL", "M cycles", 3, per=MILLION, title="RTL")
    model_cycles: int = item(
        "the cycle model's", "M cycles", 3, per=MILLION, title="cycle model"
    )  # fmt: skip
    identical: bool = item("whether the picture is the golden model's")


@result
class SweepPoint:
    """A machine of a sweep."""

    knob: str = item("what differs from `DEFAULT`", title="changed")
    value: str = item("how much of it there is")
    fields: dict = item("the fields of `Config` that differ", kept=False, examples=({},))
    nand2: float | None = item(
        "the machine's gates: those of its parts, each synthesised on its own for area, and for "
        "what lies between them as many as `DEFAULT` has",
        "k NAND2", 1, title="gates", per=THOUSAND,
    )  # fmt: skip
    nand2_by_part: dict | None = item("the same by part", kept=False, examples=(None,))
    memory_kb: float | None = item("its on-chip memories", "KB", 1, title="memory")
    views: int = item("over how many views")
    frame_cycles_max: int = item(
        "of the slowest view", "M cycles", 2, title="frame", per=MILLION, maybe=True
    )
    frame_cycles_mean: float = item(
        "the geometric mean of all views", "M cycles", 2, title="mean", per=MILLION, maybe=True
    )
    fps_min: float = item("of the slowest view", "at 800 MHz", 1, title="FPS", maybe=True)
    psnr_db_machine_min: float | None = item(
        "of the worst view", "dB", 2, title="PSNR, machine, lowest", none="exact", maybe=True
    )
    psnr_db_machine_mean: float | None = item(
        "the mean of all views", "dB", 2, title="PSNR, machine, mean", none="exact", maybe=True
    )
    max_error_machine_max: float = item(
        "of the worst view", f"of {LEVELS}", 0, title="max error, machine", per=1 / LEVELS,
        maybe=True,
    )  # fmt: skip
    front: bool = item(
        "no other machine is as good in `frame_cycles_max`, `frame_cycles_mean`, `nand2` and "
        "`psnr_db_machine_mean` and better in one of them"
    )
    rtl: Simulated | None = part("with `--confirm`, for the front, else `null`")


@result
class SweepRow:
    """A machine on a view."""

    point: str = item("the machine", title="machine")
    scene: str = scene()
    camera: str = camera()
    cycles: dict = part(BY_MODEL, "M cycles", 2, per=MILLION, keys=CYCLES, kept="frame")
    fps_at_800mhz: float = fps()
    machine: Errors = errors("machine")
    scene_error: Errors = errors("scene", maybe=True)
    counts: dict = counts()


@result
class Sweep:
    """`sweep.json`."""

    size: str = size()
    failed: list = failed()
    points: dict[str, SweepPoint] = table("by name, for each machine", "points", "point")
    rows: list[SweepRow] = table("one for each machine and view", "rows")


@result
class AblationStep:
    """A step of the ablation."""

    name: str = item("of the step", title="step")
    fields: dict = item("of `Config` that the step changes", kept=False, examples=({},))
    paper_fps: float | None = item("the paper's frames per second", "FPS", 1)


@result
class AblationRow:
    """A step on a view."""

    scene: str = scene()
    camera: str = camera()
    step: str = item("name of the step")
    cycles: dict = part(BY_MODEL, "M cycles", 3, per=MILLION, keys=CYCLES, kept="frame")
    fps_at_800mhz: float = fps()
    rtl_cycles: int | None = item("of the frame in RTL, with `--rtl`", "M cycles", 3, per=MILLION)
    rtl_identical: bool | None = item("whether that picture is the golden model's")
    machine: Errors = errors("machine", kept=False)
    scene_error: Errors = errors("scene", maybe=True, kept=False)
    counts: dict = counts()


@result
class Ablation:
    """`ablation.json`."""

    preset: str = preset()
    size: str = size()
    quality: str | None = item("as given (`null`: as small as is good enough)", kept=False)
    failed: list = failed()
    steps: list[AblationStep] = table("in their order", "steps")
    rows: list[AblationRow] = table("one for each step and view", "rows")


@result
class RuleRow:
    """A view with one rule."""

    scene: str = scene()
    camera: str = camera()
    rule: str = item("`3DGS`, or A, B, C of `Config.faint`")
    raster_cycles: int = item(
        "of stage 3 alone, its splats always valid, by the cycle model", "k", 0, per=THOUSAND
    )
    visited: int = item("blocks with a pixel of alpha ≥ 1/255 that were visited")
    pairs: int = item("pairs of a splat and a tile with a marked block")
    error: Errors = errors(
        "machine",
        meaning="of the golden model's 8-bit picture, against the reference on the same packed "
        "model under 3DGS's rule",
    )


MEAN = "mean of what is left of a view's under 3DGS's rule, which is 1"
LEFT = "the same of the views of most and of least gain"
OVER = "error over the views"


def share(meaning: str, title: str):
    return item(meaning, digits=3, title=title)


def over_views(title: str):
    return item(OVER, "dB", 2, title=title, none="exact")


@result
class RuleSummary:
    """A rule over all views."""

    views: int = item("how many")
    raster_cycles: float = share(MEAN, "cycles")
    visited: float = share(MEAN, "blocks")
    pairs: float = share(MEAN, "pairs")
    raster_cycles_max: int = item("cycles of the slowest view")
    raster_cycles_share_min: float = share(LEFT, "cycles, min")
    raster_cycles_share_max: float = share(LEFT, "cycles, max")
    psnr_db_machine_min: float | None = over_views("PSNR, lowest")
    psnr_db_machine_mean: float | None = over_views("PSNR, mean")
    psnr_db_machine_max: float | None = over_views("PSNR, highest")
    max_error_machine_max: float = item(OVER, digits=3, title="largest error")
    allowed: bool = item("every view has 55 dB or more and no error above 0.1")
    front: bool = item(
        "allowed, and no other rule that is has both as few `raster_cycles` and as high a "
        "`psnr_db_machine_mean`, and one of them better"
    )


@result
class Rules:
    """`rule.json`."""

    preset: str = preset()
    size: str = size()
    quality: str | None = item("how the scenes were packed")
    rules: dict[str, RuleSummary] = table("for each rule over all views", "", "rule")
    rows: list[RuleRow] = table("one for each view and rule, which `rule.csv` has too", "rows")
    failed: list = failed()
