"""`splatcore error`: planted faults show in their field, values that are not finite are counted."""

import json
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.points import project_points
from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import camera_beside
from splatcore.spec.camera import look_at
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.error import InputError
from splatcore.study.accuracy import points as error
from splatcore.study.accuracy.points import Reference, measure, measure_view, with_width
from splatcore.study.accuracy.run import HARD_CASES, everything
from tb.helpers.command import check_documented, load, run
from tb.helpers.scenes import random_scene

CAMERA = look_at((0.3, -0.2, -6.0), (0, 0, 0), 64, 48, 60.0, name="front")

WIDE = with_width("8/20")

FIELDS = "depth_stage_0 u v depth conic_a shear conic_c half_width half_height colour".split()


@pytest.fixture(scope="module")
def exact() -> Reference:
    """The reference of a small model with harmonics."""
    return Reference(pack(random_scene(100, 1))[0], CAMERA)


@pytest.fixture(scope="module")
def good(exact) -> dict:
    """The errors of a wide machine."""
    return measure(WIDE, exact, exact)


@pytest.fixture
def fault(monkeypatch):
    """A function that changes one projected value: its name, which Gaussians, the change."""

    def plant(name: str, which, change):
        def disturbed(*arguments):
            points = project_points(*arguments)
            values = np.array(points.projected[name])
            values[which] = change(values[which])
            return replace(points, projected=points.projected | {name: values})

        monkeypatch.setattr(error, "project_points", disturbed)

    return plant


FAULTS = {
    "u": (1.0, {"u"}),
    "v": (-1.0, {"v"}),
    "z": (0.25, {"depth"}),
    "across": (0.25, {"conic_a", "conic_c"}),
    "along": (0.7, {"conic_c"}),
    "shear": (0.7, {"shear", "conic_c"}),
    "half_width": (-0.5, {"half_width"}),
    "half_height": (-0.5, {"half_height"}),
    "green": (0.5, {"colour"}),
}
"""Changed value → the amount, and the fields that must show it."""


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_shows_in_its_field_and_the_picture(exact, good, fault, name):
    amount, reacting = FAULTS[name]
    shift = name in ("u", "v", "green", "shear")
    every_other = slice(None, None, 2)  # so that the order of depths changes
    fault(name, every_other, lambda value: value + amount if shift else value * (1 + amount))
    bad = measure(WIDE, exact, exact)
    assert bad["psnr_db_machine"] < good["psnr_db_machine"] - 20
    for field in FIELDS:
        before, after = good["fields"][field], bad["fields"][field]
        assert (after == before) == (field not in reacting), field
    if len(reacting) == 1 and name != "along":
        (field,) = reacting
        error = bad["fields"][field]
        assert error["max"] == pytest.approx(abs(amount), rel=1e-3)
        part = 1 / 6 if field == "colour" else 1 / 2  # of the values are disturbed
        assert error["rms"] == pytest.approx(abs(amount) * np.sqrt(part), rel=0.2)


def test_stage_0_has_its_own_depth(exact, monkeypatch):
    def disturbed(*arguments):
        points = project_points(*arguments)
        return replace(points, culled=points.culled | {"z": points.culled["z"] * 1.5})

    monkeypatch.setattr(error, "project_points", disturbed)
    fields = measure(WIDE, exact, exact)["fields"]
    assert fields["depth_stage_0"]["rms"] == pytest.approx(0.5, rel=1e-3)
    assert fields["depth"]["rms"] < 1e-5


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_not_finite(exact, good, fault, value):
    """Values that are not finite are counted, and left out of errors and picture."""
    fault("across", slice(0, 3), lambda _: value)
    bad = measure(WIDE, exact, exact)
    assert (bad["not_finite"], bad["not_positive"]) == (3, 0)
    assert all(np.isfinite(size) for f in bad["fields"].values() for size in f.values())
    assert bad["psnr_db_machine"] < good["psnr_db_machine"]
    fault("u", slice(None), lambda _: -value)
    none = measure(WIDE, exact, exact)
    assert none["not_finite"] == none["projected"] and np.isfinite(none["psnr_db_machine"])
    assert none["fields"]["u"] == {"rms": None, "max": None}
    json.dumps(none, allow_nan=False)


