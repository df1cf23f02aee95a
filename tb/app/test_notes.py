"""Notes on scene files, and `--axes`: every command that opens a scene prints each note once."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatcore
from splatcore.app.cli.view import setting_of
from splatcore.app.view import text
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import open_source, opened
from splatcore.sim.frame.unseen import axes_note
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from tb.helpers.command import check_refused, load, run
from tb.helpers.scene_file import spz_of

UNSTATED = "the SPZ file does not state its axes; read as RUB, the format's default"


@pytest.fixture
def place(folder):
    """A folder with one scene as PLY and as SPZ without and with stated axes, and cameras for
    each."""
    scene = read_scene("scene.ply")
    scene = replace(scene, scale=np.clip(scene.scale, 0.005, 300), sh=np.clip(scene.sh, -0.9, 0.9))
    write_ply("scene.ply", scene)
    Path("open.spz").write_bytes(spz_of(scene))
    Path("stated.spz").write_bytes(spz_of(scene, 6))
    for name in ("scene", "open", "stated"):
        shutil.copy("cameras.json", f"{name}.cameras.json")
    opened.cache_clear()
    return folder


COMMANDS = """
render SCENE -o a.png --camera cameras.json
render SCENE -o a.png --camera cameras.json --engine golden --preset tiny
render SCENE -o new --cameras cameras.json
pack SCENE -o a.splatcore --quality faithful --camera cameras.json
cycles SCENE --camera cameras.json --preset tiny
cycles SCENE --cameras cameras.json --preset tiny
compare reference golden --scene SCENE --camera cameras.json --preset tiny
compare reference golden --scene SCENE --cameras cameras.json --preset tiny
photographs SCENE -o new --views 2 --size 32x24
error SCENE --size 32x24 --preset tiny
join SCENE SCENE -o a.ply
bench ablation SCENE -o new --size 32x24 --preset tiny
"""


@pytest.mark.parametrize("command", COMMANDS.strip().splitlines())
def test_printed_once(place, in_turn, capsys, command):
    """Also by a command that reads a file twice or once per view, and by `bench`."""
    words = command.replace("SCENE", "open.spz")
    takes = " ".join(command.split()[: 2 if command.startswith("bench") else 1])
    json = "" if takes in ("join", "bench ablation") else " --json a.json"
    assert run(words + json) == 0
    err = " ".join(capsys.readouterr().err.split())
    assert err.count("does not state its axes") == 1, err
    assert f"open.spz: {UNSTATED}" in err
    if json and takes != "error":
        found = load(Path("a.json"))
        assert found.get("scenes", {"": found}).popitem()[1]["notes"][0].startswith(UNSTATED)


PACKS = [line for line in COMMANDS.strip().splitlines() if re.match("pack|cycles|.* golden", line)]


@pytest.mark.parametrize("command", [*PACKS, "error SCENE --size 32x24 --preset tiny"])
def test_losses_of_packing_are_printed_once(place, in_turn, capsys, command):
    """By every command that packs, for one view and for many; `--json` has them, too."""
    scene = read_scene("scene.ply")
    scene.scale[3] = np.exp(44)
    write_ply("scene.ply", scene)
    assert run(f"{command.replace('SCENE', 'scene.ply')} --json a.json") == 0
    printed = capsys.readouterr()
    line = "scene.ply: 1 Gaussian too large for the model's number format, clipped"
    assert " ".join(printed.err.split()).count(line) == 1, printed.err
    assert "clipped" not in printed.out.replace("clipped  ", "")
    if not command.startswith("error"):
        assert "too large for the model" in Path("a.json").read_text()


@pytest.mark.parametrize("command", COMMANDS.strip().splitlines())
def test_axes_of_every_command(place, in_turn, capsys, command):
    """Every command refuses unknown axes, and `--axes` for a file that states its own."""
    words = command.replace("SCENE", "stated.spz")
    check_refused(capsys, f"{words} --axes xyz", "--axes 'xyz': unknown")
    refused = "stated.spz: --axes RUB: the file states its axes, RDF"
    if command.startswith("bench"):
        assert run(f"{words} --axes rub") == 2  # every view failed
        assert "the file states its axes, RDF" in capsys.readouterr().err
    else:
        check_refused(capsys, f"{words} --axes rub", refused)
    check_refused(capsys, f"{command.replace('SCENE', 'scene.ply')} --axes rub", "only SPZ, glTF")


def test_printed_once_by_processes(place, capsys):
    """A worker returns its notes with its results and prints none itself."""
    words = "bench quality open.spz -o new --size 32x24 --cameras 4,7 --psnr 30 --preset tiny"
    assert run(words) == 0
    err = " ".join(capsys.readouterr().err.split())
    assert err.count("does not state its axes") == 1, err


def test_no_notes_without_a_cause(place, capsys):
    for name in ("scene.ply", "stated.spz"):
        capsys.readouterr()
        assert run(f"render {name} -o a.png --camera cameras.json --json a.json") == 0
        printed = capsys.readouterr()
        assert printed.err == "" and "notes" not in printed.out
        assert load(Path("a.json"))["notes"] == []


def test_info_has_them_in_its_table(place, capsys):
    assert run("info open.spz --json a.json") == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "does not state its axes" in " ".join(printed.out.split())
    assert len(load(Path("a.json"))["notes"]) == 1


def test_info_has_a_line_for_each_note(place, capsys):
    """Notes may contain commas, so each has its own line."""
    Path("open.spz").write_bytes(Path("open.spz").read_bytes() + b"abc")
    assert run("info open.spz") == 0
    lines = [line.removeprefix("notes").strip() for line in capsys.readouterr().out.splitlines()]
    assert "3 bytes belong to no Gaussian and are not read" in lines


def test_axes_read_the_file_rightly(place, capsys):
    """With `--axes rdf` the open file gives the same picture as the file that states RDF."""
    for name, options in (("scene.ply", ""), ("stated.spz", ""), ("open.spz", "--axes rdf")):
        assert run(f"render {name} -o {name}.png --camera cameras.json {options}") == 0
    assert "read as RDF, by --axes" in capsys.readouterr().err
    pictures = [read_png(f"{name}.png") for name in ("scene.ply", "stated.spz", "open.spz")]
    assert np.array_equal(pictures[1], pictures[2])
    assert np.abs(pictures[0].astype(int) - pictures[1]).mean() < 8
    assert run("pack open.spz -o a.splatcore --quality faithful --axes rdf") == 0
    assert run("pack stated.spz -o b.splatcore --quality faithful") == 0
    assert Path("a.splatcore").read_bytes() == Path("b.splatcore").read_bytes()


def test_a_camera_that_sees_too_little(place, capsys):
    """The note names both counts and the option; no note if the axes are right or stated."""
    scene = read_scene("stated.spz")
    moved = replace(scene, position=scene.position + np.array([0, 0, 8]))
    Path("open.spz").write_bytes(spz_of(moved))
    Path("stated.spz").write_bytes(spz_of(moved, 4))
    camera = replace(read_cameras("cameras.json")[0], rotation=np.eye(3), translation=np.zeros(3))
    note = axes_note(read_scene("open.spz"), [camera])
    count = int(re.search(r"0 Gaussians read as RUB, (\d+) as RDF: try --axes rdf", note)[1])
    assert count > len(scene) // 2
    for name, axes in (("open.spz", "RDF"), ("open.spz", "RUB"), ("stated.spz", None)):
        assert axes_note(read_scene(name, axes), [camera]) == ""
    source = open_source("open.spz")
    source.seen_by(camera)
    assert source.notes[1:] == [note] and source.stated["notes"] == source.notes


def test_many_cameras_that_see_too_little(place):
    """One note names the first camera and counts the others."""
    scene = read_scene("stated.spz")
    moved = replace(scene, position=scene.position + np.array([0, 0, 8]))
    Path("open.spz").write_bytes(spz_of(moved))
    camera = replace(read_cameras("cameras.json")[0], rotation=np.eye(3), translation=np.zeros(3))
    source = open_source("open.spz")
    views = [replace(camera, name=str(k)) for k in range(3)]
    source.seen_by(replace(camera, rotation=np.diag([-1, 1, -1.0]), name="right"), *views)
    notes = [note for note in source.notes if "try --axes" in note]
    assert len(notes) == 1 and notes[0].startswith("camera 0 sees 0 Gaussians read as RUB")
    assert notes[0].endswith("as RDF (2 other cameras likewise): try --axes rdf")


def test_a_packed_model_has_no_axes(place, capsys):
    assert run("pack scene.ply -o a.splatcore --quality faithful --json a.json") == 0
    message = "--axes RDF: a.splatcore: a packed model has its own axes; repack the scene"
    for command in ("render a.splatcore -o a.png", "cycles a.splatcore", "info a.splatcore"):
        check_refused(capsys, f"{command} --axes rdf", message)
    check_refused(capsys, "render garden -o a.png --axes rdf", "--axes RDF: garden is generated")
    assert open_source("a.splatcore").stated["notes"] == []


def test_views_by_other_axes_have_other_names(place):
    """Results are kept by name, so results of one reading are not reused for another."""
    names = {View("open.spz", reading=Reading(None, axes)).name for axes in (None, "rdf", "RUB")}
    assert names == {"open.spz", "open.spz --axes RDF", "open.spz --axes RUB"}


def test_python(place):
    assert splatcore.open_scene("open.spz").notes[0].startswith(UNSTATED)
    found = splatcore.open_scene("open.spz", axes="rdf")
    assert np.array_equal(found.position, splatcore.open_scene("stated.spz").position)
    for axes, message in (("abc", "--axes 'abc': unknown"), (1, "axes: is of type int")):
        with pytest.raises(InputError, match=message):
            splatcore.open_scene("open.spz", axes=axes)


def test_the_viewer_s_page(place):
    setting = setting_of(open_source("open.spz"), "cameras.json", "60x44", TINY, None)
    assert setting.notes[0].startswith(UNSTATED)
    assert text.noted(["a_b <c>", "d"]) == "- a\\_b \\<c\\>\n- d"


def test_hush_ends_with_the_command(place, capsys):
    """`info` prints notes in its table only; the next command prints them as usual."""
    write_ply("a.ply", read_scene("scene.ply"))
    assert run("info open.spz") == 0 and run("pack open.spz -o a.splatcore --quality compact") == 0
    assert capsys.readouterr().err.count("does not state") == 1
