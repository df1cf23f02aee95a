"""The command line's application object and the options that commands share."""

import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import Field, dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, get_args, get_type_hints

import typer
from typer.core import TyperCommand

from splatcore.app.cli.commands import COMMANDS, GROUPS, example
from splatcore.model.formats.camera_file import split_id
from splatcore.model.formats.model_file import is_packed
from splatcore.model.pack.quality import LEAST_DB, QUALITIES, UNLEARNED
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.option import SCENE, argument, option
from splatcore.sim.common.output import (
    check_distinct,
    check_folder,
    check_writable,
    new_folders,
    write_json,
)
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import ENGINES, Shot
from splatcore.sim.frame.source import camera_beside, scene_folder
from splatcore.spec.config import PRESETS
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

FOLDER = "DIR"
"""Placeholder for a folder in --help."""

MACHINE = "Machine and packing"
OUTPUT = "Output"
RTL = "RTL simulation"
PICTURE = "Picture"
"""Headings of options in --help that several commands have."""


def flowing(text: str) -> str:
    """Join the lines of each paragraph of a text."""
    return re.sub(r"(?<=\S)\n(?=\S)", " ", inspect.cleandoc(text))


class Command(TyperCommand):
    """A command that checks its outputs before it runs: writable, and no input among them.

    A parameter of type `Path` is an output: a folder if its placeholder in the help is `FOLDER`,
    else a file with the placeholder's suffix. Of a placeholder A|B, B holds with --cameras. A text
    parameter that names a file or folder, with or without :ID, is an input.
    """

    def __init__(self, *arguments, help: str | None, **options):
        super().__init__(*arguments, help=flowing(help or ""), **options)

    def invoke(self, context: typer.Context):
        values = [(each, context.params.get(each.name)) for each in self.params]
        written = [(each, value) for each, value in values if isinstance(value, Path)]
        choice = -1 if context.params.get("cameras") else 0
        metavars = {each.name: (each.metavar or "").split("|")[choice] for each, _ in written}
        folders = [path for each, path in written if metavars[each.name] == FOLDER]
        check_distinct([(each.opts[0], path) for each, path in written], inputs_of(context.params))
        for each, path in written:
            suffix = Path(metavars[each.name]).suffix
            if suffix and path.suffix and path.suffix.lower() != suffix:  # it may have none
                raise InputError(f"{each.opts[0]} {path}: must end in {suffix}")
            (check_folder if path in folders else check_writable)(path)
        with new_folders(folders):
            return super().invoke(context)


def listed(names: Iterable[str]) -> str:
    """Return names as text for a help."""
    return ", ".join(names)


def check_quality(quality: str | None, *sources: str):
    """Raise InputError for an unknown --quality, and for one that is given for a packed model.

    sources: files of scenes and models, or names of generated scenes
    """
    if quality is None:
        return
    check_known("--quality", QUALITIES, quality)
    for text in filter(is_packed, sources):
        raise InputError(f"--quality {quality}: {text} is packed already")


def inputs_of(parameters: dict[str, object]) -> Iterator[Path]:
    """Yield the files and folders that a command reads: those its parameters name, the camera files
    next to scenes, and the folder of scenes."""
    yield scene_folder()
    for value in parameters.values():
        texts = value if isinstance(value, (list, tuple)) else [value]
        for text in (each for each in texts if isinstance(each, str) and each):
            path, _ = split_id(text)
            if os.path.exists(path):
                yield Path(path)
                if cameras := camera_beside(path):
                    yield Path(cameras)


app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=f"Example:  {example('')}",
    help=flowing(
        """Splatcore: an open hardware accelerator for 3D Gaussian Splatting.

        SCENE is a scene file (3DGS PLY, compressed PLY, SPZ, glTF, USD, .splat, KSPLAT, SOG) or
        folder (SOG), the output folder of INRIA's training, or the name of a generated scene (see
        `splatcore scene --help`); MODEL is a packed model (.splatcore).
        """
    ),
)


app.callback()(lambda: None)  # without it a single command would have no name on the command line

groups = {
    name: typer.Typer(no_args_is_help=True, help=group.help, epilog=f"Example:  {example(name)}")
    for name, group in GROUPS.items()
}
for name, group in GROUPS.items():
    app.add_typer(groups[name], name=name, rich_help_panel=group.purpose)


def command(name: str, *, cls: type = Command, **options) -> Callable:
    """Register a function as the command of this name, with its entry of `COMMANDS`."""
    entry, (group, _, last) = COMMANDS[name], name.rpartition(" ")
    options |= {"short_help": entry.summary, "rich_help_panel": entry.purpose}
    options["epilog"] = f"Example:  {example(name)}"
    register = groups.get(group, app).command(last, cls=cls, **options)
    return lambda function: register(spread(function)) and function


def typed(name: str, kind: object, about: Field) -> object:
    """Return the type of a declared option or argument, as typer takes it.

    Outputs have their own heading in --help, and the option of a command's `output` is -o.
    """
    given = about.metadata["about"]
    if (names := about.metadata.get("names")) is None:
        return Annotated[kind, typer.Argument(**given)]
    if given["rich_help_panel"] is None and Path in (kind, *get_args(kind)):
        given = given | {"rich_help_panel": OUTPUT}
    kind = str if about.metadata["read"] else kind
    names = names or ["-o" if name == "output" else f"--{name.replace('_', '-')}"]
    return Annotated[kind, typer.Option(*names, **given)]


