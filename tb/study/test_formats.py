"""`splatcore bench formats`: other file formats by an external tool, compared with our models."""

import os
from pathlib import Path

import pytest

from splatcore.golden.reference import render
from splatcore.model.compress.checkpoint import ply_bytes
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate
from splatcore.sim.frame.metric import psnr
from splatcore.sim.frame.source import View
from splatcore.study.bench import formats
from tb.helpers.command import check_documented, load, run

SPLAT_TRANSFORM = """#!/usr/bin/env python3
import sys
from pathlib import Path
if sys.argv[1:] == ["--version"]:
    print("stand-in v1")
    sys.exit()
assert sys.argv[1:5] == ["--quiet", "--overwrite", "--gpu", "cpu"], sys.argv
if "BROKEN" in sys.argv[0]:
    sys.exit("cannot be")
out = sys.argv[-1]
assert sys.argv[6:-1] == (["--rotate", "180,0,0"] if out.endswith(".spz") else []), sys.argv
Path(out).write_bytes(Path(KEPT, "garden" + out.partition(".")[2]).read_bytes())
"""


@pytest.fixture
def tool(tmp_path, monkeypatch):
    """A stand-in for splat-transform that copies prepared files, all of them PLY inside."""
    monkeypatch.chdir(tmp_path)
    kept = Path("kept")
    kept.mkdir()
    scene = generate("garden", 400)
    for end in ("sog", "compressed.ply", "spz"):
        write_ply(kept / f"garden{end}", scene[: 300 if end == "sog" else 400])
    for name in ("tool", "BROKEN"):
        text = SPLAT_TRANSFORM.replace("KEPT", repr(str(kept.resolve())))
        Path(name).write_text(text)
        os.chmod(name, 0o755)
    write_ply(Path("garden.ply"), scene)
    return scene


def test_formats(tool, monkeypatch, capsys):
    """One row per format and model, with file sizes and PSNR."""
    monkeypatch.setattr(formats, "open_source", lambda path: PlyOf(path))
    assert run("bench formats garden.ply -o out --size 96x54 --tool ./tool") == 0
    assert "times smaller" in capsys.readouterr().out
    facts = load(Path("out/formats.json"))
    check_documented("## `splatcore bench formats`", [*facts, *facts["rows"][0]])
    assert facts["tool"] == "stand-in v1" and not facts["failed"]
    rows = {row["format"]: row for row in facts["rows"]}
    assert list(rows) == ["SOG", "compressed PLY", "SPZ", "compact", "balanced", "faithful"]
    assert rows["SPZ"]["file_bytes"] == Path("out/garden.spz").stat().st_size
    assert rows["SPZ"]["bytes"] is None and rows["SOG"]["gaussians"] == 300
    for row in rows.values():
        assert row["ratio"] == ply_bytes(400, tool.sh_degree) / row["file_bytes"]
    assert rows["SPZ"]["psnr_db"] is None or rows["SPZ"]["psnr_db"] > 80  # the unchanged scene
    assert rows["SOG"]["psnr_db"] < 80 and rows["compact"]["psnr_db"] < 80
    assert rows["faithful"]["bytes"] > rows["faithful"]["file_bytes"]
    assert not list(Path("out").glob("*.formats.ply"))


class PlyOf:
    """Reader of the stand-in's files, which are PLY whatever their name says."""

    def __init__(self, path: str):
        plain = Path(path).with_suffix(".copy.ply")
        plain.write_bytes(Path(path).read_bytes())
        self.unpacked = read_scene(str(plain))


def test_with_a_compressed_model(tool, monkeypatch):
    monkeypatch.setattr(formats, "open_source", lambda path: PlyOf(path))
    assert run("pack garden.ply -o small.splatcore --quality compact --size 96x54") == 0
    options = "-o out --size 96x54 --tool ./tool --model small.splatcore"
    assert run(f"bench formats garden.ply {options}") == 0
    rows = {row["format"]: row for row in load(Path("out/formats.json"))["rows"]}
    assert rows["small.splatcore"] | {"format": "compact"} == rows["compact"]
    assert run(f"bench formats garden.ply garden {options}") == 2


def test_a_tool_that_fails_or_is_missing(tool, capsys, monkeypatch):
    assert run("bench formats garden.ply -o out --size 96x54 --tool ./BROKEN") == 2
    assert "BROKEN: failed with status 1: cannot be" in " ".join(capsys.readouterr().err.split())
    assert run("bench formats garden.ply -o out --tool ./none") == 2
    printed = " ".join(capsys.readouterr().err.split())
    assert "./none: no such program; npm install -g @playcanvas/splat-transform" in printed


def test_psnr_of_pictures(tool, monkeypatch):
    monkeypatch.setattr(formats, "open_source", lambda path: PlyOf(path))
    assert run("bench formats garden.ply -o out --size 96x54 --tool ./tool") == 0
    rows = {row["format"]: row for row in load(Path("out/formats.json"))["rows"]}
    camera = View("garden.ply", "", "96x54").open()[1]
    read = read_scene("garden.ply")
    some, every = (render(each.gaussians(), camera).pixels / 255 for each in (read[:300], read))
    assert rows["SOG"]["psnr_db"] == pytest.approx(psnr(some, every))
