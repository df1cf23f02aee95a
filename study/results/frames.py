"""Results on views: scenes in RTL, packings, error budgets, machines of a sweep, hard cases."""

from splatcore.spec.stages import NAMES
from splatcore.study.results.fields import LEVELS, Errors, errors, item, part, result, table

HALVES = ("preprocessing", "rendering", "frame")

CYCLES = (*NAMES, *HALVES)
"""Keys of the cycle model's cycles: by stage, half and frame."""

TRAFFIC = (
    "read_model", "read_positions", "read_attributes", "write_features", "read_features",
    "write_lists", "read_lists", "write_groups", "read_groups", "read_long_lists",
    "write_buckets", "write_pixels",
)  # fmt: skip
"""Causes of DRAM traffic."""

PACKINGS = ("compact", "balanced", "faithful")
"""Qualities by rising bytes per Gaussian."""

MILLION, THOUSAND = 1e6, 1e3

WHICH = "the view"
FAILED = "`what` could not be measured and `why`"
SIZE = "width and height in pixels of all views"
BY_MODEL = "cycles of a frame by the cycle model, by stage and half"
PACKED = "size of the model without codebooks"


def scene():
    return item(WHICH, examples=("vase.ply", "hall.spz"))


def camera():
    return item(WHICH, examples=("0", "door"))


def preset():
    return item("the machine", examples=("DEFAULT",))


def size(meaning: str = SIZE):
    return item(meaning, examples=("64x48",))


def failed():
    return item(FAILED, examples=([],))


def bytes_each():
    return item(PACKED, "bytes per Gaussian", 2, title="size", examples=(21.75, 37.75))


def fps(**more):
    return item(
        "frames per second those cycles give at 800 MHz", "at 800 MHz", 1, title="FPS", **more
    )


def counts():
    return item("the golden model's", kept=False, examples=({},))


def million(meaning: str):
    return item(meaning, "M cycles", 2, per=MILLION)


@result
class FrameCycles:
    """Cycles of frames in RTL."""

    preprocessing: int = million("of the first frame, alone")
    rendering: int = million("of the first frame")
    frame: int = million("of the last frame whose halves were both at work")
    fps_at_800mhz: float = fps()
    rendering_alone: int = item("of the last frame", kept=False)


@result
class SceneRow:
    """A scene, camera and memory of `bench scenes`: one file each."""

    key: str = item(
        "stands for machine, what packs scenes, view and memory; the file stands as long as it is "
        "the same",
        kept=False,
    )
    scene: str = scene()
    camera: str = camera()
    quality: str | None = item("how the scene was packed, if that was asked for")
    bytes_per_gaussian: float = bytes_each()
    size: str = size(WHICH)
    preset: str = preset()
    timing: dict[str, str] = part(
        "memory: `name`, `latency` in cycles, `bandwidth` in bytes per cycle (0: unlimited), "
        "`granule` in bytes, `outstanding` requests, and what only tests set",
        keys=("name",), examples=("lpddr4",),
    )  # fmt: skip
    seconds: float = item("what the simulation of three frames took", kept=False)
    simulated_cycles: int = item("what the simulation of three frames took", kept=False)
    identical: bool = item("whether all pictures are the golden model's")
    difference: str = item("in what they differ otherwise", kept=False, maybe=True)
    ended: str = item("how the run ended", examples=("done",))
    error: Errors = errors("machine", "scene", meaning="of the last frame, as above", maybe=True)
    cycles: FrameCycles = part("of frames in RTL", maybe=True)
    model_cycles: dict = part(BY_MODEL, "k cycles", 0, per=THOUSAND, keys=CYCLES, maybe=True)
    traffic_bytes: dict = part(
        "DRAM bytes of the last frame by cause", "MB", 2, per=MILLION, keys=TRAFFIC, maybe=True
    )
    counters: dict = item("of the last frame", kept=False, maybe=True, examples=({},))
    counts: dict = item("the golden model's", kept=False, maybe=True, examples=({},))


@result
class Scenes:
    """All files of `bench scenes`."""

    rows: list[SceneRow] = table("one for each scene, camera and memory")


@result
class QualityRow:
    """A view in one packing."""

    scene: str = scene()
    camera: str = camera()
    asked: str = item(
        "`compact`, `balanced`, `faithful`, or the dB that the smallest model was found for",
        title="packed", examples=PACKINGS,
    )  # fmt: skip
    gaussians: int = item("of the model")
    sh_degree: int = item("of the model")
    bytes: int = item("of the model")
    bytes_per_gaussian: float = bytes_each()
    bytes_by_part: dict = item("those of `splatcore pack`", kept=False, examples=({},))
    model_bytes: int = item(
        "bytes of the model that a frame reads, without codebooks", "MB", 2, per=MILLION,
        title="model read",
    )  # fmt: skip
    error: Errors = errors("scene", "packing", "machine", meaning="as above, of the golden model")
    psnr_db_packing_by_part: dict = item("those of `splatcore pack`", kept=False, examples=({},))
    cycles: dict = part(BY_MODEL, "M cycles", 2, per=MILLION, keys=CYCLES)