def test_overflow():
    """FP16 overflows at a long focal length: the splats are counted, and nothing fails."""
    model = pack(random_scene(20, 1))[0]
    near = replace(CAMERA, fx=6e4, fy=6e4)
    exact = Reference(model, near)
    assert measure(with_width("5/10"), exact, exact)["not_finite"] > 0
    assert measure(DEFAULT, exact, exact)["not_finite"] == 0


@pytest.mark.parametrize("name, value", [("across", 0.0), ("along", -1.0)])
def test_not_positive_definite(exact, good, fault, name, value):
    assert good["not_positive"] == 0
    fault(name, slice(0, 5), lambda _: value)
    assert measure(WIDE, exact, exact)["not_positive"] == 5


def test_lost_and_gained(exact, monkeypatch):
    """Lost splats if the machine drops half of them, gained ones if the reference sees a third."""

    def half(*arguments):
        points = project_points(*arguments)
        projected = points.projected.items()
        few = {name: value[::2] if np.ndim(value) else value for name, value in projected}
        return replace(points, index=points.index[::2], projected=few)

    visible = exact.splats.index
    monkeypatch.setattr(error, "project_points", half)
    bad = measure(DEFAULT, exact, exact)
    kept = np.isin(visible, half(DEFAULT, exact.model, CAMERA).index)
    assert bad["lost"] == (~kept).sum() > 0 and bad["gained"] == 0
    assert bad["visible"] == len(visible)
    monkeypatch.undo()
    few = Reference(exact.model, CAMERA)
    few.__dict__["splats"] = exact.splats[::3]
    result = measure(DEFAULT, few, exact)
    assert result["gained"] == len(visible) - len(few.splats) and result["lost"] == 0


def test_more_bits_are_better(exact):
    """Errors shrink with the added bits, in fields of any unit; colours do not change, as they
    are computed outside the array in their own format."""
    results = [measure(with_width(text), exact, exact) for text in ("5/10", "7/10", "7/16")]
    colours = [result["fields"].pop("colour")["rms"] for result in results]
    assert max(colours) < 2.0**-12 and max(colours) < 1.1 * min(colours)
    for half, coarse, fine in zip(*(result["fields"].values() for result in results), strict=True):
        assert 16 < coarse["rms"] / fine["rms"] < 256
        assert 0.3 < half["rms"] / coarse["rms"] < 10
    assert results[1]["psnr_db_machine"] + 25 < results[2]["psnr_db_machine"]


def test_needles_stay_positive_definite():
    machines = (PAPER, with_width("7/10"), DEFAULT)
    facts = measure_view(View("needles"), machines, lambda text: None)
    assert facts["axis_ratio"] == pytest.approx(1e5, rel=0.02)
    names = [config.name for config in machines]
    assert facts["screen_ratio"] > 50 and list(facts["machines"]) == names
    for result in facts["machines"].values():
        assert result["not_positive"] == 0 and result["lost"] == 0
    assert facts["machines"]["DEFAULT"]["psnr_db_machine"] > 70
    paper = facts["machines"]["PAPER"]
    assert paper["psnr_db_machine"] != paper["psnr_db_default_model"]


def test_an_infinite_axis_ratio():
    scene = random_scene(20, 0)
    scene.scale[3, 1] = 0
    assert Reference(pack(scene)[0], CAMERA).axis_ratio is None


def test_widths():
    assert with_width("7/16").arithmetic == DEFAULT.arithmetic
    assert with_width("7/16").depth == replace(DEFAULT.depth, fraction=16)
    small = with_width("5/10")
    assert (small.arithmetic, small.depth) == (PAPER.arithmetic, PAPER.depth)
    assert small.screen_exponent == PAPER.screen_exponent and small.position == DEFAULT.position
    for text in ("7", "7/2", "7/24", "3/10", "11/10", "a/b", "7/16/2", ""):
        with pytest.raises(InputError, match=f"--width '{text}'"):
            with_width(text)


