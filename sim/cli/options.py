"""The command line's application object and the arguments that commands share."""

from pathlib import Path
from typing import Annotated

import typer

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

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene file or generated scene.")
]
SourceArgument = Annotated[
    str, typer.Argument(metavar="SCENE|MODEL", help="Scene file, generated scene or packed model.")
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="FILE[:ID]",
        help="INRIA cameras.json, transforms.json or COLMAP sparse/0; the first camera without "
        "ID. Default: a sensible view of the scene.",
    ),
]
SizeOption = Annotated[
    str | None,
    typer.Option("--size", metavar="WxH", help="Pixels; the camera's intrinsics are scaled."),
]
PresetOption = Annotated[
    str,
    typer.Option(
        "--preset",
        metavar="NAME|FILE",
        help="Machine: DEFAULT, PAPER, TINY or a preset file (TOML; `splatcore fit` writes some).",
    ),
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write results (see docs/json.md).")
]
