"""Results of `bench compression`: models after each step and by ratio, and their power."""

from splatcore.study.results.fields import item, part, result, table
from splatcore.study.results.frames import FAILED, MILLION, THOUSAND, preset

MILLI = 1e-3
LEFT = "what is left"
TRUTH = "against the truth, mean of the views' PSNR (`null`: equal pictures, which it leaves out)"
CHANGE = "what the original has is taken off; `null` if one of the two is"


@result
class Work:
    """The machine's work on a model, mean of the views."""

    splats: float = item("Gaussians that touch a tile", digits=0, kept=False, title="visible")
    tile_pairs: float = item("pairs of a splat and a tile", digits=0, title="pairs")
    pairs: float = item("those with a live pixel", digits=0, title="pairs done")
    cycles: float = item("of the frame, by the cycle model", "k", 0, per=THOUSAND, kept=False)
    preprocessing: float = item("cycles of this half", kept=False)
    rendering: float = item("cycles of this half", kept=False)
    fps_at_800mhz: float = item("at 800 MHz", digits=0, title="frames per second")


@result
class Model:
    """A model's size, and its quality as means over the held-out views."""

    gaussians: int = item(LEFT, digits=0, title="Gaussians", maybe=True)
    sh_degree: int = item(LEFT, digits=0, title="degree", maybe=True)
    bytes: int = item(
        "its size (float32 PLY, after the last step the packed model)", "MB", 3, title="size",
        per=MILLION, maybe=True,
    )  # fmt: skip
    ratio: float | None = item("how often that goes into `ply_bytes`", "×", 1, maybe=True)
    psnr_db: float | None = item(TRUTH, "dB", 2, title="PSNR", maybe=True)
    psnr_db_min: float | None = item("the least", "dB", 2, title="PSNR, lowest", maybe=True)
    ssim: float = item("the mean", digits=4, title="SSIM", maybe=True)
    max_error: float = item("the largest", digits=4, maybe=True)


@result
class Other:
    """Values of a model that are not kept."""

    flip: float = item("mean FLIP, 0 … 1", digits=3, title="FLIP", kept=False, maybe=True)
    lpips: float | None = item(
        "LPIPS (AlexNet), `null` where its weights are not installed", digits=3, title="LPIPS",
        kept=False, maybe=True,
    )  # fmt: skip
    psnr_db_change: float | None = item(CHANGE, kept=False, maybe=True)
    ssim_change: float | None = item(CHANGE, kept=False, maybe=True)
    flip_change: float | None = item(CHANGE, kept=False, maybe=True)
    lpips_change: float | None = item(CHANGE, kept=False, maybe=True)
    psnr_db_beside: dict = item(
        "of a scene with a path of cameras: PSNR by where a view lies beside it, `5 degrees`, "
        "`15 degrees`, `nearer`, `farther`, each one held-out view moved",
        kept=False, maybe=True, examples=({},),
    )  # fmt: skip


def each():
    return item(
        "for each Gaussian of the original", digits=2, title="bytes per Gaussian of the original",
        maybe=True,
    )  # fmt: skip


def beside():
    return item("the mean of these", "dB", 2, title="PSNR off the path", maybe=True)


@result
class Named:
    """A step of compression."""

    step: str = item("name of the step", title="after", examples=("packed",))
    kind: str = item("kind of the step")


@result
class StepRow(Other, Model, Named):
    """The model after a step."""

    psnr_db_beside_mean: float | None = beside()
    seconds: float = item("it took", "s", 0, title="took")
    loss: float | None = item("it ended with", kept=False)
    work: Work = part("the machine's work", maybe=True)
    bytes_each: float = item(
        "for each Gaussian of the original", digits=2, title="bytes per Gaussian of the original",
        maybe=True, kept=False,
    )  # fmt: skip


@result
class Target:
    """A target."""

    target_ratio: float | None = item(
        "that was asked for, `null` for packing alone", "×", 1, title="target", none="packing",
        examples=(None, 100.0),
    )  # fmt: skip


