"""The command line's application object and the arguments that commands share."""

import inspect
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperCommand

from splatcore.model.formats.camera_file import split_id
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.output import (
    check_distinct,
    check_folder,
    check_writable,
    new_folders,
)
from splatcore.sim.common.source import ENGINES, camera_beside, scene_folder
from splatcore.spec.camera import NEAR_LIMITS
from splatcore.spec.config import PRESETS
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.error import InputError

FOLDER = "DIR"
"""What stands for a folder in the help."""


def flowing(text: str) -> str:
    """A text's paragraphs, each as one line."""
    return re.sub(r"(?<=\S)\n(?=\S)", " ", inspect.cleandoc(text))


class Command(TyperCommand):
    """A command that does not run before its outputs are known to be writable and no input of it.

    A parameter of type `Path` is what it writes: a folder if `FOLDER` stands for it in the help,
    else a file, of the type of what stands for it; of A|B the latter with --cameras. A text that
    names a file or folder, with or without :ID, is what it reads. Its help is its docstring, with
    lines as long as the terminal's.
    """

    def __init__(self, *arguments, help: str | None, **options):
        super().__init__(*arguments, help=flowing(help or ""), **options)

    def invoke(self, context: typer.Context):
        values = [(each, context.params.get(each.name)) for each in self.params]
        written = [(each, value) for each, value in values if isinstance(value, Path)]
        which = -1 if context.params.get("cameras") else 0
        stands = {each.name: (each.metavar or "").split("|")[which] for each, _ in written}
        folders = [path for each, path in written if stands[each.name] == FOLDER]
        check_distinct([(each.opts[0], path) for each, path in written], read_by(context.params))
        for each, path in written:
            check_type(each.opts[0], path, Path(stands[each.name]).suffix)
            (check_folder if path in folders else check_writable)(path)
        with new_folders(folders):
            return super().invoke(context)


def check_type(option: str, path: Path, suffix: str):
    """InputError for a file whose name ends like one of another type; it need not have an end."""
    if suffix and path.suffix and path.suffix.lower() != suffix:
        raise InputError(f"{option} {path}: does not end with {suffix}, as its files do")


def read_by(parameters: dict[str, object]) -> Iterator[Path]:
    """Files and folders that a command's parameters name, and those that are read besides."""
    yield scene_folder()
    for value in parameters.values():
        texts = value if isinstance(value, (list, tuple)) else [value]
        for text in (each for each in texts if isinstance(each, str) and each):
            path, _ = split_id(text)
            if os.path.exists(path):
                yield Path(path)
                if beside := camera_beside(path):
                    yield Path(beside)


class App(typer.Typer):
    """An application or a group of `Command`s."""

    def command(self, name: str | None = None, *, cls: type = Command, **options):
        return super().command(name, cls=cls, **options)


app = App(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help=flowing(
        """Splatcore: an open hardware accelerator for 3D Gaussian Splatting.

        SCENE is a scene file (3DGS PLY, compressed PLY, SPZ, .splat, SOG), a packed model where
        that makes sense, or the name of a generated scene (see `splatcore scene --help`).

        Start with:  splatcore render garden -o garden.png
        """
    ),
)


app.callback()(lambda: None)  # without it the name of a command that is alone would be an argument


def argument(kind: type, metavar: str, help: str):
    """A command's argument: type (`Path`: it is written), what stands for it in the help,
    meaning."""
    return Annotated[kind, typer.Argument(metavar=metavar, help=help)]


def option(kind: type, metavar: str | None, help: str, *names: str, **limits):
    """A command's option: type (`Path`: it is written), what stands for its value in the help,
    meaning; its names, where they are not the parameter's; `min` and `max`."""
    return Annotated[kind, typer.Option(*names, metavar=metavar, help=help, **limits)]


SceneArgument = argument(str, "SCENE", "Scene file or generated scene.")
SourceArgument = argument(str, "SCENE|MODEL", "Scene file, generated scene or packed model.")
CameraOption = option(
    str | None,
    "FILE[:ID]",
    "INRIA cameras.json, transforms.json, COLMAP model or a folder with one; the first "
    "camera without ID. Default: a sensible view of the scene.",
    "--camera",
)
CamerasOption = option(
    str | None,
    "FILE[:ID,ID,…]",
    "All cameras of a file, or some of them; ID,ID,… without FILE: of the file beside the scene.",
)
SizeOption = option(
    str | None, "WxH", "Pixels; the camera's intrinsics are scaled with the sides.", "--size"
)
AntialiasedOption = option(
    bool | None,
    None,
    "The scene was trained with opacity compensation, and is rendered with it. Default: as its "
    "file says.",
    "--antialiased/--no-antialiased",
)
NearOption = option(
    float | None,
    "Z",
    f"Near plane: Gaussians of at most this depth are left out. Default: {NEAR_PLANE:g}, as 3DGS.",
    "--near",
    min=NEAR_LIMITS[0],
    max=NEAR_LIMITS[1],
)
AxesOption = option(
    str | None,
    "RUB|RDF|…",
    "Axes of an SPZ file that does not state its own: where x, y and z point, like "
    "right-down-front, as in a PLY. Default: rub, by the format's specification.",
    "--axes",
)
PresetOption = option(
    str,
    "NAME|FILE",
    f"Machine: {', '.join(PRESETS)} or a preset file (TOML; `splatcore fit` writes some).",
    "--preset",
)
QualityOption = option(
    str | None,
    None,
    f"How a scene is packed: {', '.join(QUALITIES)}. Default: the smallest that is good enough.",
)
EngineOption = option(str, None, f"{', '.join(ENGINES)}.")
FolderOption = option(Path, "DIR", "Folder to write into.", "-o")
ModelOption = option(Path, "MODEL.splatcore", "Where to write it.", "-o")
PlainOption = option(
    bool,
    None,
    "Write the bytes of memory as they are, to be loaded straight into DRAM: no coded file.",
    "--plain",
)
JsonOption = option(Path | None, "FILE.json", "Write results (see docs/json.md).", "--json")
