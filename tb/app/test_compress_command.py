"""The commands `train` and `compress`: models and facts they write, resuming, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("flip_evaluator")

from PIL import Image
from scipy.spatial.transform import Rotation

from splatcore.app.cli import compress as compress_command
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.teacher import OwnPicture, pictures
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.model_file import read_model
from splatcore.model.formats.photographs import Target
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate
from splatcore.spec.colour import FINE, SH_C0
from splatcore.spec.config import DEFAULT
from splatcore.study.compression import run as compression_run
from tb.helpers.command import check_documented, load, run
from tb.helpers.compression_scene import garden_with_harmonics

pytestmark = pytest.mark.compress

QUICK = {"steps": 4, "distill_steps": 3, "quantize_steps": 4, "views": 5}
"""Keys of a recipe for a short run."""


def compress(scene: Path, output: Path, *words: object, **keys: object) -> int:
    """Run `compress` with a quick recipe and other keys; its exit status."""
    file = output.with_suffix(".toml")
    file.write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in (QUICK | keys).items()))
    return run("compress", scene, "-o", output, "--recipe", file, "--size", "96x64", *words)


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "small.ply"
    write_ply(path, generate("garden", 600))
    return path


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """A COLMAP folder with nine photographs of a garden and its points."""
    folder = tmp_path_factory.mktemp("photographs")
    garden = generate("garden", 500)
    cameras = surrounding_views(garden.gaussians(), 9, 64, 48)
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    (folder / "images").mkdir()
    lines, frames = [], []
    for k, target in enumerate(pictures(garden, cameras)):
        name = f"{k}.png"
        Image.fromarray(target.image).save(folder / "images" / name)
        camera = target.camera
        turn = Rotation.from_matrix(camera.rotation).as_quat(scalar_first=True)
        pose = " ".join(map(str, [*turn, *camera.translation]))
        lines.append(f"{k + 1} {pose} {k + 1} {name}\n\n")
        size = f"{camera.width} {camera.height} {camera.fx} {camera.fy} {camera.cx} {camera.cy}"
        frames.append(f"{k + 1} PINHOLE {size}\n")
    (sparse / "images.txt").write_text("".join(lines))
    (sparse / "cameras.txt").write_text("".join(frames))
    colour = np.clip(garden.sh[:, 0] * SH_C0 + 0.5, 0, 1) * 255
    points = [
        f"{k} {x} {y} {z} {int(r)} {int(g)} {int(b)} 0.1\n"
        for k, ((x, y, z), (r, g, b)) in enumerate(zip(garden.position, colour, strict=True))
    ]
    (sparse / "points3D.txt").write_text("".join(points))
    return folder


@pytest.fixture(scope="module")
def compressed(scene_file, tmp_path_factory):
    """A small model, its facts as JSON, and the command that produced both."""
    folder = tmp_path_factory.mktemp("model")
    model, facts = folder / "small.splatcore", folder / "facts.json"
    command = scene_file, model, "--json", facts
    assert compress(*command) == 0
    return model, facts, command


def test_compress(compressed, tmp_path, capsys):
    """A scene file becomes a model that the machine renders; a second run changes nothing."""
    model, facts, command = compressed
    before = model.read_bytes()
    assert compress(*command) == 0 and model.read_bytes() == before
    shown = capsys.readouterr().out
    assert (
        "prune 0.399 (2)" in shown
        and "degree 1, chosen" in shown
        and "times smaller" in shown
        and "4 other views" in shown
    )
    found = load(facts)
    assert found["bytes"] == len(read_model(model).image)
    assert found["file_bytes"] == model.stat().st_size < found["bytes"]
    assert f"{found['bytes']:,} bytes in memory, {found['file_bytes']:,} in the file" in shown
    assert found["ratio"] == found["original_bytes"] / found["bytes"] > 5
    assert [step["kind"] for step in found["steps"]][:5] == ["original"] + 4 * ["prune"]
    assert found["psnr_db"] > 15 and found["psnr_db_before"] is None
    assert len(read_model(model)) == found["gaussians"]
    assert model.with_name("small.splatcore.steps").joinpath("steps.json").is_file()
    picture = tmp_path / "picture.png"
    rendering = ["render", str(model), "--engine", "golden", "--size", "96x64", "-o", str(picture)]
    assert run(*rendering) == 0 and picture.is_file()
    assert compress(*command, seed=1) == 2
    assert "holds another compression's steps" in capsys.readouterr().err


def test_degree(compressed, tmp_path, capsys):
    """`degree` sets the model's degree; with another degree or quality kept steps are refused."""
    scene, model = tmp_path / "third.ply", tmp_path / "third.splatcore"
    write_ply(scene, garden_with_harmonics(500))
    assert compress(scene, model, degree=3, quality="faithful") == 0
    packed = read_model(model)
    assert packed.format.sh_degree == 3 and not packed.format.codebooks
    assert set(packed.chunks["harmonics"]) == {FINE}
    capsys.readouterr()
    before = model.read_bytes()
    for other in ({"degree": 3}, {"degree": 2}, {}):
        assert compress(scene, model, **other) == 2 and model.read_bytes() == before
        assert "holds another compression's steps" in capsys.readouterr().err


