"""`splatcore bench compression`: steps against values computed here, resuming, failures."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from splatcore.golden import pipeline
from splatcore.golden.reference import render
from splatcore.model.cameras.orbit import BESIDE, views_beside
from splatcore.model.cameras.view import core_of
from splatcore.model.compress.checkpoint import ply_bytes
from splatcore.model.formats.camera_file import cameras_json, read_cameras
from splatcore.model.formats.model_file import read_model
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.metric import difference, flip
from splatcore.sim.frame.picture import read_png
from splatcore.spec.config import DEFAULT
from splatcore.study.compression import bench as bench_compression
from splatcore.study.compression import measure as compression_measure
from splatcore.study.compression.measure import compared, mean
from tb.helpers.command import check_documented, check_refused, load
from tb.helpers.compression_stand_in import (
    BENCH,
    COUNT,
    Interrupt,
    bench,
    held_out,
    scenes,
    small,
)

pytestmark = pytest.mark.compress

pytest.importorskip("flip_evaluator")


def test_steps(fake, tmp_path, capsys):
    """Sizes, ratios, quality, changes and work of the steps equal values computed here."""
    assert bench("a.ply", "--part", "steps,budget", "--steps", "5") == 0
    facts = load(tmp_path / "out" / "compression.json")
    scene = facts["scenes"]["a.ply"]
    rows = scene["steps"]["rows"]
    assert [row["kind"] for row in rows] == ["original", "distill", *["prune"] * 4, "quantize"]
    assert [row["gaussians"] for row in rows[1:6]] == [600, 360, 216, 130, 104]
    assert facts["failed"] == [] and scene["against"] == "original" and scene["views"] == 2
    assert rows[0] | {"psnr_db": None, "ratio": 1.0, "ssim": 1.0, "flip": 0.0} == rows[0]
    assert scene["ply_bytes"] == rows[0]["bytes"] == ply_bytes(600, 3)
    original = read_scene("a.ply")
    cut = original.with_sh_degree(1)
    for count in (360, 216):
        cut = cut[np.linspace(0, len(cut) - 1, count).astype(int)]
    truths = [render(original.gaussians(), camera).pixels for camera in held_out()]
    found = [render(cut.gaussians(), camera).pixels for camera in held_out()]
    metrics = [difference(a, b) for a, b in zip(found, truths, strict=True)]
    row = rows[3]
    assert row["psnr_db"] == pytest.approx(np.mean([m.psnr_db for m in metrics]), abs=0.01)
    assert row["psnr_db_min"] == pytest.approx(min(m.psnr_db for m in metrics), abs=0.01)
    assert row["max_error"] == pytest.approx(max(m.max_error for m in metrics), abs=0.01)
    flips = [flip(a, b) for a, b in zip(found, truths, strict=True)]
    assert row["flip"] == pytest.approx(np.mean(flips), abs=1e-4) == row["flip_change"]
    assert row["ssim_change"] == pytest.approx(row["ssim"] - 1) and row["psnr_db_change"] is None
    assert row["ratio"] == ply_bytes(600, 3) / ply_bytes(216, 1)
    assert row["bytes_each"] == ply_bytes(216, 1) / 600
    frames = [pipeline.render(DEFAULT, pack(cut, DEFAULT)[0], camera) for camera in held_out()]
    work = row["work"]
    assert work["splats"] == np.mean([frame.counts["splats"] for frame in frames])
    assert work["tile_pairs"] == np.mean([frame.counts["tile_pairs"] for frame in frames])
    cycles = np.mean([frame_cycles(DEFAULT, frame).frame for frame in frames])
    assert work["cycles"] == cycles and work["fps_at_800mhz"] == 8e8 / cycles
    model = scene["budget"]["model"]
    assert model["psnr_db"] == rows[-1]["psnr_db"] and model["max_error"] == rows[-1]["max_error"]
    printed = capsys.readouterr().out
    assert "quantize" in printed and "error budget" in printed and "cycles, k" in printed
    assert read_png("out/a.ply.png").std() > 5


def test_beside(fake, tmp_path, capsys):
    """The off-path PSNR is measured at the held-out cameras, moved by each offset."""
    assert bench("a.ply", "--part", "steps", "--steps", "5") == 0
    first, *_, last = scenes()["a.ply"]["steps"]["rows"]
    assert first["psnr_db_beside_mean"] is None and set(first["psnr_db_beside"].values()) == {None}
    original, left, right = read_scene("a.ply").gaussians(), *held_out()
    there = views_beside([left, right], core_of(original).middle)
    step, = (Path("out") / "runs").glob("*/*quantize.splatcore")  # fmt: skip
    model = read_model(step).gaussians()
    for number, (name, found) in enumerate(last["psnr_db_beside"].items()):
        camera = there[name][number % 2]
        pictures = (render(each, camera).pixels for each in (model, original))
        assert found == pytest.approx(difference(*pictures).psnr_db), name
    values = list(last["psnr_db_beside"].values())
    assert last["psnr_db_beside_mean"] == pytest.approx(np.mean(values))
    assert "15 degrees, dB" in capsys.readouterr().out
    assert "15 degrees psnr_db" in (Path("out") / "steps.csv").read_text().splitlines()[0]
    assert bench("a.ply", "--part", "steps", "--steps", "5", "--beside", "0.5") == 0
    assert fake.calls.count("teacher 480 1920x1080 0, 2 cameras, 0.5 beside") == 1
    write_ply("b.ply", small(300))
    assert bench("b.ply", "--part", "steps") == 0
    assert "psnr_db_beside" not in scenes()["b.ply"]["steps"]["rows"][-1]


def test_existing_results_are_reused(fake, tmp_path, monkeypatch):
    """A second call compresses and measures nothing, and writes the same files."""
    arguments = ("a.ply", "--steps", "5", "--ratios", "12", "--schedule-scene", "a.ply")
    assert bench(*arguments) == 0
    names = ("compression.json", "steps.csv", "schedule.csv", "curve.csv", "budget.csv")
    first = {name: (tmp_path / "out" / name).read_bytes() for name in names}
    done = list(fake.calls)
    assert done.count("teacher 480 1920x1080 0, 2 cameras, 1 beside") == 1

    def never(*_):
        raise AssertionError("rendered again")

    for module in (compression_measure, pipeline):
        monkeypatch.setattr(module, "render", never)
    assert bench(*arguments) == 0
    assert fake.calls == done
    assert first == {name: (tmp_path / "out" / name).read_bytes() for name in names}


def test_goes_on_after_an_interrupt(fake, tmp_path):
    fake.stop_after = "prune (2)"
    with pytest.raises(Interrupt):
        bench("a.ply", "--part", "steps")
    fake.stop_after = None
    assert bench("a.ply", "--part", "steps") == 0
    for name in ("original", "distill 1", "prune (2)", "prune (3)", "prune (5)"):
        assert fake.calls.count(name) == 1, name


def test_options_and_sources_decide(fake, tmp_path, monkeypatch):
    """Other options start another compression and keep the first; other sources remeasure."""
    for steps in ("5", "6", "5"):
        assert bench("a.ply", "--part", "budget", "--steps", steps) == 0
    called = [call for call in fake.calls if call.startswith("compress")]
    assert called == 4 * ["compress 600 None"]  # distillation, then the rest, for 5 steps and for 6
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 4
    measured = tmp_path / "out" / "measured"
    before = len(list(measured.iterdir()))
    monkeypatch.setattr(compression_measure, "code_key", lambda _: "others")
    assert bench("a.ply", "--part", "budget", "--steps", "5") == 0
    assert len(list(measured.iterdir())) == before + 2
    first = (tmp_path / "out" / "compression.json").read_text()
    for path in measured.iterdir():
        path.write_text(path.read_text()[:-20])
    assert bench("a.ply", "--part", "budget", "--steps", "5") == 0
    assert (tmp_path / "out" / "compression.json").read_text() == first


def test_other_views_are_another_compression(fake, tmp_path):
    """Other views, or other cameras in the scene's camera file, start another compression."""
    for views in ("5", "6", "5"):
        assert bench("a.ply", "--part", "budget", "--views", views) == 0
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 4
    one = read_cameras("a.cameras.json")[:1]
    (tmp_path / "a.cameras.json").write_text(cameras_json(one))
    assert bench("a.ply", "--part", "budget", "--views", "5") == 0
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 6


