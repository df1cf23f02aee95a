"""The commands `train` (photographs to a scene) and `compress` (a scene to a small model)."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from splatcore.app.cli import options
from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.options import SCENE, argument, option
from splatcore.app.cli.recipe_file import KEYS, Pictures, named, read_recipe
from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.recipe import Recipe
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.formats.photographs import Target
from splatcore.model.formats.ply import write_ply
from splatcore.sim.common import output as files
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.table import shown
from splatcore.sim.frame.metric import difference
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.size import parse_size, path_cameras
from splatcore.sim.frame.source import open_source
from splatcore.spec.cache import digest
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import ARRAYS, Gaussians, Scene
from splatcore.study.compression import run
from splatcore.study.compression.steps_table import table_of, trials_of

LEARN = "Pictures to learn from"
TARGET = "Target (at most one)"
TRAINING = "Training"
"""Headings of options in --help."""

WORK = option(
    None, "DIR", "Folder for the state of each step. Default: the output's name + .steps."
)

LOSS_VIEWS = 4  # views for the loss if there are no photographs


@dataclass(frozen=True)
class Targets:
    """The options of targets, of which one at most is given."""

    target_ratio: float | None = option(
        None, "R", "Size of the scene as float32 PLY, divided by R.", panel=TARGET
    )
    target_bytes: int | None = option(None, "N", "At most N bytes in memory.", panel=TARGET)
    target_psnr: float | None = option(
        None, "DB", "Smallest model with at least DB on held-out pictures.", panel=TARGET
    )
    target_fps: float | None = option(
        None, "F", "Best model that reaches F frames per second, by the cycle model.", panel=TARGET
    )
    max_drop: float | None = option(
        None, "DB", "Smallest model that loses at most DB on held-out photographs.", panel=TARGET
    )


@options.command("train")
def train_command(
    folder: str = argument(
        ..., "DIR", "COLMAP model with its photographs in images/, next to the model or above it."
    ),
    output: Path = option(..., "SCENE.ply", "Scene to write."),
    steps: int = option(7000, "N", "Steps of optimisation.", min=1, panel=TRAINING),
    scale: float = option(
        1.0, "S", "Scale of the photographs: 0.5 is half their size.", panel=LEARN
    ),
    hold_out: int = option(
        7, "N", "Hold out every N-th photograph for measuring; 0: none.", min=0, panel=LEARN
    ),
    seed: int = option(
        0,
        "N",
        "Random seed: the same seed gives the same result on a machine.",
        min=0,
        panel=TRAINING,
    ),
    work: Path | None = WORK,
    antialiased: bool = option(
        False,
        None,
        "Train with opacity compensation; the scene file says so and is rendered with it.",
        "--antialiased/--no-antialiased",
        panel=SCENE,
    ),
    near: float | None = options.NEAR,
) -> dict:
    """Train a plain 3DGS scene from photographs.

    The scene is a baseline for `splatcore compress`. Training starts from COLMAP's points,
    densifies, and saves its state every 500 steps: the same command resumes an interrupted run.
    Prints the PSNR on the held-out photographs. Needs the extra `compress`.
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
    console.print(f"{output}: {len(scene)} Gaussians{shown}")
    return facts


@options.command(
    "compress",
    help=f"""{COMMANDS["compress"].summary}

    Reduces harmonics, prunes, quantises, fine-tunes in between, and packs. For a target, trials
    choose degree and number of Gaussians. Learns from photographs (--images) or rendered pictures,
    on a path (--cameras) or all around. Resumes interrupted runs. Needs the extra `compress`.

    --recipe FILE says how; its keys: {", ".join(KEYS)}. See docs/compression.md.
    """,
)
def compress_command(
    targets: Targets,
    reading: Reading,
    scene: str = options.ONE_SCENE,
    output: Path = options.MODEL,
    images: str | None = option(
        None, "DIR", "Photographs: COLMAP folder or transforms.json.", panel=LEARN
    ),
    cameras: str | None = option(
        None,
        "FILE",
        "Cameras from which the scene will be viewed (cameras.json, transforms.json or COLMAP): "
        "learn on their path instead of all around. Without --images.",
        panel=SCENE,
    ),
    size: str = option(
        "1920x1080", "WxH", "Pixels of rendered pictures: as of later use.", panel=SCENE
    ),
    recipe: str | None = option(
        None, "FILE.toml", "How to prune and fine-tune; for the keys see above.", panel=TRAINING
    ),
    work: Path | None = WORK,
    config: Config = options.PRESET,
    plain: bool = options.PLAIN,
) -> dict:
    file, (recipe, pictures) = recipe, read_recipe(recipe, vars(targets))
    run.check_installed()
    if targets.max_drop is not None and images is None:
        raise InputError("--max-drop: needs photographs (--images); else choose --target-psnr")
    pixels, seed = parse_size(size), recipe.seed
    if pictures.beside != Pictures.beside and not cameras:
        raise InputError(f"{file}: beside: goes with --cameras")
    original = _opened(scene, reading)
    with named(file):
        recipe.check(original, config)
    path = reading.seen(path_cameras(cameras, size) if cameras and not images else ())
    if images:
        with named(file):
            learn, aside = _split(images, pictures.scale, pictures.hold_out, reading)
    else:
        learn, aside = _own_pictures(original, path, pixels, seed, pictures, reading), ()
    place = work or output.with_name(output.name + ".steps")
    checkpoints = Checkpoints(place, _key(original, learn, recipe, config))
    model = run.compressed(original, learn, recipe, checkpoints, config, scene)
    files.write(output, data := file_bytes(model, plain))
    facts = {"scene": scene, "model": str(output), "file_bytes": len(data)}
    facts |= facts_of(original, model, checkpoints)
    _print_steps(checkpoints, facts)
    facts |= _loss(original, model.gaussians(), aside, pixels, seed, path, reading)
    line = f"{facts['ratio']:.1f} times smaller: {_sizes(facts)}; {facts.pop('line')}"
    console.print(f"{facts['model']}: {line}")
    return facts


