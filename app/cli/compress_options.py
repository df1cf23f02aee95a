"""The options of the commands `train` and `compress`."""

from pathlib import Path

from splatcore.app.cli.options import MACHINE, OUTPUT, SCENE, argument, option
from splatcore.model.pack.quality import COMPACT, INDEXED, STEPPED
from splatcore.study.compression import run

LEARN = "Pictures to learn from"
TARGET = "Target (at most one)"
TRAINING = "Training"
"""Headings of options in --help."""

FolderArgument = argument(
    str, "DIR", "COLMAP model with its photographs in images/, next to the model or above it."
)
OutputOption = option(Path, "SCENE.ply", "Scene to write.", "-o", panel=OUTPUT)
WorkOption = option(
    Path | None,
    "DIR",
    "Folder for the state of each step. Default: the output's name + .steps.",
    panel=OUTPUT,
)

CamerasOption = option(
    str | None,
    "FILE",
    "Cameras from which the scene will be viewed (cameras.json, transforms.json or COLMAP): learn "
    "on their path instead of all around. Without --images.",
    panel=SCENE,
)
SizeOption = option(str, "WxH", "Pixels of rendered pictures: as of later use.", panel=SCENE)
TrainedAntialiasedOption = option(
    bool,
    None,
    "Train with opacity compensation; the scene file says so and is rendered with it.",
    panel=SCENE,
)

ImagesOption = option(
    str | None, "DIR", "Photographs: COLMAP folder or transforms.json.", panel=LEARN
)
ViewsOption = option(
    int, "N", "Number of pictures to render, without --images.", min=1, panel=LEARN
)
BesideOption = option(
    float | None,
    "S",
    "With --cameras: share of the views off the path, up to 15° aside, at 0.8 to 1.25 times its "
    f"distance. Default: {run.BESIDE_SHARE:g}.",
    min=0,
    max=1,
    panel=LEARN,
)
ScaleOption = option(float, "S", "Scale of the photographs: 0.5 is half their size.", panel=LEARN)
HoldOutOption = option(
    int, "N", "Hold out every N-th photograph for measuring; 0: none.", min=0, panel=LEARN
)

RatioOption = option(
    float | None, "R", "Size of the scene as float32 PLY, divided by R.", panel=TARGET
)
BytesOption = option(int | None, "N", "At most N bytes in memory.", panel=TARGET)
PsnrOption = option(
    float | None, "DB", "Smallest model with at least DB on held-out pictures.", panel=TARGET
)
FpsOption = option(
    float | None,
    "F",
    "Best model that reaches F frames per second, by the cycle model.",
    panel=TARGET,
)
DropOption = option(
    float | None,
    "DB",
    "Smallest model that loses at most DB on held-out photographs.",
    panel=TARGET,
)

StepsOption = option(int, "N", "Steps of optimisation.", min=1, panel=TRAINING)
TuneStepsOption = option(
    int,
    "N",
    "Fine-tuning steps after each pruning; a --target prunes once and takes the steps of all.",
    min=0,
    panel=TRAINING,
)
ScheduleOption = option(
    str,
    "R,R,…",
    "Shares of the Gaussians that successive prunings remove; a --target decides by itself.",
    panel=TRAINING,
)
DistillOption = option(
    int, "N", "Steps per removed degree of harmonics, after least squares.", min=0, panel=TRAINING
)
QuantizeOption = option(
    int, "N", "Steps with the numbers of the packed model.", min=0, panel=TRAINING
)
RateOption = option(float, "S", "Factor on the default learning rates.", panel=TRAINING)
OrderOption = option(
    str, "ORDER", "distill-first: reduce harmonics before pruning; or prune-first.", panel=TRAINING
)
SeedOption = option(
    int,
    "N",
    "Random seed: the same seed gives the same result on a machine.",
    min=0,
    panel=TRAINING,
)

DegreeOption = option(
    int | None,
    "N",
    "Degree of the model's harmonics; from 2 on it is packed in steps. Default: chosen by trials.",
    min=0,
    max=3,
    panel=MACHINE,
)
QualityOption = option(
    str | None,
    "NAME",
    f"Packing. Degree 2 or 3: {' or '.join(STEPPED)} (default {STEPPED[0]}); degree 0 or 1: "
    f"{' or '.join(INDEXED)} (default: chosen for a target, else {COMPACT}).",
    panel=MACHINE,
)