def declared(group: type) -> dict[str, tuple[object, Field]]:
    """Return types and declarations of a dataclass by name; those of a derived class come first."""
    names = [name for kind in group.__mro__ for name in vars(kind).get("__annotations__", ())]
    kinds, known = get_type_hints(group), group.__dataclass_fields__
    return {name: (kinds[name], known[name]) for name in dict.fromkeys(names)}


JSON = option(None, "FILE.json", "Write the results (see docs/json.md).")


class Wrong(dict):
    """The result of a command that found something wrong: its exit status is 1."""


def result(facts: dict, wrong: object) -> dict:
    """Return the result of a command."""
    return Wrong(facts) if wrong else facts


def spread(function: Callable) -> Callable:
    """Return the function with the parameters that typer takes.

    A parameter's default is its declaration by `sim.common.option`; one without is a dataclass
    of these, and becomes one parameter for each field. A function that returns its result gets the
    option --json.
    """
    found, groups, signature = {}, {}, inspect.signature(function, eval_str=True)
    for each in signature.parameters.values():
        if each.default is each.empty:
            groups[each.name] = each.annotation
            found |= declared(each.annotation)
        else:
            found[each.name] = each.annotation, each.default
    if returns := signature.return_annotation is not signature.empty:
        found["json"] = Path | None, JSON
    parameters = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=about.default,
            annotation=typed(name, kind, about),
        )
        for name, (kind, about) in found.items()
    ]  # fmt: skip

    @wraps(function)
    def call(**values):
        for name, (_, about) in found.items():
            if read := about.metadata.get("read"):
                values[name] = read(values[name])
        for name, group in groups.items():
            values[name] = group(**{each.name: values.pop(each.name) for each in fields(group)})
        path = values.pop("json") if returns else None
        made = function(**values)
        write_json(path, made)
        if isinstance(made, Wrong):
            raise typer.Exit(1)

    call.__signature__ = inspect.Signature(parameters)
    call.__annotations__ = {each.name: each.annotation for each in parameters}
    return call


ONE_SCENE = argument(..., "SCENE", "Scene file or generated scene.")
SOURCE = argument(..., "SCENE|MODEL", "Scene file, generated scene or packed model.")
CAMERA = (
    "Camera from a cameras.json, transforms.json or COLMAP model, or a folder with one; without ID "
    "the first. Default: the first camera"
)
"""Help of --camera, without where the default is from."""


@dataclass(frozen=True)
class Viewing(Reading):
    """The options of a scene and one view of it."""

    camera: str | None = option(
        None, "FILE[:ID]", f"{CAMERA} of a training folder, else a generated view.", panel=SCENE
    )
    size: str | None = option(
        None, "WxH", "Pixels of the picture; the camera's intrinsics are scaled to it.", panel=SCENE
    )

    def open(self, scene: str, **more) -> Shot:
        """Open the scene and its view. more: other fields of the frame"""
        return Shot.open(scene, self.camera_of(scene), self.size, self.reading, **more)

    def camera_of(self, scene: str) -> str | None:
        """The camera's file and ID; None: the scene's own, else a generated view."""
        return self.camera


@dataclass(frozen=True)
class Cameras(Viewing):
    """The options of a scene and one or many views of it."""

    cameras: str | None = option(
        None,
        "FILE[:ID,ID,…]",
        "All cameras of a file, or these; ID,ID,… without FILE: of the camera file next to the "
        "scene.",
        panel=SCENE,
    )


@dataclass(frozen=True)
class NextCameras(Cameras):
    """The same, with the camera file next to the scene as default."""

    camera: str | None = option(
        None,
        "FILE[:ID]",
        f"{CAMERA} of the camera file next to the scene, else a generated view.",
        panel=SCENE,
    )

    def camera_of(self, scene: str) -> str | None:
        return self.camera or camera_beside(scene)


ANTIALIASED, NEAR = (Reading.__dataclass_fields__[name] for name in ("antialiased", "near"))
PRESET = option(
    "DEFAULT",
    "NAME|FILE",
    f"Machine: {', '.join(PRESETS)}, or a TOML file as written by `splatcore fit`.",
    "--preset",
    panel=MACHINE,
    read=find_preset,
)
SMALLEST = (
    f"Default: the smallest of {', '.join(UNLEARNED)} that keeps {LEAST_DB:g} dB against the scene"
)
"""The quality that is chosen; the caller adds the views."""
QUALITY = option(
    None,
    "NAME",
    f"Packing of a scene: {', '.join(QUALITIES)}. {SMALLEST} in the view.",
    panel=MACHINE,
)
ENGINE = option("reference", "NAME", f"{', '.join(ENGINES)}.", panel=MACHINE)
NEW_FOLDER = option(..., "DIR", "Folder to write into.")
MODEL = option(..., "MODEL.splatcore", "Packed model to write.")
PLAIN = option(
    False,
    None,
    "Write the plain bytes of DRAM instead of a coded file, for software that loads them directly.",
    panel=OUTPUT,
)
SCHEDULER = option(
    None,
    "ADDRESS",
    "Dask scheduler, like tcp://host:8786, whose workers do the work; they must find the scene "
    "files at the same paths. Default: one process per core of this computer.",
)
KEPT_FOLDER = option(
    ..., "DIR", "Folder for results; results already there are kept.", "-o", "--out"
)