@pytest.fixture
def second(fake, tmp_path):
    """A second scene, b.ply."""
    write_ply("b.ply", small(300))
    (tmp_path / "b.cameras.json").write_text((tmp_path / "a.cameras.json").read_text())


def test_failure_of_one_scene_leaves_the_others(fake, second, tmp_path, capsys):
    (tmp_path / "c.ply").write_bytes((tmp_path / "a.ply").read_bytes()[:9999])
    fake.breaks_at = 300
    assert bench("c.ply", "b.ply", "a.ply", "--part", "budget") == 1
    facts = load(tmp_path / "out" / "compression.json")
    assert [failure["what"] for failure in facts["failed"]] == ["c.ply: budget", "b.ply: budget"]
    assert list(facts["scenes"]) == ["a.ply"]
    error = capsys.readouterr().err
    assert "missing: c.ply: budget: c.ply: " in error
    assert "missing: b.ply: budget: FloatingPointError: the loss is NaN at step 7" in error


def test_a_failure_removes_the_old_result(fake, tmp_path):
    """If a part fails when measured again, its old result is removed."""
    assert bench("a.ply", "--part", "budget,curve", "--ratios", "12") == 0
    fake.breaks_at = COUNT
    assert bench("a.ply", "--part", "budget", "--steps", "5") == 1
    scene = scenes()["a.ply"]
    assert "budget" not in scene and "curve" in scene