def test_cameras_of_a_file(scene_file, compressed, photographs, tmp_path, capsys):
    """`--cameras` adds the file's cameras to the generated views, so the model differs."""
    path = tmp_path / "b"
    assert compress(scene_file, path, "--cameras", photographs) == 0
    assert compressed[0].read_bytes() != path.read_bytes()
    assert compress(scene_file, tmp_path / "c", "--cameras", "no") == 2
    assert "no" in capsys.readouterr().err


def test_beside_the_path(scene_file, photographs, tmp_path, capsys):
    """The PSNR off the path is reported for four offsets; `beside` changes the model."""
    models = []
    for share in (0, 1):
        model, facts = tmp_path / f"{share}.splatcore", tmp_path / "facts.json"
        command = scene_file, model, "--json", facts
        assert compress(*command, "--cameras", photographs, beside=share) == 0
        models.append(model.read_bytes())
        found = load(facts)["psnr_db_beside"]
        assert list(found) == ["5 degrees", "15 degrees", "nearer", "farther"]
        assert min(found.values()) > 10 and len(set(found.values())) == 4
        shown = " ".join(capsys.readouterr().out.split())
        assert f"views of the path, off the path: 5 degrees {found['5 degrees']:.2f}" in shown
    assert models[0] != models[1]
    assert compress(*command, beside=0.5) == 2
    assert "toml: beside: goes with --cameras" in capsys.readouterr().err
    check_documented("`splatcore compress`", ["psnr_db_beside", *load(facts)])


def test_from_photographs_to_a_model(photographs, tmp_path, capsys):
    """`train`, then `compress --images`: both report PSNR on the held-out photographs."""
    scene, model = tmp_path / "trained.ply", tmp_path / "model"
    assert run("train", str(photographs), "-o", str(scene), "--steps", "30", "--hold-out", "4") == 0
    assert "dB on 3 held-out photographs" in capsys.readouterr().out
    assert read_scene(scene).sh_degree == 3 and len(read_cameras(photographs)) == 9
    options, keys = ("--images", photographs, "--target-ratio", 12), {"hold_out": 4}
    assert compress(scene, model, *options, **keys) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "dB on 3 held-out photographs" in shown and "before" in shown
    (photographs / "images" / "1.png").unlink()
    keys |= {"schedule": [], "distill_steps": 0, "quantize_steps": 0}
    assert compress(scene, tmp_path / "b", *options, **keys) == 0
    assert "1 photographs are missing or broken" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("antialiased", [False, True])
