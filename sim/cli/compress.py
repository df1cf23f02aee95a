"""The commands `train` and `compress`: photographs to a scene, a scene to a small model."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.recipe import Recipe
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.formats.photographs import Target
from splatcore.model.formats.ply import write_ply
from splatcore.model.pack.quality import COMPACT, INDEXED, STEPPED
from splatcore.sim.cli import options
from splatcore.sim.cli.options import argument, option
from splatcore.sim.common import output as files
from splatcore.sim.common.cache import digest
from splatcore.sim.common.metric import difference
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.size import parse_size, path_cameras
from splatcore.sim.common.source import open_source
from splatcore.sim.common.table import shown
from splatcore.sim.compression import run
from splatcore.sim.compression.steps_table import table_of, trials_of
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.preset import find_preset
from splatcore.spec.scene import ARRAYS, Gaussians, Scene

LOOKED_AT = 4  # views on which the loss is measured where there are no photographs

FolderArgument = argument(
    str, "DIR", "COLMAP model with its photographs in images/ beside or above it."
)
OutputOption = option(Path, "SCENE.ply", "Where to write it.", "-o")
StepsOption = option(int, None, "Steps of optimisation.", min=1)
TuneStepsOption = option(
    int, None, "Steps after each pruning; those of all after a single one.", min=0
)
ViewsOption = option(int, None, "Own pictures, without --images.", min=1)
SizeOption = option(str, "WxH", "Of the own pictures: as it will be rendered.")
ScaleOption = option(float, "S", "Shrink the photographs: 0.5 is half their size.")
HoldOutOption = option(int, "N", "Keep every N-th photograph for measuring; 0: none.", min=0)
ImagesOption = option(str | None, "DIR", "COLMAP folder or transforms.json with photographs.")
CamerasOption = option(
    str | None,
    "FILE",
    "Without --images: from where the scene will be looked at, as cameras.json, "
    "transforms.json or COLMAP folder. It learns on their path, not from all round.",
)
BesideOption = option(
    float | None,
    "S",
    "On a path of cameras: share of the views that lie beside it, up to 15° off, at 0.8 to 1.25 "
    f"times its distance; 0 … 1. Default: {run.BESIDE_SHARE:g}.",
    min=0,
    max=1,
)
ScheduleOption = option(
    str, "R,R,…", "Shares that the prunings remove, one by one; all at once where a target decides."
)
RatioOption = option(float | None, "R", "So many times smaller than the scene's float32 PLY.")
BytesOption = option(int | None, "N", "At most so many bytes in memory.")
PsnrOption = option(float | None, "DB", "As small as keeps this PSNR on pictures kept aside.")
FpsOption = option(float | None, "F", "So many frames a second of the machine, by its cycle model.")
DropOption = option(float | None, "DB", "Lose at most this on photographs kept aside.")
DistillOption = option(int, None, "Steps for each degree that goes, after least squares.", min=0)
QuantizeOption = option(int, None, "Steps under the packed model's numbers.", min=0)
RateOption = option(float, "S", "Learning rates, as a share of those that suit most scenes.")
OrderOption = option(str, "ORDER", "distill-first: harmonics go first; or prune-first.")
DegreeOption = option(
    int | None,
    None,
    "Of the model's harmonics; from 2 on it is packed in steps. Default: chosen by trials.",
    min=0,
    max=3,
)
QualityOption = option(
    str | None,
    None,
    f"Of a model of degree 2 or 3: {' or '.join(STEPPED)} (default: "
    f"{STEPPED[0]}); of degree 0 or 1: {' or '.join(INDEXED)} (default: chosen for a target, else "
    f"{COMPACT}).",
)
SeedOption = option(int, None, "Same seed, same result on one machine.", min=0)
WorkOption = option(
    Path | None, "DIR", "Where steps are kept. Default: the output's name + .steps."
)
AntialiasedOption = option(
    bool, None, "Compensate opacities for the blur of splats; the scene is marked and rendered so."
)


@options.app.command("train")
def train_command(
    folder: FolderArgument,
    output: OutputOption,
    steps: StepsOption = 7000,
    scale: ScaleOption = 1.0,
    hold_out: HoldOutOption = 7,
    seed: SeedOption = 0,
    work: WorkOption = None,
    antialiased: AntialiasedOption = False,
    near: options.NearOption = None,
    json: options.JsonOption = None,
):
    """Train a plain 3DGS scene from photographs: the baseline that compression starts from.

    Begins with COLMAP's points, densifies, and keeps its state every 500 steps: the same command
    goes on where it was stopped. Prints the PSNR of the photographs held out. Needs the extra
    `compress`.
    """
    run.check_installed()
    learn, aside = _split(folder, scale, hold_out, Reading(near=near))
    place = work or output.with_name(output.name + ".steps")
    scene = run.trained(folder, learn, steps, seed, place, Path(folder).name, antialiased)
    with files.whole_file(output) as part:
        write_ply(part, replace(scene, name=output.name))
    found = _decibels(scene.gaussians(), aside)
    facts = {
        "scene": str(output), "gaussians": len(scene), "sh_degree": scene.sh_degree, "steps": steps,
        "antialiased": scene.antialiased, "notes": list(scene.notes), "photographs": len(learn),
        "held_out": len(aside), "against": "photographs", "psnr_db": found,
    }  # fmt: skip
    shown = "" if found is None else f", {found:.2f} dB on {len(aside)} held-out photographs"
    console.print(f"{output}: {len(scene)} Gaussians{shown}", soft_wrap=True)
    write_json(json, facts)


@options.app.command("compress")
def compress_command(
    scene: options.SceneArgument,
    output: options.ModelOption,
    images: ImagesOption = None,
    cameras: CamerasOption = None,
    beside: BesideOption = None,
    schedule: ScheduleOption = "0.4,0.4,0.4,0.2",
    target_ratio: RatioOption = None,
    target_bytes: BytesOption = None,
    target_psnr: PsnrOption = None,
    target_fps: FpsOption = None,
    max_drop: DropOption = None,
    steps: TuneStepsOption = Recipe.steps,
    distill_steps: DistillOption = Recipe.distill_steps,
    quantize_steps: QuantizeOption = Recipe.quantize_steps,
    rate: RateOption = Recipe.rate,
    order: OrderOption = Recipe.order,
    degree: DegreeOption = None,
    quality: QualityOption = None,
    views: ViewsOption = 480,
    size: SizeOption = "1920x1080",
    antialiased: options.AntialiasedOption = None,
    axes: options.AxesOption = None,
    near: options.NearOption = None,
    scale: ScaleOption = 1.0,
    hold_out: HoldOutOption = 7,
    seed: SeedOption = 0,
    work: WorkOption = None,
    preset: options.PresetOption = "DEFAULT",
    plain: options.PlainOption = False,
    json: options.JsonOption = None,
):
    """Compress a scene: distil harmonics, prune, quantise, fine-tune between; pack the result.

    Degree and number of Gaussians are chosen by trials for the least loss at the size; a target
    out of reach is refused then. It learns from photographs (--images), or from the scene's own
    pictures: on the path of cameras (--cameras), or from all round. The same command goes on where
    it was stopped. Prints trials, steps, and the loss on held-out pictures. Needs `compress`.
    """
    run.check_installed()
    recipe = Recipe(
        parse_schedule(schedule), steps, distill_steps, quantize_steps, rate, order, degree,
        quality, target_ratio, target_bytes, target_psnr, target_fps, max_drop, seed,
    )  # fmt: skip
    if max_drop is not None and images is None:
        raise InputError("--max-drop: needs photographs (--images); else choose --target-psnr")
    config, pixels, share = find_preset(preset), parse_size(size), _beside(beside, cameras)
    original = _opened(scene, reading := Reading(antialiased, axes, near))
    recipe.check(original, config)
    path = reading.seen(path_cameras(cameras, size) if cameras and not images else ())
    learn, aside = _split(images, scale, hold_out, reading) if images else ((), ())
    learn = learn or _own_pictures(original, path, views, pixels, seed, share, reading.near_plane)
    place = work or output.with_name(output.name + ".steps")
    checkpoints = Checkpoints(place, _key(original, learn, recipe, config))
    model = run.compressed(original, learn, recipe, checkpoints, config, scene)
    files.write(output, data := file_bytes(model, plain))
    facts = {"scene": scene, "model": str(output), "file_bytes": len(data)}
    facts |= facts_of(original, model, checkpoints)
    _tell(checkpoints, facts)
    _end(facts | _loss(original, model.gaussians(), aside, pixels, seed, path, reading), json)


def _tell(checkpoints: Checkpoints, facts: dict):
    """What was tried, where there was a choice, and the steps."""
    if facts["choice"]:
        console.print(trials_of(facts["choice"]))
    console.print(table_of(checkpoints, facts["original_bytes"]))


def _end(facts: dict, json: Path | None):
    """The sizes and the loss, in a line, and the facts without what this `says`."""
    says = f"{facts['ratio']:.1f} times smaller: {_sizes(facts)}; {facts.pop('says')}"
    console.print(f"{facts['model']}: {says}", soft_wrap=True)
    write_json(json, facts)


def _key(scene: Scene, learn: tuple, recipe: Recipe, config: Config) -> str:
    """Stands for all that decides on a compression; a scene's own pictures follow from cameras."""
    arrays = [getattr(scene, name) for name in ARRAYS]
    seen = [each if isinstance(each, Target) else each.camera for each in learn]
    mark = " antialiased" if scene.antialiased else ""
    return f"{digest([arrays, seen])}{mark} {recipe!r} {config!r}"


