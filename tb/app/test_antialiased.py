"""The antialiasing mark on the command line: printed with its reason, overridden by one option."""

import json
import re
import shutil
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer

from splatcore.app.cli import bench
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app
from splatcore.app.cli.reference import all_commands
from splatcore.app.view import worker
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.sim.frame.picture import write_png
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import open_source, opened
from splatcore.spec.config import PAPER, TINY
from splatcore.spec.error import InputError
from splatcore.study.bench import scenes, sweep
from tb.helpers.command import check_documented, check_refused, load, run

COMMENT = "PLY comment 'SplatRenderMode: mip'"

COMPENSATES = "mine.toml"
"""Preset file of a machine that compensates opacities."""


@pytest.fixture
def place(folder):
    """A folder with one scene, marked and unmarked, and two cameras for each."""
    write_ply("mip.ply", replace(read_scene("scene.ply"), antialiased=True))
    for name in ("scene", "mip"):
        shutil.copy("cameras.json", f"{name}.cameras.json")
    Path(COMPENSATES).write_text('base = "TINY"\nantialiasing = true\n')
    opened.cache_clear()
    sweep.packed_by.cache_clear()
    return folder


@pytest.fixture
def packed(place):
    for name in ("scene", "mip"):
        quality = "--quality faithful --camera cameras.json"
        assert run(f"pack {name}.ply -o {name}.splatcore {quality} --json {name}.json") == 0
    return place


MARKS = {
    "scene.ply": (False, "not stated"),
    "mip.ply": (True, COMMENT),
    "scene.ply --antialiased": (True, "--antialiased"),
    "mip.ply --antialiased": (True, "--antialiased"),
    "mip.ply --no-antialiased": (False, "--no-antialiased"),
    "scene.splatcore": (False, "model's header"),
    "mip.splatcore": (True, "model's header"),
}
"""Arguments → whether opacities are compensated, and the reason."""


def check(found: dict, expected: tuple[bool, str], printed: str):
    """Check the mark and its reason in the JSON keys and in the printed line."""
    assert (found["antialiased"], found["antialiased_by"]) == expected
    text = f"{'yes' if expected[0] else 'no'} ({expected[1]})"
    assert re.search(rf"antialiased:? +{re.escape(text)}", printed), printed


@pytest.mark.parametrize("arguments, expected", MARKS.items())
def test_shown(packed, capsys, arguments, expected):
    """`info`, `render`, `cycles` and `compare` report the mark, printed and in JSON."""
    for command in (
        "info",
        "render -o a.png --camera cameras.json",
        f"render -o a.png --camera cameras.json --engine golden --preset {COMPENSATES}",
        f"cycles --camera cameras.json --preset {COMPENSATES}",
        f"compare reference golden --camera cameras.json --preset {COMPENSATES} --scene",
    ):
        capsys.readouterr()
        assert run(f"{command} {arguments} --json a.json") == 0
        found = load(Path("a.json"))
        found = found["scenes"][arguments.split()[0]] if "scenes" in found else found
        check(found, expected, capsys.readouterr().out)


@pytest.mark.parametrize("name, antialiased", {"scene": False, "mip": True}.items())
def test_pack_keeps_it(packed, name, antialiased):
    found = load(Path(f"{name}.json"))
    assert (found["antialiased"], found["antialiased_by"]) == MARKS[f"{name}.ply"]
    assert open_source(f"{name}.splatcore").model.antialiased == antialiased
    check_documented("## `splatcore pack`", found)


def test_pack_overrides_it(place, capsys):
    for name, option in (("scene", "antialiased"), ("mip", "no-antialiased")):
        words = f"pack {name}.ply -o a.splatcore --camera cameras.json --json a.json"
        capsys.readouterr()
        assert run(f"{words} --quality faithful --{option}") == 0
        check(load(Path("a.json")), (name == "scene", f"--{option}"), capsys.readouterr().out)
        assert open_source("a.splatcore").model.antialiased == (name == "scene")


def test_documented(place, in_turn):
    for command, heading in {
        "info mip.ply": "info",
        "cycles scene.ply --camera cameras.json": "memories` and `splatcore cycles",
        "photographs mip.ply -o new --views 2 --size 32x24": "photographs",
    }.items():
        assert run(f"{command} --json a.json") == 0
        found = load(Path("a.json"))
        check_documented(
            f"## `splatcore {heading}`", [key for key in found if key in "antialiased_by"]
        )


def test_images_have_no_mark(place, capsys):
    write_png("a.png", np.zeros((9, 9, 3), np.uint8))
    assert run("compare a.png a.png --json a.json") == 0
    found = load(Path("a.json"))
    assert found["antialiased"] is None and found["antialiased_by"] is None
    assert "antialiased" not in capsys.readouterr().out


def test_a_machine_that_does_not_compensate(place, capsys):
    """PAPER refuses a marked scene with one line, and renders it once the mark is overridden."""
    words = "cycles mip.ply --camera cameras.json --preset paper"
    check_refused(capsys, words, "PAPER does not compensate opacities; .*--no-antialiased")
    assert run(f"{words} --no-antialiased") == 0


def test_with_all_cameras(packed, in_turn, capsys):
    """The option reaches the worker processes: without it PAPER would refuse the scene."""
    for command in (
        "cycles mip.ply --cameras cameras.json --preset paper",
        "render mip.ply -o new --cameras cameras.json --engine golden --preset paper",
        "compare reference golden --scene mip.ply --cameras cameras.json --preset paper",
    ):
        capsys.readouterr()
        assert run(f"{command} --no-antialiased --json a.json") == 0
        found = load(Path("a.json"))
        check(found, (False, "--no-antialiased"), capsys.readouterr().out)
        for row in found["views"]:
            assert (row["antialiased"], row["antialiased_by"]) == (False, "--no-antialiased")
    check_documented("## `splatcore render`, `cycles` and `compare` with `--cameras`", found)


