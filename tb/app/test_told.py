"""Messages for usage errors, file types and views that show nothing; progress lines."""

import io
import json
import re
from pathlib import Path
from time import sleep

import pytest
from rich.console import Console

from splatcore.sim.common import output
from splatcore.sim.common.output import progress_bar, whole_file
from splatcore.spec.error import InputError
from tb.helpers.command import load, run


@pytest.fixture
def place(folder):
    """A working folder with a scene, its cameras, and a camera that looks away from it."""
    camera, *_ = json.loads(Path("cameras.json").read_text())
    Path("away.json").write_text(json.dumps([camera | {"position": [0, 0, 100]}]))
    return folder


@pytest.mark.parametrize("arguments", [[], ["bench"], ["soak"]])
def test_a_group_alone_is_its_help(capsys, arguments):
    from splatcore.app.cli import main

    with pytest.raises(SystemExit) as stop:
        main.main(arguments)
    printed = capsys.readouterr()
    assert stop.value.code == 2 and not printed.err and "Usage" in printed.out


def test_a_name_without_a_type_or_in_capitals_is_taken(place):
    assert run("render scene.ply -o A.PNG --camera cameras.json --json a") == 0
    assert load(place / "a")["engine"] == "reference"


SEEN = "scene.ply: no Gaussian is visible from camera 4 at (0, 0, 100) with near plane 0.2; 98 % of"


@pytest.mark.parametrize(
    "command",
    ["render scene.ply -o a.png", "render scene.ply --engine golden -o a.png", "cycles scene.ply",
     "compare reference golden --scene scene.ply", "pack scene.ply -o a.splatcore"],
)  # fmt: skip
def test_a_view_of_nothing_is_noted_once(place, capsys, command):
    assert run(f"{command} --camera away.json") == 0
    assert capsys.readouterr().err.count(SEEN) == 1
    assert run(f"{command} --camera cameras.json") == 0
    assert "visible" not in capsys.readouterr().err


def test_dropped_harmonics_are_named(place, capsys):
    options = "--quality compact --camera cameras.json"
    assert run(f"pack scene.ply --sh-degree 0 -o a.splatcore {options} --json a.json") == 0
    assert re.search(r"^ degree 1 \(dropped\) +0\.00 +\d", capsys.readouterr().out, re.M)
    assert "degree 1" in load(place / "a.json")["psnr_db_packing_by_part"]
    assert run(f"pack scene.ply -o a.splatcore {options}") == 0
    assert "dropped" not in capsys.readouterr().out


def test_errors_by_part_of_large_scenes_are_measured_if_asked_for(place, monkeypatch):
    monkeypatch.setattr("splatcore.app.cli.pack.LARGE", 0)
    command = "pack scene.ply -o a.splatcore --quality compact --camera cameras.json --json a.json"
    for option, parts in (("", set()), (" --parts", {"positions", "shape", "opacity", "colour"})):
        assert run(command + option) == 0
        assert parts <= set(load(place / "a.json")["psnr_db_packing_by_part"])
        assert bool(load(place / "a.json")["psnr_db_packing_by_part"]) == bool(parts)


def test_no_scratch_path_in_an_error(tmp_path):
    path = tmp_path / "a.ply"
    with pytest.raises(InputError) as raised, whole_file(path) as part:
        raise InputError(f"{part}: cannot be written")
    assert str(raised.value) == f"{path}: cannot be written"


def test_a_bar_without_an_end_counts_nothing(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(output, "messages", Console(file=text, force_terminal=True, width=90))
    with progress_bar("reading") as advance:
        advance(0, None, "packing")
    assert "packing" in text.getvalue() and "None" not in text.getvalue()
    with progress_bar("reading") as advance:
        advance(3, 7)
    assert "3/7" in text.getvalue()


def test_progress_without_a_terminal_is_lines(monkeypatch):
    """Lines come while the work runs, and stop when it ends."""
    text = io.StringIO()
    monkeypatch.setattr(output, "messages", Console(file=text, width=30))
    monkeypatch.setattr(output, "EVERY", 0.01)
    with progress_bar("reading a scene of a long name.ply") as advance:
        for line in ("reading a scene of a long name.ply, 0 s\n", "packing 3/7, 0 s\n"):
            while line not in text.getvalue():  # hangs if the line never comes
                sleep(0.005)
            advance(3, 7, "packing")
    before = text.getvalue()
    sleep(0.05)
    assert text.getvalue() == before and "\x1b" not in before


def test_short_work_prints_nothing(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(output, "messages", Console(file=text))
    with progress_bar("reading") as advance:
        advance(1, 2)
    assert not text.getvalue()


def test_compare_shows_progress(place, monkeypatch):
    """`compare` shows progress of every slow step: reading, packing and rendering."""
    text = io.StringIO()
    monkeypatch.setattr(output, "messages", Console(file=text, force_terminal=True, width=90))
    assert run("compare reference golden --scene scene.ply --camera cameras.json") == 0
    words = ("reading scene.ply", "packing", "rendering by the golden model")
    assert [word for word in words if word not in text.getvalue()] == []