@result
class Quality:
    """`quality.json`."""

    preset: str = preset()
    size: str = size()
    rows: list[QualityRow] = table("one for each view and way to pack it")
    failed: list = failed()


@result
class BudgetPart:
    """A line of a view's budget."""

    of: str = item(
        "`packing`: the reference's picture with that part alone as it is packed, against the "
        "scene as it is; `machine`: a picture with that part alone as the machine has it, against "
        "the reference on the packed model; `scene`: all, against the scene as it is",
        title="group",
    )
    part: str = item(
        "`positions`, `shape`, `opacity`, `colour` and `degree 1` … of packing; `arithmetic` of "
        "stages 0 and 1, `depth keys` (order), `too faint` (what the machine's rule leaves out), "
        "`raster` (stage 3 without that rule) and `8 bits` of the machine; the `sum of the parts`, "
        "their squared errors added; `all of packing`, `all of the machine`, `everything`"
    )
    psnr_db: float | None = item(
        "`null` for equal pictures", "dB alone", 2, title="PSNR", none="equal"
    )
    max_error: float | None = item(
        "largest error of a channel, 0 … 1, `null` for equal pictures or a sum", f"of {LEVELS}", 2,
        title="largest error", per=1 / LEVELS,
    )  # fmt: skip
    share: float | None = item("squared error, of that of `everything`", "%", 2, per=0.01)


@result
class BudgetRow:
    """A view."""

    scene: str = scene()
    camera: str = camera()
    size: list = item("width and height in pixels", kept=False)
    quality: str = item("how the scene was packed", title="packed as", examples=("faithful",))
    bytes_per_gaussian: float = bytes_each()
    error: Errors = errors(
        "packing", "machine", "scene", meaning="of 8-bit pictures of both, as above"
    )
    parts: list[BudgetPart] = table(
        "the lines of the budget, of pictures that are not rounded to 8 bits but where that is the "
        "part", "parts",
    )  # fmt: skip


@result
class Budget:
    """`error --stage all`."""

    stage: str = item("`all`", kept=False)
    preset: str = preset()
    size: str | None = size("of all views, `null` if they differ")
    rows: list[BudgetRow] = table("one for each view", index="row")


@result
class HardCase:
    """A hard case."""

    about: str = item("what is hard about it", title="difficulty", examples=("thin & <long>",))
    size: list = item("width and height in pixels", kept=False)
    gaussians: int = item("Gaussians in the scene", kept=False)
    left_out: dict = item(
        "Gaussians that touch no tile, by cause: `not_finite` (NaN or Inf), `transparent` (dropped "
        "by packing; the reference has them among the unseen), `near_culled` (at or behind the "
        "near plane), `unseen` (beside the image, or in a chunk that is skipped as a whole)",
        kept=False, examples=({},),
    )  # fmt: skip
    bound: str = item("what must hold")
    psnr_db_machine: float | None = item(
        "of the 8-bit picture against the reference on the same packed model, which here is not "
        "rounded to 8 bits; `null` with a reason", "PSNR, machine, dB", 2,
    )  # fmt: skip
    psnr_db_rule: float | None = item(
        "the same against the reference that leaves out what is too faint to be seen, as the "
        "machine does (`Config.faint`)", "dB", 2, title="PSNR, own rule", kept=False,
    )  # fmt: skip
    reason: str | None = item(
        "why there is no PSNR: identical pictures, the reference itself", kept=False
    )
    ssim_machine: float | None = item(
        "of the 8-bit pictures, as above; `null` for the reference", title="SSIM, machine",
        digits=5, kept=False,
    )  # fmt: skip
    max_error_machine: float | None = item(
        "of the 8-bit pictures, as above; `null` for the reference", f"of {LEVELS}", 0,
        title="max error, machine", per=1 / LEVELS,
    )  # fmt: skip
    error: Errors = errors(
        "scene", "packing", meaning="of the 8-bit pictures, as above", kept=False
    )
    identical: bool | None = item("rtl: whether the picture is the golden model's", kept=False)
    cycles: int | None = item(
        "golden: the cycle model's frame; rtl: the slower half's time as measured, as for `render`",
        digits=0, kept=False,
    )  # fmt: skip
    passed: bool = item("whether the bound holds")
    failures: list = item("in what it does not", kept=False)


@result
class Hard:
    """`hard.json`."""

    preset: str = preset()
    engine: str = item("`reference`, `golden` or `rtl`", examples=("golden",))
    timing: str | None = item("memory, `null` without `--engine rtl`", kept=False)
    passed: bool = item("whether all cases did", kept=False)
    cases: dict[str, HardCase] = table("by name", "", "case")
