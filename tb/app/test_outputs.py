"""Outputs that overwrite an input, coincide, or cannot be written: refused by every command."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer

from splatcore.app.cli.main import register
from splatcore.app.cli.options import App, Command, app
from splatcore.sim.frame.picture import write_png
from splatcore.spec.error import InputError
from tb.helpers.command import check_refused, run, write_scene


def content(folder: Path) -> dict[str, bytes]:
    """Content of all files below a folder, by path; folders are empty."""
    return {str(p): p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A working folder with a scene under three names, cameras and pictures; no test may change
    it."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    os.link("scene.ply", "hard.ply")
    os.symlink("scene.ply", "soft.ply")
    shutil.copy("cameras.json", "scene.cameras.json")
    (tmp_path / "sub").mkdir()
    (tmp_path / "photos" / "images").mkdir(parents=True)
    (tmp_path / "photos" / "colmap").mkdir()
    for name in ("cameras.json", "transforms_train.json", "colmap/points.ply"):
        shutil.copy("cameras.json", f"photos/{name}")
    (tmp_path / "file").touch()
    for name in ("g.png", "r.png", "photos/images/1.png"):
        write_png(name, np.zeros((16, 16, 3), np.uint8))
    before = content(tmp_path)
    yield tmp_path
    assert content(tmp_path) == before


CLASHES = {
    "pack scene.ply -o scene.ply": "scene.ply: -o would overwrite scene.ply, an input",
    "pack scene.ply -o sub/../scene.ply": "-o would overwrite scene.ply",
    "pack scene.ply -o hard.ply": "hard.ply: -o would overwrite scene.ply",
    "pack scene.ply -o soft.ply": "soft.ply: -o would overwrite scene.ply",
    "pack soft.ply -o hard.ply": "hard.ply: -o would overwrite soft.ply",
    "render scene.ply -o scene.ply": "-o would overwrite scene.ply",
    "render scene.ply --engine rtl -o scene.ply": "-o would overwrite scene.ply",
    "render scene.ply -o a.png --json a.png": "a.png: -o and --json name the same file",
    "render scene.ply -o a.png --json sub/../a.png": "-o and --json name the same file",
    "render scene.ply --camera cameras.json:4 -o a.png --json cameras.json": (
        "--json would overwrite cameras.json"
    ),
    "render scene.ply -o a.png --heat-map a.png": "-o and --heat-map name the same file",
    "render one --engine rtl --frames 2 -o a.png --error-map a-001.png": "a-001.png: ",
    "info scene.ply --json scene.ply": "--json would overwrite scene.ply",
    "cycles one scene.ply --json scene.ply": "--json would overwrite scene.ply",
    "cycles scene.ply --json scene.cameras.json": "overwrite scene.cameras.json, an input",
    "compare g.png r.png -o g.png": "g.png: -o would overwrite g.png",
    "compare g.png r.png -o r.png": "r.png: -o would overwrite r.png",
    "compare reference golden --scene scene.ply --json scene.ply": "overwrite scene.ply",
    "error scene.ply -o a.png --json a.png": "-o and --json name the same file",
    "error --scenes . --json scene.cameras.json": "--json would overwrite scene.cameras.json",
    "fit scene.ply --fps 9 --cameras cameras.json:4,7 -o a.toml --json cameras.json": (
        "--json would overwrite cameras.json"
    ),
    "scene garden -o a.ply --cameras a.ply": "-o and --cameras name the same file",
    "photographs scene.ply -o photos": "photos: is not empty",
    "photographs scene.ply -o .": ".: is not empty",
    "photographs scene.ply -o scene.ply": "-o would overwrite scene.ply",
    "photographs scene.ply -o a --json a": "a: -o and --json name the same file",
    "photographs scene.ply -o a --cameras cameras.json --json cameras.json": (
        "--json would overwrite cameras.json"
    ),
    "train photos -o photos/cameras.json": "-o would overwrite photos/cameras.json",
    "train photos -o photos/transforms_train.json": "would overwrite photos/transforms_train.json",
    "train photos -o photos/colmap/points.ply": "-o would overwrite photos/colmap/points.ply",
    "train photos -o photos/images/1.png": "-o would overwrite photos/images/1.png",
    "power scene.ply --json scene.ply": "--json would overwrite scene.ply",
    "memories --preset file --json file": "--json would overwrite file",
    "bench sort -o out --json out": "-o and --json name the same file",
}  # fmt: skip
"""Arguments → part of the error message."""


@pytest.mark.parametrize("arguments", CLASHES)
def test_nothing_is_overwritten_unasked(place, capsys, arguments):
    check_refused(capsys, arguments, CLASHES[arguments])


UNWRITABLE = {
    "verilog -o file": "file: is not a folder",
    "registers -o file": "file: is not a folder",
    "example -o file": "file: is not a folder",
    "registers -o file/x": "file/x: folder .* does not exist",
    "report -o file": "file: is not a folder",
    "bench ablation one -o file": "file: is not a folder",
    "bench sort -o file": "file: is not a folder",
    "coverage sub --json none/a.json": "none/a.json: folder .* does not exist",
    "soak frames -o file": "file: is not a folder",
    "soak faults -o file/x": "file/x: folder .* does not exist",
    "bench compression one -o file": "file: is not a folder",
    "photographs scene.ply -o file": "file: is not a folder",
    "photographs scene.ply -o none/a": "none/a: folder .* does not exist",
    "photographs scene.ply -o sub --json none/a.json": "none/a.json: folder .* does not exist",
    "compress scene.ply -o m --work file": "file: is not a folder",
    "train photos -o s.ply --work file": "file: is not a folder",
    "render one -o file/x.png": "file/x.png: folder .* does not exist",
    "render one -o sub": "sub: is a folder",
    "render one -o /dev/null": "/dev/null: is not a file",
    "info one --json none/a.json": "none/a.json: folder .* does not exist",
}


@pytest.mark.parametrize("arguments", UNWRITABLE)
def test_unwritable_outputs_are_refused(place, capsys, arguments):
    check_refused(capsys, arguments, UNWRITABLE[arguments])


def commands(application: typer.Typer):
    """Yield all commands of an application and of its groups."""
    group = typer.main.get_command(application)
    waiting = list(group.commands.values())
    while waiting:
        command = waiting.pop()
        if hasattr(command, "commands"):
            waiting += command.commands.values()
        else:
            yield command


def test_every_command_is_checked():
    register()
    assert len(found := list(commands(app))) > 20
    assert all(isinstance(command, Command) for command in found)


@pytest.mark.parametrize("fault", [KeyboardInterrupt, InputError("no"), RuntimeError("no")])
def test_a_new_empty_folder_is_removed(tmp_path, monkeypatch, fault):
    """The checks and the clean-up apply to any command, even one defined here."""
    from splatcore.app.cli.options import FolderOption, JsonOption

    own = App()

    @own.command()
    def make(output: FolderOption, json: JsonOption = None, keep: bool = False):
        (output / "parts").mkdir(parents=True)
        if keep:
            (output / "kept").touch()
        raise fault

    monkeypatch.chdir(tmp_path)
    error = type(fault) if isinstance(fault, Exception) else fault
    with pytest.raises((error, SystemExit)):
        own(["-o", "new"])
    assert not Path("new").exists()
    with pytest.raises(InputError, match="the same file"):
        own(["-o", "new", "--json", "new"])
    with pytest.raises((error, SystemExit)):
        own(["-o", "new", "--keep"])
    assert Path("new/kept").exists() and not Path("new/parts").exists()
    Path("old").mkdir()
    with pytest.raises((error, SystemExit)):
        own(["-o", "old"])
    assert Path("old").exists()


SCENES = {
    "nope.ply": "nope.ply: No such file",
    "file": "file: is empty",
    "g.png": "g.png: is not a PLY",
}


@pytest.mark.parametrize("command", ["sweep", "ablation", "quality", "rule", "scenes"])
@pytest.mark.parametrize("scene", SCENES)
def test_benchmarks_refuse_bad_scenes(place, capsys, command, scene):
    check_refused(capsys, f"bench {command} one {scene} -o wk", SCENES[scene])


def test_a_campaign_without_a_result_leaves_none(tmp_path, monkeypatch, capsys):
    """A scene cut off after its header: one line for it, one for the campaign, and no file."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    Path("cut.ply").write_bytes(Path("scene.ply").read_bytes()[:5000])
    assert run("bench rule cut.ply -o wk --size 32x32") == 2
    printed = capsys.readouterr()
    why, end = printed.err.splitlines()
    assert not printed.out and "cut.ply" in why and end == "error: rule: all measurements failed"
    assert not Path("wk").exists()