def _print_steps(checkpoints: Checkpoints, facts: dict):
    """Print the steps, and the trials if there was a choice."""
    if facts["choice"]:
        trials_of(facts["choice"]).print()
    table_of(checkpoints, facts["original_bytes"]).print()


def _key(scene: Scene, learn: tuple, recipe: Recipe, config: Config) -> str:
    """Return the key of a compression's checkpoints: a digest of everything that changes its
    result. Rendered pictures are represented by their cameras."""
    arrays = [np.asarray(getattr(scene, name), np.float64) for name in ARRAYS]
    seen = [each if isinstance(each, Target) else each.camera for each in learn]
    mark = " antialiased" if scene.antialiased else ""
    return f"{digest([arrays, seen])}{mark} {recipe!r} {config!r}"


def _opened(path: str, reading: Reading) -> Scene:
    """Read a scene; raise InputError for a packed model."""
    with progress_bar(f"reading {path}"):
        return open_source(path, reading).unpacked


def _own_pictures(
    scene: Scene, path, size: tuple[int, int], seed: int, pictures: Pictures, reading: Reading
) -> tuple:
    """Render the pictures to learn from, including those of the path's cameras."""
    from splatcore.model.compress.teacher import teacher_targets  # needs PyTorch

    views, beside, near = pictures.views, pictures.beside, reading.near_plane
    learn = teacher_targets(scene, views, size, seed, path, beside, near)
    return learn + run.pictures_at(scene, path, size) if path else learn


def _split(path: str, scale: float, hold_out: int, reading: Reading) -> tuple[tuple, tuple]:
    """Return the photographs to learn from and the held-out ones."""
    if not 0 < scale <= 1:
        raise InputError(f"--scale {scale:g}: is not in 0 … 1")
    learn, aside = run.photographs(path, scale, hold_out or 2**30, reading)
    if not hold_out:
        return (*aside, *learn), ()
    if not learn:
        raise InputError(f"{path}: no photograph is left to learn from; try --hold-out 0")
    return learn, aside


def _decibels(gaussians: Gaussians, targets) -> float | None:
    """Return the mean PSNR of the reference's pictures against targets; None if there are no
    targets or a picture is equal to its target."""
    from splatcore.golden.reference import render

    found = [
        difference(render(gaussians, each.camera).pixels, each.image, each.name).psnr_db
        for each in targets
    ]
    return float(np.mean(found)) if found and None not in found else None


def facts_of(scene: Scene, model: PackedModel, checkpoints: Checkpoints) -> dict:
    """Return the sizes and the steps of a compression."""
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
    """Measure the loss on pictures that were not used for training: held-out photographs, or
    pictures of the original scene from other views. "line": the loss as text."""
    from splatcore.model.cameras.capture import teacher_views
    from splatcore.model.cameras.orbit import views_beside
    from splatcore.model.cameras.view import core_of

    original = scene.gaussians()
    if aside:
        before, after = (_decibels(each, aside) for each in (original, packed))
        line = f"{after:.2f} dB on {len(aside)} held-out photographs, {before:.2f} before"
        found = {"against": "photographs", "psnr_db": after, "psnr_db_before": before}
        return found | {"line": line}
    views = teacher_views(original, LOSS_VIEWS, size, seed + 1, path, near=reading.near_plane)
    after = _own(original, packed, views)
    line = "no difference" if after is None else f"{after:.2f} dB against the scene"
    line += f" on {len(views)} other views"
    found = {"against": "original", "psnr_db": after, "psnr_db_before": None}
    if path:
        there = views_beside(views, core_of(original).middle)
        found["psnr_db_beside"] = {
            name: _own(original, packed, each) for name, each in there.items()
        }
        parts = (f"{name} {shown(db, '.2f')}" for name, db in found["psnr_db_beside"].items())
        line += f" of the path, off the path: {', '.join(parts)}"
    return found | {"line": line}


def _own(original: Gaussians, packed: Gaussians, views) -> float | None:
    """Return the mean PSNR of the packed model's pictures against the original scene's."""
    from splatcore.golden.reference import render

    with progress_bar(f"measuring the loss on {len(views)} views"):
        own = [Target(view, render(original, view).pixels, view.name) for view in views]
        return _decibels(packed, own)
