"""Bad input of every command: one line of error, and no file is written; help texts."""

import json
import os
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import typer

from splatcore.app.cli.commands import GONE
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app
from splatcore.app.cli.recipe_file import KEYS
from splatcore.model.generate.generate import GENERATORS, generate
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.picture import write_png
from splatcore.study.compression import run as compression_run
from splatcore.study.report.titles import SECTIONS
from tb.helpers.command import check_refused, run, write_scene


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small scene under several names, cameras, packed models, photographs, and
    broken files."""
    folder = tmp_path_factory.mktemp("refused")
    write_scene(folder)
    scene, model, cameras = map(folder.joinpath, ("scene.ply", "scene.splatcore", "cameras.json"))
    assert run("pack", scene, "-o", model, "--camera", cameras) == 0
    image, data, listed = bytearray(model.read_bytes()), scene.read_bytes(), cameras.read_bytes()
    image[1000] ^= 1
    picture = folder / "g.png"
    write_png(picture, np.zeros((16, 16, 3), np.uint8))
    files = {
        "damaged.splatcore": image, "cut.ply": data[:5000], "file": b"", "empty.toml": b"# none\n",
        "less.ply": data.replace(b"property float rot_3\n", b"", 1), "pictures/4.png": data,
        "bare.json": b'[{"id": 0, "width": 4, "height": 4}]', "empty.json": b"[]",
        "plain.toml": b'name = "PLAIN"\nsh_degree = 2\n', "scene.cameras.json": listed,
        "wide.toml": b'name = "WIDE"\nwidth_max = 2048\nheight_max = 2048\n',
        "r.png": picture.read_bytes(), "photos/images/1.png": picture.read_bytes(),
        "photos/cameras.json": listed, "photos/transforms_train.json": listed,
        "photos/colmap/points.ply": listed, "sub/file": b"", "taken/7.png/file": b"",
        "recipe.toml": b"rate = 20\n", "texts.toml": b'steps = "many"\n', "key.toml": b"step = 9\n",
    }  # fmt: skip
    first, second = json.loads(listed)
    views = {
        "slash": [first | {"id": "a/b"}, second | {"id": "a b"}],
        "sizes": [first, second | {"width": 63}], "large": [first, second | {"width": 8000}],
        "low": [first | {"id": 0, "height": 0}], "wide": [first | {"width": 1957, "height": 1091}],
    }  # fmt: skip
    files |= {f"{name}.json": json.dumps(each).encode() for name, each in views.items()}
    garden = generate("garden", 30)
    for degree in (1, 3):
        sh = np.random.default_rng(degree).normal(size=(30, (degree + 1) ** 2, 3)) / 9
        packed, _ = pack(replace(garden, sh=sh), quality="balanced")
        files[f"degree{degree}.splatcore"] = packed.image.tobytes()
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    os.link(scene, folder / "hard.ply")
    os.symlink("scene.ply", folder / "soft.ply")
    return folder


def content(folder: Path) -> dict[str, bytes]:
    """Content of all files below a folder, by path; folders are empty."""
    return {str(p): p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


@pytest.fixture
def unchanged(place, monkeypatch):
    """That folder as the working folder; no test may change it."""
    monkeypatch.chdir(place)
    before = content(place)
    yield
    assert content(place) == before


REFUSED = dict(
    line.split("  =>  ")
    for line in (Path(__file__).parent / "refused.txt").read_text().splitlines()[3:]
    if line and not line.startswith("# ")
)
"""Arguments → pattern of the error message."""


@pytest.mark.parametrize("arguments", REFUSED)
def test_bad_input(unchanged, capsys, arguments):
    check_refused(capsys, arguments, REFUSED[arguments])


def test_every_option_that_is_gone_names_another(unchanged, capsys):
    """The option that is named instead exists, or the key of a recipe."""
    register()
    options = {each for name in ("simulate", "compress") for each in all_options(name)}
    for words, instead in GONE.items():
        command, option = words.rsplit(" ", 1) if "--" in words else ("", "")
        if option:
            check_refused(capsys, f"{command} scene.ply -o a {option} 1", re.escape(instead))
            key = option.removeprefix("--").replace("-", "_")
            assert option in options if command == "render" else key in KEYS


def all_options(name: str) -> list[str]:
    """Names of a command's options."""
    return [each for p in typer.main.get_command(app).commands[name].params for each in p.opts]


@pytest.mark.parametrize(
    "arguments",
    [
        "bench compression garden --out out",
        "compress scene.ply -o m",
        "train . -o m",
    ],
)
def test_without_torch(unchanged, monkeypatch, capsys, arguments):
    monkeypatch.setattr(compression_run, "find_spec", lambda name: None)
    message = r"needs PyTorch: pip install 'splatcore\[compress\]'"
    check_refused(capsys, arguments, message)


PLAIN = "simulate photographs info pack render compare error verilog synth memories cycles"
HELP = dict.fromkeys(["", *PLAIN.split()], ()) | {
    "scene": list(GENERATORS)[:3], "bench": ["sort"], "bench sort": ["--lengths"],
    "soak": ["frames", "faults"], "soak frames": ["--only"],
    "hard": [*HARD, "52 dB"],
    "report": ["make results", "--keep", "--section", "report.html", "needs no network", *SECTIONS],
}  # fmt: skip
"""Commands → words that their help contains."""


@pytest.mark.parametrize("command", HELP)
def test_help(command, capsys):
    assert run(*command.split(), "--help") == 0
    printed = capsys.readouterr().out
    for line, following in pairwise(printed.partition("╭")[0].splitlines()):
        words = (*line.split(), *following.split()[:1])
        assert not line.strip() or not following.strip() or len(" ".join(words)) > 70, line
    text = re.sub(r"\s|│", "", printed)
    assert len(text) > 300 and "--no-run" not in text
    assert all("".join(words.split()) in text for words in HELP[command])