def _beside(share: float | None, cameras: str | None) -> float:
    """The share of views beside the path; InputError for one without a path."""
    if share is not None and not cameras:
        raise InputError("--beside: goes with --cameras")
    return run.BESIDE_SHARE if share is None else share


def _opened(path: str, reading: Reading) -> Scene:
    """The scene of a file; InputError for a packed model."""
    with progress_bar(f"reading {path}"):
        return open_source(path, reading).unpacked


def _own_pictures(
    scene: Scene, path, views: int, size: tuple[int, int], seed: int, beside: float, near: float
) -> tuple:
    """The scene's own pictures, and from the cameras of a path, too."""
    learn = run.teacher(scene, views, size, seed, path, beside, near)
    return learn + run.pictures_at(scene, path, size) if path else learn


def parse_schedule(text: str) -> tuple[float, ...]:
    """Rates of "0.4,0.2"; InputError names the option."""
    try:
        return tuple(float(word) for word in text.split(",") if word.strip())
    except ValueError:
        raise InputError(f"--schedule '{text}': is not a list of shares like 0.4,0.4") from None


def _split(path: str, scale: float, hold_out: int, reading: Reading) -> tuple[tuple, tuple]:
    """Photographs to learn from, and those held out."""
    if not 0 < scale <= 1:
        raise InputError(f"--scale {scale:g}: is not in 0 … 1")
    learn, aside = run.photographs(path, scale, hold_out or 2**30, reading)
    if not hold_out:
        return (*aside, *learn), ()
    if not learn:
        raise InputError(f"{path}: no photograph is left to learn from; try --hold-out 0")
    return learn, aside


