"""The options of the commands `train` and `compress`."""

from pathlib import Path

from splatcore.app.cli.options import OUTPUT, SCENE, argument, option

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
RecipeOption = option(
    str | None,
    "FILE.toml",
    "How to prune and fine-tune; for the keys see above.",
    "--recipe",
    panel=TRAINING,
)
DropOption = option(
    float | None,
    "DB",
    "Smallest model that loses at most DB on held-out photographs.",
    panel=TARGET,
)

StepsOption = option(int, "N", "Steps of optimisation.", min=1, panel=TRAINING)
SeedOption = option(
    int,
    "N",
    "Random seed: the same seed gives the same result on a machine.",
    min=0,
    panel=TRAINING,
)
