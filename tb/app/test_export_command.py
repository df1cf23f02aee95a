"""`splatcore export` and `splatcore.export`: files, losses, dB against the source, refusals."""

from pathlib import Path

import numpy as np
import pytest

import splatcore
from splatcore.model.export.writers import WRITERS
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate
from splatcore.spec.error import InputError
from tb.helpers.command import check_documented, check_refused, load, run, write_scene

VIEW = "--camera cameras.json:7 --size 64x48"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a scene, cameras and a packed model of the scene."""
    folder = tmp_path_factory.mktemp("place")
    write_scene(folder)
    words = ["-o", folder / "scene.splatcore", "--quality", "faithful"]
    assert run("pack", folder / "scene.ply", *words) == 0
    return folder


@pytest.fixture(autouse=True)
def inside(place, monkeypatch):
    monkeypatch.chdir(place)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("source", ["scene.ply", "scene.splatcore"])
def test_every_format(source, suffix, capsys):
    assert run(f"export {source} -o out{suffix} {VIEW} --json out.json") == 0
    printed, facts = capsys.readouterr().out, load_facts()
    check_documented("## `splatcore export`", facts.keys() | facts["losses"]["position"].keys())
    stored = read_scene(f"out{suffix}")
    assert len(stored) == facts["gaussians"] and stored.sh_degree == facts["sh_degree"] == 1
    assert facts["format"] == WRITERS[suffix].name
    assert f"picture of out{suffix} against that of {source}" in printed
    if suffix in (".ply", ".glb"):
        assert facts["psnr_db"] is None or facts["psnr_db"] >= 60
    else:
        assert 30 <= facts["psnr_db"] < 80
    assert all(name in printed for name in facts["losses"])


def load_facts() -> dict:
    return load(Path("out.json"))


def test_no_picture_without_a_view(capsys):
    assert run("export scene.ply -o plain.ply --json out.json") == 0
    assert "picture" not in capsys.readouterr().out and "psnr_db" not in load_facts()


def test_marks_are_kept_and_overridden():
    assert run("export scene.ply --antialiased -o marked.spz") == 0
    assert read_scene("marked.spz").antialiased
    assert run("export marked.spz --no-antialiased -o plain.ply") == 0
    assert not read_scene("plain.ply").antialiased


def test_nan_is_noted(capsys):
    scene = generate("garden", 20)
    scene.position[3] = np.nan
    splatcore.write("nan.ply", scene)
    assert run("export nan.ply -o nan.spz") == 0
    assert "nan.ply: 1 Gaussian with NaN or Inf left out" in capsys.readouterr().err


def test_refused(place, capsys):
    before = {path: path.read_bytes() for path in place.iterdir()}
    for words, message in (
        ("scene.ply -o out.splat", r"out\.splat: must end in \.compressed\.ply, .*\.sog"),
        ("scene.ply -o scene.ply", r"scene\.ply: -o would overwrite scene\.ply, an input"),
        ("scene.ply -o cameras.json", r"cameras\.json: must end|would overwrite"),
        ("scene.splatcore -o none/a.ply", r"none/a\.ply: folder .* does not exist"),
        ("scene.splatcore --antialiased -o a.ply", "a packed model has its own mark"),
        ("none.ply -o a.ply", r"none\.ply: No such file"),
    ):
        check_refused(capsys, f"export {words}", message)
    assert before == {path: path.read_bytes() for path in place.iterdir()}


def test_a_failure_leaves_the_old_file(capsys):
    scene = generate("garden", 20)
    scene.position[3] = 1e7
    splatcore.write("far.ply", scene)
    assert run("export scene.ply -o old.spz") == 0
    before = Path("old.spz").read_bytes()
    check_refused(capsys, "export far.ply -o old.spz", r"old\.spz: a position of 1e\+07 is beyond")
    assert Path("old.spz").read_bytes() == before


def test_python(tmp_path):
    scene = splatcore.open_scene("scene.ply")
    model = splatcore.open_scene("scene.splatcore")
    for source in (scene, model):
        found = splatcore.export(tmp_path / "a.spz", source)
        assert len(read_scene(tmp_path / "a.spz")) <= len(source)
        assert 0 < found["position"]["rms"] <= found["position"]["largest"] < 1e-4
    for call, message in (
        (lambda: splatcore.export("a.png", scene), r"a\.png: must end in"),
        (lambda: splatcore.export("a.ply", np.zeros((4, 4, 3))), "thing: is of type ndarray"),
        (lambda: splatcore.export("scene.ply", scene), r"scene\.ply: export would overwrite"),
        (lambda: splatcore.export("none/a.ply", scene), "does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            call()
