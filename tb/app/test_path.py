"""`--cameras` of `render`, `cycles` and `compare`: rows, pictures, videos, refusals."""

import json
import shutil
from pathlib import Path

import av
import numpy as np
import pytest

from splatcore.app.cli import path as path_command
from splatcore.app.cli import video
from splatcore.app.cli.path import folded, packed_alike
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.sim.common import output
from splatcore.sim.common.pool import processes
from splatcore.sim.frame import choose
from splatcore.sim.frame.metric import channel_error, difference
from splatcore.sim.frame.picture import error_picture, read_png
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source, open_path, opened
from splatcore.study.bench import campaign
from tb.helpers.campaign_tasks import say
from tb.helpers.command import check_documented, check_refused, load, run


@pytest.fixture
def place(folder):
    """A working folder with a scene, its cameras 4 and 7 in two files, and other camera files."""
    shutil.copy("cameras.json", "scene.cameras.json")
    first, second = json.loads(Path("cameras.json").read_text())
    others = {
        "away": [first, second | {"position": [0, 0, 100]}],
        "names": [first | {"id": "../a"}, second | {"id": "b c"}],
        "odd": [each | {"width": 33, "height": 31} for each in (second, first)],
    }
    for name, cameras in others.items():
        Path(f"{name}.json").write_text(json.dumps(cameras))
    opened.cache_clear()
    return folder


@pytest.fixture
def here(place, in_turn):
    """That folder; campaign tasks run in this process, the last one first."""
    yield place
    assert in_turn


def path(arguments: str) -> dict:
    """Run a command and return its JSON."""
    assert run(f"{arguments} --json path.json") == 0
    return load(Path("path.json"))


def test_cycles_of_each_camera(here, capsys):
    """Each row equals the result of its camera alone; least, mean and most are over the rows."""
    run("pack scene.ply -o m.splatcore --camera cameras.json")
    capsys.readouterr()
    found = path("cycles m.splatcore --cameras cameras.json:7,4")
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row.pop("camera") for row in found["views"]] == ["7", "4"]
    for name, row in zip("74", found["views"], strict=True):
        alone = path(f"cycles m.splatcore --camera cameras.json:{name}")["scenes"]
        assert row == alone["m.splatcore"]
    values = [row["psnr_db_machine"] for row in found["views"]]
    of = {"least": min(values), "mean": np.mean(values), "most": max(values)}
    assert {name: found[name]["psnr_db_machine"] for name in of} == pytest.approx(of)
    folds = dict(zip(("min", "mean", "max"), of.values(), strict=True))
    shown = dict(zip("74", values, strict=True)) | folds
    dbs = {words[0]: words[5] for words in lines if words and words[0] in shown}
    assert dbs == {name: f"{db:.2f}" for name, db in shown.items()} and list(dbs) == list(shown)
    assert "dB, machine" in " ".join(" ".join(lines[2]).split())
    check_documented("## `splatcore render`, `cycles` and `compare` with `--cameras`", found)


@pytest.mark.parametrize("way", ["cameras.json", "cameras.json:4,7", "4,7", "view_4, view_7"])
def test_one_grammar(place, way):
    """A file, some of its cameras, or cameras of the scene's own file; `pack` takes the same."""
    views = open_path(way, "32x24", "scene.ply")
    assert [(view.name, view.width, view.fx) for view in views] == [("4", 32, 30), ("7", 32, 30)]
    words = "pack", "scene.ply", "-o", "m.splatcore", "--quality", "faithful", "--json", "p"
    assert run(*words, "--cameras", way) == 0 and load(Path("p"))["views"] == 2


def test_a_scene_is_opened_and_packed_once(here, monkeypatch):
    done = []

    def counted(function):
        return lambda *words, **more: done.append(function.__name__) or function(*words, **more)

    monkeypatch.setattr(choose, "pack", counted(choose.pack))
    monkeypatch.setattr(path_command, "open_source", counted(path_command.open_source))
    found = path("cycles scene.ply --cameras cameras.json --quality faithful")
    assert sorted(done) == ["open_source", "pack"]
    run("pack scene.ply -o m.splatcore --quality faithful --camera cameras.json")
    for row in found["views"]:
        for name in ("scene.ply", "m.splatcore"):
            run(f"render {name} --camera cameras.json:{row['camera']} -o {name}.png")
        packing = difference(read_png("m.splatcore.png"), read_png("scene.ply.png"))
        assert row["packing"]["psnr_db_packing"] == pytest.approx(packing.psnr_db)
        assert row["packing"]["quality"] == "faithful"