OF_A_MODEL = """
info mip.splatcore
render mip.splatcore -o a.png
render mip.splatcore -o new --cameras cameras.json
pack mip.splatcore -o a.splatcore
cycles mip.splatcore
cycles mip.splatcore --cameras cameras.json
compare reference golden --scene mip.splatcore
compare reference golden --scene mip.splatcore --cameras cameras.json
error mip.splatcore
power mip.splatcore
fit mip.splatcore --fps 1 -o a.toml
photographs mip.splatcore -o new
join mip.splatcore scene.ply -o a.ply
bench scenes mip.splatcore -o new
bench sweep mip.splatcore -o new
bench ablation mip.splatcore -o new
bench rule mip.splatcore -o new
bench quality mip.splatcore -o new
"""


@pytest.mark.parametrize("option", ["--antialiased", "--no-antialiased"])
def test_refused_with_a_packed_model(packed, capsys, option):
    """A packed model has its own mark: every command refuses the option with one line."""
    message = f"{option}: mip.splatcore: a packed model has its own mark; repack the scene: "
    for line in OF_A_MODEL.strip().splitlines():
        check_refused(capsys, f"{line} {option}", re.escape(message))


def test_every_command_with_a_scene_has_the_option():
    """Commands with a SCENE argument, `scene` and `train` have both options; `report` does not.
    All except `scene` and `train`, which read no scene file, also have --axes."""
    register()
    for name, command in all_commands(typer.main.get_command(app)):
        parameters = command.params
        takes = any(re.search(r"\bSCENE\b(?!\.)", each.metavar or "") for each in parameters)
        takes = (takes or name in ("scene", "train")) and name != "report"
        options = {text for each in parameters for text in each.opts + each.secondary_opts}
        assert ({"--antialiased", "--no-antialiased"} <= options) == takes, name
        assert ("--axes" in options) == (takes and name not in ("scene", "train")), name


@pytest.mark.parametrize("antialiased", [True, False])
def test_views_of_benchmarks(place, monkeypatch, antialiased):
    """Every view of `bench` opens the scene with the override, and its name contains the option:
    results measured with the file's own mark are not reused for it."""
    campaign = bench.Campaign(
        antialiased, output=Path("out"), scene=["mip.ply"], cameras="4", size="64x48",
        axes=None, near=None, lod_pixels=None, max_gaussians=None,
    )  # fmt: skip
    assert campaign.reading == Reading(antialiased)
    views = [*campaign.views([TINY]), campaign.view_of("mip.ply:4", "64x48")]
    own = scenes.views(["mip.ply"], "4", "64x48")[0]
    assert len(views) == 2 and own.open().source.stated["antialiased_by"] == COMMENT
    option = "--antialiased" if antialiased else "--no-antialiased"
    stated = {"antialiased": antialiased, "antialiased_by": option, "notes": [], "near": 0.2}
    for view in views:
        assert view.open().source.stated == stated
        assert view.name.endswith(f" {option}") and repr(view) != repr(own) != own.name
        assert opened(view.scene, view.reading).stated["antialiased"] == antialiased


def test_measured_tasks_have_the_override(place):
    """PAPER does not compensate: it refuses the marked scene unless the view overrides the mark."""
    paper = {"a": PAPER}
    with pytest.raises(InputError, match="PAPER does not compensate"):
        sweep.measure(View("mip.ply", "4", "64x48"), paper)
    assert sweep.measure(View("mip.ply", "4", "64x48", reading=Reading(False)), paper)


def test_generated_and_joined_scenes(place, capsys):
    """Files keep the mark in a comment; scenes with different marks are not joined."""
    assert run("scene garden --count 50 --antialiased -o g.ply") == 0
    assert read_scene("g.ply").mark == COMMENT
    assert run("scene garden --count 50 -o plain.ply") == 0
    assert b"comment" not in Path("plain.ply").read_bytes()
    assert run("join g.ply mip.ply -o a.ply") == 0 and read_scene("a.ply").antialiased
    message = "mip.ply is antialiased, scene.ply is not; choose --antialiased or --no-antialiased"
    check_refused(capsys, "join scene.ply mip.ply -o b.ply", message)
    for option, antialiased in (("--antialiased", True), ("--no-antialiased", False)):
        assert run(f"join scene.ply mip.ply -o b.ply {option}") == 0
        assert read_scene("b.ply").antialiased == antialiased


def test_the_viewer_s_process_has_the_override(place, monkeypatch):
    """The viewer's process opens the scene itself, with the option."""
    studios = []
    monkeypatch.setattr(worker, "Studio", studios.append)
    for module, name in ((worker.os, "setpgrp"), (worker.signal, "signal")):
        monkeypatch.setattr(module, name, lambda *_: None)
    monkeypatch.setattr(worker.output.messages, "quiet", True)

    def end():
        raise EOFError

    ready = threading.Event()
    worker.work("mip.ply", Reading(False), SimpleNamespace(recv=end), None, None, ready)
    assert studios[0].stated["antialiased_by"] == "--no-antialiased"


def test_json_of_many_images(place):
    """`compare` of three images: each entry in JSON has the mark."""
    write_png("a.png", np.zeros((48, 64, 3), np.uint8))
    words = "compare reference a.png reference --scene mip.ply --camera cameras.json"
    assert run(f"{words} --json a.json") == 0
    images = json.loads(Path("a.json").read_text())["images"]
    assert [each["antialiased_by"] for each in images] == [COMMENT, COMMENT]
