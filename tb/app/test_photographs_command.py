"""The command `photographs`: the capture is read back with the same cameras, pixels, points."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.cameras import capture as views
from splatcore.model.cameras.orbit import GAP
from splatcore.model.formats.camera_file import cameras_json, read_cameras
from splatcore.model.formats.colmap import read_points
from splatcore.model.formats.photographs import read_photographs
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate
from splatcore.spec.camera import look_at
from splatcore.spec.colour import SH_C0
from splatcore.spec.error import InputError
from splatcore.study.compression import capture
from tb.helpers.command import check_documented, load, run

SIZE = (64, 40)
QUICK = ["--views", "9", "--size", "64x40", "--points", "60"]


pytestmark = pytest.mark.usefixtures("in_turn")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a garden and three cameras in front of it."""
    folder = tmp_path_factory.mktemp("scene")
    write_ply(folder / "small.ply", generate("garden", 800))
    eyes = [np.array([3 * np.sin(a), -1.2, 3 * np.cos(a)]) for a in (2.0, 3.0, 4.0)]
    cameras = [
        look_at(eye, [0, -0.3, 0], 160, 100, 120.0, name=str(k)) for k, eye in enumerate(eyes)
    ]
    (folder / "given.json").write_text(cameras_json(cameras))
    return folder


def taken(place: Path, folder: Path, *options: object) -> int:
    return run("photographs", place / "small.ply", "-o", folder, *QUICK, *options)


@pytest.fixture
def cameras_used(monkeypatch):
    """Record the camera of each photograph, by file name."""
    photograph, used = capture.photograph, {}

    def noted(shot):
        used[f"{shot.camera.name}.png"] = shot.camera
        return photograph(shot)

    monkeypatch.setattr(capture, "photograph", noted)
    return used


def test_a_capture(place, tmp_path, capsys, cameras_used):
    """Pictures equal renderings from the cameras read back, bit by bit; a third is from all
    around, the rest on the path; points are Gaussians of the scene."""
    facts = tmp_path / "facts.json"
    options = ["--cameras", place / "given.json", "--path-share", 0.66, "--json", facts]
    assert taken(place, tmp_path / "a", *options) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "9 photographs of 64x40 (6 on the path, 3 from all around), 60 points" in printed
    found, scene = read_photographs(tmp_path / "a"), read_scene(place / "small.ply")
    names = [f"around-00{k}.png" for k in range(3)] + [f"path-00{k}.png" for k in range(6)]
    assert [target.name for target in found.targets] == names and not found.notes
    for target in found.targets:
        assert (target.camera.width, target.camera.height) == SIZE
        assert np.array_equal(render(scene.gaussians(), target.camera).pixels, target.image)
        used = cameras_used[target.name]
        assert target.image.std() > 10 and np.array_equal(used.rotation, target.camera.rotation)
    ahead = np.array([camera.rotation[2] for camera in read_cameras(place / "given.json")])
    for target in found.targets[3:]:
        assert target.camera.fx == 48 and (ahead @ target.camera.rotation[2]).max() <= np.cos(GAP)
    position, colour = read_points(tmp_path / "a")
    rows = {tuple(place): k for k, place in enumerate(scene.position)}
    drawn = [rows[tuple(place)] for place in position]
    assert len(set(drawn)) == len(drawn) == 60 and drawn == sorted(drawn)
    wanted = np.clip(scene.sh[drawn, 0] * SH_C0 + 0.5, 0, 1) * 255
    assert np.abs(colour - wanted).max() <= 0.5 and len(set(map(tuple, colour))) > 20
    report = load(facts)
    assert (report["on_path"], report["around"], report["points"]) == (6, 3, 60)
    check_documented("## `splatcore photographs`", report)


def observations(data: bytes) -> list[np.ndarray]:
    """Observations (x, y, point) of each image of an images.bin."""
    offset, found = 8, []
    for _ in range(*struct.unpack_from("<Q", data)):
        offset = data.index(b"\0", offset + 64) + 9
        (count,) = struct.unpack_from("<Q", data, offset - 8)
        layout = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<i8")])
        found.append(np.frombuffer(data, layout, count, offset))
        offset += 24 * count
    assert offset == len(data)
    return found


def tracks(data: bytes) -> list[list[tuple[int, int]]]:
    """Track of each point of a points3D.bin: pairs of image and observation number."""
    offset, found = 8, []
    for _ in range(*struct.unpack_from("<Q", data)):
        (count,) = struct.unpack_from("<Q", data, offset + 43)
        words = struct.unpack_from(f"<{2 * count}I", data, offset + 51)
        found.append(list(zip(words[::2], words[1::2], strict=True)))
        offset += 51 + 8 * count
    assert offset == len(data)
    return found


