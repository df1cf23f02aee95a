"""The command line's application object and the arguments that commands share."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.model.pack.pack import QUALITIES
from splatcore.sim.common.source import ENGINES

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help="""Splatcore: an open hardware accelerator for 3D Gaussian Splatting.

    SCENE is a scene file (3DGS PLY, compressed PLY, SPZ, .splat, SOG), a packed model where that
    makes sense, or the name of a generated scene (see `splatcore scene --help`).

    Start with:  splatcore render garden -o garden.png
    """,
)


app.callback()(lambda: None)  # without it the name of a command that is alone would be an argument


def argument(kind: type, metavar: str, help: str):
    """A command's argument: type, what stands for it in the help, meaning."""
    return Annotated[kind, typer.Argument(metavar=metavar, help=help)]


def option(kind: type, metavar: str | None, help: str, *names: str, **limits):
    """A command's option: type, what stands for its value in the help, meaning; its names, where
    they are not the parameter's; `min` and `max`."""
    return Annotated[kind, typer.Option(*names, metavar=metavar, help=help, **limits)]


SceneArgument = argument(str, "SCENE", "Scene file or generated scene.")
SourceArgument = argument(str, "SCENE|MODEL", "Scene file, generated scene or packed model.")
CameraOption = option(
    str | None,
    "FILE[:ID]",
    "INRIA cameras.json, transforms.json or COLMAP sparse/0; the first "
    "camera without ID. Default: a sensible view of the scene.",
    "--camera",
)
CamerasOption = option(str | None, "FILE[:ID,ID,…]", "All cameras of a file, or some of them.")
SizeOption = option(str | None, "WxH", "Pixels; the camera's intrinsics are scaled.", "--size")
PresetOption = option(
    str,
    "NAME|FILE",
    "Machine: DEFAULT, PAPER, TINY or a preset file (TOML; `splatcore fit` writes some).",
    "--preset",
)
QualityOption = option(
    str | None,
    None,
    f"How a scene is packed: {', '.join(QUALITIES)}. Default: the smallest that is good enough.",
)
EngineOption = option(str, None, f"{', '.join(ENGINES)}.")
FolderOption = option(Path, "DIR", "Folder to write into.", "-o")
ModelOption = option(Path, "MODEL", "Where to write it.", "-o")
JsonOption = option(Path | None, "FILE", "Write results (see docs/json.md).", "--json")