def test_results_of_other_scenes_stay(second):
    assert bench("a.ply", "--part", "budget") == 0
    assert bench("b.ply", "--part", "curve", "--ratios", "3") == 0
    found = scenes()
    assert set(found) == {"a.ply", "b.ply"}
    assert "budget" in found["a.ply"] and "curve" in found["b.ply"]
    assert bench("b.ply", "--part", "curve", "--ratios", "3", "--seed", "1") == 0
    assert set(scenes()) == {"b.ply"}


def test_mean():
    numbers = (30.0, 0.1), (40.0, 0.5), (None, 0.0)
    rows = [{"psnr_db": psnr, "max_error": error, "lpips": None} for psnr, error in numbers]
    wanted = {"psnr_db": 35.0, "psnr_db_min": 30.0, "max_error": 0.5, "lpips": None}
    assert mean(rows) == wanted and mean([{"model": row} for row in rows]) == {"model": wanted}


def test_degree(fake, second, tmp_path):
    """`--degree` applies to every model; results of another degree are removed, and a scene of
    lower degree fails."""
    write_ply("b.ply", small(300).with_sh_degree(1))
    assert bench("a.ply", "--part", "budget") == 0
    arguments = ("a.ply", "b.ply", "--degree", "2", "--ratios", "9", "--part", "steps,curve")
    assert bench(*arguments) == 1
    facts = load(tmp_path / "out" / "compression.json")
    assert facts["degree"] == 2 and list(facts["scenes"]) == ["a.ply"]
    why = [failure["why"] for failure in facts["failed"]]
    assert why == 2 * ["b.ply: --degree 2 is above its degree 1"]
    scene = facts["scenes"]["a.ply"]
    assert set(scene) & {"steps", "curve", "budget"} == {"steps", "curve"}
    alone, point = scene["curve"]["points"]
    packing = {"sh_degree": 2, "quality": "balanced"}
    model = pack(read_scene("a.ply"), DEFAULT, **packing)[0]
    assert (alone["sh_degree"], alone["bytes"]) == (2, len(model.image))
    assert point["sh_degree"] == 2 and point["ratio"] == pytest.approx(9, rel=0.03)
    assert [row["sh_degree"] for row in scene["steps"]["rows"]] == [3, *6 * [2]]
    assert fake.calls.count("distill 2") == 1, "both parts make use of one distillation"


def test_equal_pictures():
    image = np.random.default_rng(0).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    found = compared(image, image)
    assert found["psnr_db"] is None and found["ssim"] == pytest.approx(1) and found["flip"] == 0


@pytest.mark.parametrize(
    "arguments, message",
    {
        "a.ply --part steps,dance": "--part 'dance': unknown; choose steps, schedule",
        "a.ply --ratios 10,x": "--ratios '10,x': must be numbers",
        "a.ply --ratios 0.5": "--ratios '0.5': must all be above 1",
        "a.ply --steps -1": "--steps -1: must be 0 or more",
        "a.ply --views 0": "--views 0: must be 1 or more",
        "a.ply --scale 2": "--scale 2: must be above 0",
        "a.ply --schedule-scene b": "--schedule-scene b: must be one of a.ply",
        "a.ply --view-size 9": "--size '9': is not WIDTHxHEIGHT",
        "a.ply --process 130": "--process 130.0: goes with --liberty only",
        "a.ply --beside 2": "--beside",
        "none.ply": "none.ply: no such file or folder, here or in",
        "a.ply ./a.ply": "a.ply: two scenes have this name",
        "a.splatcore": "a.splatcore: is a packed model",
        "a.ply --preset HUGE": "HUGE",
    }.items(),
)
def test_bad_input(arguments, message, fake, tmp_path, capsys):
    pack(small(20), DEFAULT)[0].image.tofile("a.splatcore")
    check_refused(capsys, f"{BENCH} {arguments}", re.escape(message))
    assert not (tmp_path / "out").exists()


def test_json_is_documented(fake, tmp_path):
    assert bench("a.ply", "--ratios", "12", "--steps", "5") == 0

    def keys(value: object):
        if isinstance(value, list):
            for item in value:
                yield from keys(item)
        elif isinstance(value, dict):
            for key, item in value.items():
                yield key
                yield from keys(item)

    facts = load(tmp_path / "out" / "compression.json")
    facts["scenes"] = list(facts["scenes"].values())
    for scene in facts["scenes"]:
        scene["steps"].pop("recipe"), scene["curve"].pop("recipe")
        for row in (*scene["steps"]["rows"], *scene["curve"]["points"]):
            assert set(row.pop("psnr_db_beside")) == set(BESIDE)
    check_documented("## `splatcore bench compression`", set(keys(facts)))
    assert bench_compression.BY_ITSELF == ("steps", "schedule", "curve", "budget")
    json.dumps(facts, allow_nan=False)