def test_tracks(place, tmp_path):
    """Tracks of points match observations of images; each observation is where the point
    projects to; without a Gaussian that is observed the picture changes."""
    assert taken(place, tmp_path / "a") == 0
    sparse, scene = tmp_path / "a" / "sparse" / "0", read_scene(place / "small.ply")
    seen = observations((sparse / "images.bin").read_bytes())
    found = tracks((sparse / "points3D.bin").read_bytes())
    both = {
        (k, row, each["point"]) for k, rows in enumerate(seen, 1) for row, each in enumerate(rows)
    }
    assert both == {(*each, point) for point, track in enumerate(found, 1) for each in track}
    assert min(map(len, found)) >= 2
    position, _ = read_points(tmp_path / "a")
    targets = read_photographs(tmp_path / "a").targets
    for rows, target in zip(seen, targets, strict=True):
        camera = target.camera
        point = position[rows["point"] - 1] @ camera.rotation.T + camera.translation
        place_x = point[:, 0] / point[:, 2] * camera.fx + camera.cx
        assert np.allclose(rows["x"], place_x, atol=1e-9) and (point[:, 2] > 0).all()
        assert ((rows["x"] >= 0) & (rows["x"] < 64) & (rows["y"] >= 0) & (rows["y"] < 40)).all()
    first = {tuple(each): k for k, each in enumerate(scene.position)}
    shown = [first[tuple(position[point - 1])] for point in seen[0]["point"]]
    less = scene[np.setdiff1d(np.arange(len(scene)), shown[:1])].gaussians()
    assert (render(less, targets[0].camera).pixels != targets[0].image).any()


def test_the_seed_decides(place, tmp_path):
    """The same seed gives the same bytes; another seed gives other views and points."""
    content = []
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert taken(place, tmp_path / name, "--seed", seed) == 0
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        assert len(files) == 12
        content.append({path.name: path.read_bytes() for path in files})
    assert content[0] == content[1]
    assert not [name for name, data in content[2].items() if data == content[0][name]]
    assert {path.name for path in (tmp_path / "c").iterdir()} == {"images", "sparse"}


def test_points_are_drawn():
    """Points are drawn by the seed, more often with more opacity or more pictures, and never
    from a Gaussian seen in one picture only."""
    scene = generate("garden", 800)
    kind = np.arange(800) % 4
    scene = replace(scene, opacity=np.where(kind == 1, 0.1, 1.0))
    table = np.array([kind < 4, kind < 3, kind < 2, kind < 2])
    shows = [np.packbits(row) for row in table]
    rows = {tuple(place): k for k, place in enumerate(scene.position)}
    drawn = []
    for seed in range(2):
        (position, _), seen = capture.points_of(scene, shows, 100, seed)
        drawn.append([rows[tuple(place)] for place in position])
        assert all(
            table[k, drawn[-1]].sum() == len(each) and table[k, drawn[-1]][each].all()
            for k, each in enumerate(seen)
        )
    full, faint, few, none = np.bincount(kind[np.concatenate(drawn)], minlength=4)
    assert none == 0 and full > 1.4 * few and few > 2 * faint > 0 and drawn[0] != drawn[1]
    (position, _), _ = capture.points_of(scene, shows, 1000, 0)
    assert len(position) == 600


@pytest.mark.parametrize("fault", [InputError("no"), KeyboardInterrupt, OSError(28, "disk full")])
def test_a_failure_leaves_nothing(place, tmp_path, monkeypatch, fault):
    """A failure halfway removes a new folder and leaves an empty one empty."""

    def fail(*_):
        raise fault

    monkeypatch.setattr(capture, "points_of", fail)
    (tmp_path / "old").mkdir()
    for name in ("new", "old"):
        with pytest.raises((KeyboardInterrupt, AssertionError, SystemExit)):
            raise SystemExit(taken(place, tmp_path / name))
    assert [path.name for path in tmp_path.rglob("*")] == ["old"]


def test_views_of_nothing(place, tmp_path, monkeypatch, capsys):
    """No Gaussian is in two photographs, so there are no points: refused, nothing written."""
    monkeypatch.chdir(tmp_path)
    camera = json.loads((place / "given.json").read_text())[0]
    away = [camera | {"id": k, "position": [k, -400, 0]} for k in range(2)]
    Path("away.json").write_text(json.dumps(away))
    command = f"photographs {place / 'small.ply'} -o a --cameras away.json --path-share 1 --views 2"
    assert run(f"{command} --size 8x8") == 2
    printed = capsys.readouterr()
    assert "no Gaussian is in 2 of the photographs" in printed.err.splitlines()[-1]
    assert not Path("a").exists() and not printed.out


def test_names_go_on_in_their_order(monkeypatch):
    """File names sort in the order of views, so every n-th name is every n-th view."""
    view = look_at(np.array([0.0, 0, -3]), np.zeros(3), *SIZE, 50.0)
    monkeypatch.setattr(views, "teacher_views", lambda _, count, *others: [view] * count)
    for count, last in ((30, "around-029"), (1200, "around-1199")):
        names = [each.name for each in views.capture_views(None, count, SIZE, 0)]
        assert len(set(names)) == count and names == sorted(names) and names[-1] == last