def test_training_with_antialiasing(photographs, tmp_path, antialiased, monkeypatch):
    """`train --antialiased` marks the scene and the JSON; without the option neither is marked."""
    scenes, right = [], compression_run.trained
    monkeypatch.setattr(
        compression_run, "trained", lambda *a: scenes.append(right(*a)) or scenes[0]
    )
    command = ["train", str(photographs), "-o", str(tmp_path / "a.ply"), "--steps", "2"]
    command += ["--json", str(tmp_path / "a.json"), *["--antialiased"] * antialiased]
    assert run(*command) == 0
    assert scenes[0].antialiased == load(tmp_path / "a.json")["antialiased"] == antialiased
    check_documented("`splatcore train`", list(load(tmp_path / "a.json")))


@pytest.mark.parametrize(
    "options, keys, message",
    (
        ("", {"schedule": [0.4, "x"]}, "toml: schedule[1]: 'x' is not a number"),
        ("", {"schedule": [1.2]}, "toml: schedule: 1.2 is not in 0 … 1"),
        ("--max-drop 1", {}, "--max-drop: needs photographs"),
        ("--target-ratio 9999999", {}, "--target-ratio: allows"),
        ("--target-ratio 9 --max-drop 1", {}, "--target-ratio, --max-drop: give only one"),
        ("--images nowhere", {}, "nowhere"),
        ("--size 0x5", {}, "--size 0x5: width 0"),
        ("", {"degree": 4}, "toml: degree: 4 is not in 0 … 3"),
        ("", {"quality": "faithful"}, "toml: quality: faithful needs degree 2 or 3"),
        ("--images nowhere", {"scale": 2}, "toml: scale: 2 is not in 0.001 … 1"),
        ("", {"views": 0}, "toml: views: 0 is not 1 or more"),
        ("", {"hold_out": -1}, "toml: hold_out: -1 is not 0 or more"),
        ("", {"beside": 1.5}, "toml: beside: 1.5 is not in 0 … 1"),
    ),
)
def test_bad_options(scene_file, tmp_path, capsys, options, keys, message):
    model = tmp_path / "m"
    assert compress(scene_file, model, *options.split(), **keys) == 2
    error = capsys.readouterr().err
    assert message in " ".join(error.split()) and not model.exists()


def test_degree_above_the_scene_s(scene_file, tmp_path, capsys, monkeypatch):
    """A degree above the scene's is refused before any picture is rendered."""
    monkeypatch.delattr("splatcore.model.compress.teacher.teacher_targets")
    assert compress(scene_file, tmp_path / "m", degree=2) == 2
    assert "small.ply: degree 2 is above its degree 1" in capsys.readouterr().err


def test_key_of_kept_steps(scene_file):
    """Photographs enter the key by their pixels, rendered views by their cameras alone."""
    scene, views = (
        read_scene(scene_file),
        surrounding_views(generate("garden").gaussians(), 2, 8, 8),
    )

    def key(*images) -> str:
        learn = tuple(Target(view, image, "") for view, image in zip(views, images, strict=True))
        return compress_command._key(scene, learn, Recipe(), DEFAULT)

    black, white = np.zeros((8, 8, 3), np.uint8), np.ones((8, 8, 3), np.uint8)
    assert key(black, black) == key(black, black) != key(black, white)
    own = tuple(OwnPicture(view, None) for view in views)
    keys = [compress_command._key(scene, some, Recipe(), DEFAULT) for some in (own, own[::-1])]
    marked = compress_command._key(replace(scene, antialiased=True), own, Recipe(), DEFAULT)
    assert len({*keys, marked}) == 3


def test_bad_input(scene_file, tmp_path, capsys):
    model = tmp_path / "m.splatcore"
    assert run("pack", str(scene_file), "-o", str(model), "--size", "32x32") == 0
    assert run("compress", str(model), "-o", str(tmp_path / "n")) == 2
    assert "is a packed model already" in capsys.readouterr().err
    assert run("train", str(tmp_path), "-o", str(tmp_path / "s.ply")) == 2
    assert "no cameras.bin or cameras.txt" in capsys.readouterr().err