def _decibels(gaussians: Gaussians, targets) -> float | None:
    """Mean PSNR of the reference's pictures against targets; None without any or for equal ones."""
    from splatcore.golden.reference import render

    found = [
        difference(render(gaussians, each.camera).pixels, each.image, each.name).psnr_db
        for each in targets
    ]
    return float(np.mean(found)) if found and None not in found else None


def facts_of(scene: Scene, model: PackedModel, checkpoints: Checkpoints) -> dict:
    """Sizes, and the steps."""
    original = ply_bytes(len(scene), scene.sh_degree)
    return {
        "original_bytes": original, "bytes": len(model.image),
        "ratio": original / len(model.image), "gaussians": len(model),
        "sh_degree": model.format.sh_degree, "choice": checkpoints.choice,
        "steps": [asdict(s) for s in checkpoints.steps],
    }  # fmt: skip


def _sizes(facts: dict) -> str:
    return f"{facts['bytes']:,} bytes in memory, {facts['file_bytes']:,} in the file"


def _loss(
    scene: Scene, packed: Gaussians, aside, size: tuple[int, int], seed: int, path, reading: Reading
) -> dict:
    """The loss on pictures that were not learned from: photographs, or the scene's own from other
    views, on a path and beside it or all round."""
    from splatcore.model.cameras.capture import teacher_views
    from splatcore.model.cameras.orbit import views_beside
    from splatcore.model.cameras.view import core_of

    original = scene.gaussians()
    if aside:
        before, after = (_decibels(each, aside) for each in (original, packed))
        says = f"{after:.2f} dB on {len(aside)} held-out photographs, {before:.2f} before"
        found = {"against": "photographs", "psnr_db": after, "psnr_db_before": before}
        return found | {"says": says}
    views = teacher_views(original, LOOKED_AT, size, seed + 1, path, near=reading.near_plane)
    after = _own(original, packed, views)
    says = "no difference" if after is None else f"{after:.2f} dB against the scene"
    says += f" on {len(views)} other views"
    found = {"against": "original", "psnr_db": after, "psnr_db_before": None}
    if path:
        there = views_beside(views, core_of(original).middle)
        found["psnr_db_beside"] = {
            name: _own(original, packed, each) for name, each in there.items()
        }
        told = (f"{name} {shown(db, '.2f')}" for name, db in found["psnr_db_beside"].items())
        says += f" of the path, beside it: {', '.join(told)}"
    return found | {"says": says}


def _own(original: Gaussians, packed: Gaussians, views) -> float | None:
    """Mean PSNR against the original's own pictures from views."""
    from splatcore.golden.reference import render

    with progress_bar(f"measuring the loss on {len(views)} views"):
        own = [Target(view, render(original, view).pixels, view.name) for view in views]
        return _decibels(packed, own)