@result
class Point(Other, Model, Target):
    """A model of a given ratio."""

    bytes_each: float = each()
    psnr_db_beside_mean: float | None = beside()
    work: Work = part("the machine's work", maybe=True, kept="fps_at_800mhz")
    note: str = item("why a point has no `ratio` or not that one")


@result
class PowerRow(Named):
    """A step's power."""

    gaussians: int = item("of the model", digits=0, title="Gaussians")
    sh_degree: int = item("of the model", digits=0, title="degree")
    bytes: int = item("of the model in memory", "MB", 3, title="model", per=MILLION)
    cycles: int = item("of a frame in RTL", "k", 0, per=THOUSAND)
    fps_at_800mhz: float = item("at most", digits=0, title="max frames per second")
    fps: float = item(
        "the paper's 129, or as many as there are", digits=0, title="at frames per second"
    )
    traffic_bytes: int = item("of a frame", "MB", 2, per=MILLION, title="traffic per frame")
    power_w: float = item("at `fps`, without DRAM", "mW", 0, per=MILLI, title="power")
    leakage_w: float = item("of that", "mW", 0, per=MILLI, title="leakage")
    frame_j: float = item(
        "on the chip with its share of leakage", "mJ", 2, per=MILLI, title="per frame"
    )
    dram_w: float = item("apart", "mW", 0, per=MILLI, title="DRAM")
    cells_w: float = item(
        "the power in cells", "mW", 0, per=MILLI, title="power in cells", maybe=True
    )


@result
class Steps:
    """Part `steps`."""

    recipe: dict = item("fields of `model.compress.recipe.Recipe`", kept=False, examples=({},))
    rows: list[StepRow] = table("one for each step", "steps")


@result
class Curve:
    """Part `curve`."""

    recipe: dict = item("as of `steps`", kept=False, examples=({},))
    points: list[Point] = table("the first of them packing alone", "curve")


@result
class Powers:
    """Part `power`, an ESTIMATE."""

    view: str = item("that was rendered in RTL", kept=False)
    size: list = item("width and height in pixels", kept=False)
    library: str = item("of cells, if there is one", kept=False, maybe=True)
    process_nm: float = item("of that library", kept=False, maybe=True)
    rows: list[PowerRow] = table("one for each step", "power")


@result
class Scene:
    """A scene's results."""

    against: str = item(
        "the truth: `photographs` that were held out, or the `original` scene's pictures",
        kept=False,
    )
    views: int = item("number of held-out views", kept=False)
    size: list = item("width and height of the first", kept=False)
    gaussians: int = item("of the original", kept=False)
    sh_degree: int = item("of the original", kept=False)
    ply_bytes: int = item("of the original as float32 PLY with all attributes", kept=False)
    steps: Steps = part("after each step", maybe=True)
    schedule: dict = item(
        "pruning schedules: `steps_in_all` (fine-tuning steps, the same for all rows), `original` "
        "(its quality) and `rows`, after pruning alone, with the `schedule`, `steps` after each "
        "pruning and `gaussians_before` the last one", kept=False, maybe=True, examples=({},),
    )  # fmt: skip
    curve: Curve = part("ratio against loss", maybe=True)
    budget: dict = item(
        "`psnr_db`, `psnr_db_min`, `ssim`, `max_error` of three pairs of pictures of the packed "
        "model: `model`, the reference's against the truth; `machine`, the golden engine's against "
        "the reference's; `both`, the golden engine's against the truth", kept=False, maybe=True,
        examples=({},),
    )  # fmt: skip
    power: Powers = part("an ESTIMATE after each step", maybe=True)


@result
class Compression:
    """`compression.json`."""

    preset: str = preset()
    size: list = item("of the views by which scenes are judged", examples=([64, 48],))
    degree: int | None = item("that was asked for (`null`: none)")
    quality: str | None = item("that was asked for (`null`: none)")
    beside: float = item("share of a path's views that lie beside it")
    seed: int = item("of all that is random", kept=False)
    failed: list = item(FAILED, examples=([],))
    scenes: dict[str, Scene] = table("by name", None, "scene", examples=("vase.ply", "jug.ply"))