def test_scenes_and_their_cameras(tmp_path, monkeypatch, capsys):
    for name in ("a.ply", "b-top10.compressed.ply", "ab.spz", "b.cameras.json", "b-top10.cameras"
                 ".json", "a.cameras.json", "notes.md"):  # fmt: skip
        (tmp_path / name).write_text("")
    assert camera_beside(tmp_path / "ab.spz") is None
    assert camera_beside("garden") is None
    found = everything(str(tmp_path), None, "32x18")
    assert list(found) == ["a.ply", "ab.spz", "b-top10.compressed.ply", *HARD_CASES]
    first, second, third, hard = list(found.values())[:4]
    assert first.camera_text == str(tmp_path / "a.cameras.json") and second.camera_text is None
    assert third.camera_text == str(tmp_path / "b-top10.cameras.json")
    assert (third.size, hard) == ("32x18", View(HARD_CASES[0]))
    monkeypatch.setenv("SPLATCORE_SCENES", str(tmp_path))
    assert "a.ply" in everything(None, None, None)
    monkeypatch.setenv("SPLATCORE_SCENES", str(tmp_path / "none"))
    assert everything(None, None, None)["garden"] == View("garden")
    assert f"no folder {tmp_path / 'none'}" in capsys.readouterr().err.replace("\n", "")
    with pytest.raises(InputError, match=r"--scenes .*none: no such folder"):
        everything(str(tmp_path / "none"), None, None)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"--scenes .*empty: holds no scene"):
        everything(str(tmp_path / "empty"), None, None)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a small scene and its camera."""
    monkeypatch.chdir(tmp_path)
    write_ply("scene.ply", random_scene(100, 1))
    (tmp_path / "scene.cameras.json").write_text(cameras_json([CAMERA]))
    return tmp_path


def test_command(folder, capsys):
    assert run("error", "scene.ply", "--preset", "paper", "--width", "7/10", "--width", "7/16",
               "-o", "plot.png", "--json", "e.json") == 0  # fmt: skip
    result = load(folder / "e.json")
    printed = capsys.readouterr()
    assert "scene.ply: PAPER" in printed.err and "PSNR of the pictures" in printed.out
    assert "half height" in printed.out and "…" not in printed.out
    assert list(result["machines"]) == ["PAPER", "7/10", "7/16"]
    facts = result["scenes"]["scene.ply"]
    assert facts["camera"] == "scene.cameras.json" and facts["size"] == [64, 48]
    assert list(facts["machines"]["7/16"]["fields"]) == FIELDS
    fields = {name: found["fields"] for name, found in facts["machines"].items()}
    assert result["largest"] == {"scenes": fields}
    assert read_png("plot.png").std() > 5
    for keys in (result, result["machines"]["PAPER"], facts, facts["machines"]["PAPER"], FIELDS):
        check_documented("## `splatcore error`", keys)


@pytest.mark.slow
def test_processes(folder, capsys):
    """Several scenes, one process per scene; a failure there prints one line."""
    assert run("error", "one", "scene.ply", "one_pixel", "one", "--width", "7/16",
               "--json", "e.json", "-o", "plot.png") == 0  # fmt: skip
    result = load(folder / "e.json")
    assert list(result["scenes"]) == ["one", "scene.ply", "one_pixel"]
    assert set(result["largest"]) == {"scenes", "hard"}
    alone = measure_view(View("scene.ply", file="scene.cameras.json"), (with_width("7/16"),), print)
    together = result["scenes"]["scene.ply"]["machines"]["7/16"]
    assert together["psnr_db_machine"] == pytest.approx(
        alone["machines"]["7/16"]["psnr_db_machine"], abs=1e-6
    )
    (folder / "bad.ply").write_text("ply\nbad")
    capsys.readouterr()
    assert run("error", "bad.ply", "one", "--width", "7/16") == 2
    assert "error: bad.ply: " in capsys.readouterr().err