def test_packing_notes_are_printed_once(here, capsys):
    """A packing note is printed once and is in the JSON, for one camera and for all."""
    scene = read_scene("scene.ply")
    scene.position[3] = 1e6
    write_ply("far.ply", scene)
    note = "1 Gaussian far outside the scene, stored in chunks of its own"
    words = "render far.ply --engine golden --no-compare --json a.json"
    assert run(f"{words} --camera cameras.json -o a.png") == 0
    assert capsys.readouterr().err.count(f"far.ply: {note}\n") == 1
    assert note in load(Path("a.json"))["notes"]
    write_ply("other.ply", scene)  # this process keeps opened scenes
    for command in ("render far.ply --engine golden -o new", "cycles other.ply"):
        assert run(f"{command} --cameras cameras.json --json a.json") == 0
        assert capsys.readouterr().err.count(f".ply: {note}\n") == 1
        assert all(note in row["notes"] for row in load(Path("a.json"))["views"])


def test_few_views_choose_the_packing(monkeypatch):
    """The quality is chosen from at most four views: the first and others, evenly spread."""
    monkeypatch.setattr(choose, "quality_of", lambda scene, config, views: views)
    source = Source("scene", scene=object())
    for count, some in ((1, [0]), (4, [0, 1, 2, 3]), (9, [0, 3, 6]), (400, [0, 100, 200, 300])):
        shots = packed_alike([Shot(source, number) for number in range(count)])
        assert [shot.quality for shot in shots] == [some] * count


def test_compare_each_camera(here, monkeypatch, capsys):
    """`compare` and `cycles` give the same numbers for all cameras."""
    monkeypatch.setattr(choose, "quality_of", lambda *_: "faithful")
    found = path("compare reference golden --scene scene.ply --cameras 4,7")
    assert "SSIM, machine" in capsys.readouterr().out
    cycles = path("cycles scene.ply --cameras 4,7")
    keys = ["psnr_db_machine", "ssim_machine", "psnr_db_scene", "max_error_scene", "packing"]
    for name in ("least", "mean", "most"):
        assert {k: found[name][k] for k in keys} == {k: cycles[name][k] for k in keys}
    assert [row["camera"] for row in found["views"]] == ["4", "7"]


def test_a_picture_of_each_camera(here, capsys):
    found = path("render scene.ply --cameras names.json -o new --original")
    assert [row["camera"] for row in found["views"]] == ["../a", "b c"]
    assert sorted(each.name for each in Path("new").iterdir()) == ["..-a.png", "b-c.png"]
    for number, name in enumerate(("..-a", "b-c")):
        run(f"render scene.ply --camera cameras.json:{(4, 7)[number]} -o one.png --original")
        assert Path("one.png").read_bytes() == Path(f"new/{name}.png").read_bytes()
    counts = [row["counts"]["visible"] for row in found["views"]]
    assert found["least"]["counts"]["visible"] == min(counts)
    assert "visible" in capsys.readouterr().out


def frames(name: str) -> list[np.ndarray]:
    """Frames of a video, each [height, width, 3]."""
    with av.open(name) as file:
        return [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]


def test_video(here):
    """One frame per camera, in order, with even sides, close to the pictures, with the error
    picture on the right; no other file is written."""
    before = {each.name for each in here.iterdir()}
    found = path(
        "render scene.ply --engine golden --cameras odd.json -o new --video v.mp4 --fps 5 "
        "--beside error --background 0,0,1"
    )
    with av.open("v.mp4") as file:
        stream = file.streams.video[0]
        assert stream.average_rate == 5 and stream.codec_context.pix_fmt == "yuv420p"
    shown = frames("v.mp4")
    assert [frame.shape for frame in shown] == [(32, 66, 3)] * 2
    pictures = [read_png(f"new/{row['camera']}.png").astype(int) for row in found["views"]]
    error = [[abs(f[:31, :33] - p).mean() for p in pictures] for f in shown]
    assert max(error[0][0], error[1][1]) < 6 < min(error[0][1], error[1][0])
    assert all(frame[:31, 36:66].mean() < 80 for frame in shown)  # dark: errors of a few levels
    assert {each.name for each in here.iterdir()} - before == {"new", "v.mp4", "path.json"}
    assert [row["camera"] for row in found["views"]] == ["7", "4"]
    assert found["least"]["psnr_db_machine"] > 40


