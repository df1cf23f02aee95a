"""The folder that INRIA's training writes is read as a scene with its cameras."""

import json
from pathlib import Path

import pytest

from splatcore.model.formats.ply import write_ply
from tb.helpers.clouds import cloud
from tb.helpers.command import check_refused, load, run


@pytest.fixture
def place(folder):
    """`trained`: a folder as INRIA's train.py writes it, 200 Gaussians in the last iteration."""
    for iteration, count in ((7000, 50), (30000, 200), (900, 20)):
        there = Path(f"trained/point_cloud/iteration_{iteration}")
        there.mkdir(parents=True)
        write_ply(there / "point_cloud.ply", cloud(0, count=count))
    write_ply(Path("trained/input.ply"), cloud(0, count=10))
    Path("cameras.json").rename("trained/cameras.json")
    Path("bare/point_cloud/iteration_1").mkdir(parents=True)
    Path("scene.ply").rename("bare/point_cloud/iteration_1/point_cloud.ply")
    Path("none").mkdir()


def test_it_is_a_scene_with_its_cameras(place):
    assert run("info trained --json i.json") == 0
    assert load(Path("i.json"))["gaussians"] == 200 and load(Path("i.json"))["scene"] == "trained"
    assert run("render trained -o a.png --json a.json") == 0
    found = load(Path("a.json"))
    assert found["size"] == [64, 48] and found["camera"] == "4"  # its first camera
    assert run("render trained --camera trained:7 -o b.png --json b.json") == 0
    assert run("render trained --camera trained/cameras.json:7 -o c.png") == 0
    assert Path("b.png").read_bytes() == Path("c.png").read_bytes() != Path("a.png").read_bytes()
    ply = "trained/point_cloud/iteration_30000/point_cloud.ply"
    assert run(f"render {ply} --camera trained/cameras.json:7 -o d.png") == 0
    assert Path("d.png").read_bytes() == Path("b.png").read_bytes()
    assert run("cycles trained --json y.json") == 0
    assert run("pack trained -o m.splatcore --cameras trained:4,7 --json p.json") == 0
    assert load(Path("p.json"))["views"] == 2


def test_without_cameras_a_default_view_is_used(place):
    assert run("render bare -o a.png --json a.json --size 32x24") == 0
    assert load(Path("a.json"))["counts"]["gaussians"] == 200


def test_benchmarks_take_its_cameras(place):
    assert run("bench quality trained -o out --cameras 4,7 --psnr , --size 32x24") == 0
    rows = json.loads(Path("out/quality.json").read_text())["rows"][::3]
    assert [row["camera"] for row in rows] == ["4", "7"]


def test_refused(place, capsys):
    check_refused(
        capsys, "render none -o a.png", "none: is a directory without any of point_cloud/"
    )
    ply = "trained/point_cloud/iteration_7000/point_cloud.ply"
    check_refused(capsys, f"pack trained -o {ply[:-3]}splatcore --json {ply}", "would overwrite")