def test_a_video_without_pictures(here):
    assert run("render scene.ply --cameras cameras.json --video v.mp4 --size 32x24") == 0
    assert [frame.shape for frame in frames("v.mp4")] == [(24, 32, 3)] * 2
    golden = "render scene.ply --engine golden --cameras 4,7 --video w.mp4"
    assert run(f"{golden} --beside reference") == 0
    left, right = np.split(frames("w.mp4")[0].astype(int), 2, axis=1)
    assert abs(left - right).mean() < 3


def test_colours_of_a_video(tmp_path):
    """The colour matrix used matches the one declared: a decoder recovers the colours."""
    colours = np.array([(200, 30, 30), (30, 200, 30), (30, 30, 200)], np.uint8)
    with video.video(tmp_path / "v.mp4", 30) as add:
        for colour in colours:
            add(np.tile(colour, (32, 48, 1)))
    found = [frame.mean((0, 1)) for frame in frames(str(tmp_path / "v.mp4"))]
    assert np.abs(found - colours.astype(float)).max() < 4


def test_a_failure_leaves_no_video(place, monkeypatch, capsys):
    def fail(tasks):
        yield tasks[0], tasks[0].function(*tasks[0].arguments)
        yield tasks[1], campaign.Failure("7", "memory exhausted")

    monkeypatch.setattr(campaign, "in_processes", fail)
    before = sorted(place.rglob("*"))
    words = "render scene.ply --cameras cameras.json --video v.mp4"
    check_refused(capsys, words, "scene.ply: camera 7: memory exhausted")
    assert sorted(place.rglob("*")) == before


def test_the_scale_of_errors():
    """Colours get brighter with the error and do not depend on the rest of the picture."""
    image, truth = np.zeros((2, 8, 8, 3), np.uint8)
    image[0, :4, 1] = 0, 1, 4, 30
    drawn = error_picture(image, truth).astype(int).sum(axis=2)
    assert (np.diff(drawn[0, :4]) > 20).all() and drawn[5, 5] == drawn[0, 0]
    image[0, 3] = 0
    assert error_picture(image, truth).astype(int).sum(axis=2)[0, 2] == drawn[0, 2]
    assert channel_error(image, truth)[0, 2] == 4


def test_numbers_of_rows():
    """`folded` combines numbers, nested ones too, and drops text, truth values and None."""
    rows = [
        {"a": 1, "text": "x", "none": None, "db": None, "in": {"b": 2.0, "t": "y"}, "same": True},
        {"a": 4, "text": "y", "none": None, "db": 50.0, "in": {"b": 4.0, "t": "y"}, "same": True},
    ]
    assert folded(rows, max) == {"a": 4, "db": 50.0, "in": {"b": 4.0}}


def test_without_the_encoder(place, monkeypatch, capsys):
    monkeypatch.setattr(video, "find_spec", lambda name: None)
    words = "render none.ply --cameras 4,7 --video v.mp4"
    check_refused(capsys, words, r"--video: needs PyAV: pip install 'splatcore\[video\]'")


def test_by_processes(place, monkeypatch, capsys):
    """Worker processes give the same rows; an empty view is noted once; progress is printed."""
    monkeypatch.setattr(output, "EVERY", 0.2)
    found = path("cycles scene.ply --cameras away.json --quality faithful")
    printed = capsys.readouterr().err
    assert printed.count("scene.ply: no Gaussian is visible from camera 7 at (") == 1
    assert "views 0/2, " in printed and [row["camera"] for row in found["views"]] == ["4", "7"]
    alone = path("cycles scene.ply --camera away.json:4 --quality faithful")["scenes"]["scene.ply"]
    assert found["views"][0] == {"camera": "4"} | alone


def test_processes_print_no_progress(capfd):
    with processes(1) as pool:
        assert pool.submit(say, "a word").result() is None
    assert "a word" not in capfd.readouterr().err
