"""`splatcore bench compression`: its parts curve, schedule, budget and power, and photographs."""

import csv
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.eda.power.estimate import estimate, gates_of
from splatcore.golden.reference import render
from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.recipe import Recipe
from splatcore.model.formats.photographs import Target
from splatcore.model.formats.read import read_scene
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import difference
from splatcore.sim.frame.picture import read_png
from splatcore.spec.config import DEFAULT
from splatcore.study.compression import plot, power
from splatcore.study.compression import run as compression_run
from splatcore.study.compression.bench import SCHEDULES, equal_rates, left
from splatcore.study.compression.subjects import Protocol
from tb.helpers.command import check_documented
from tb.helpers.compression_stand_in import bench, held_out, scenes, small
from tb.helpers.power import CLOCKS, COUNTS, GATES, SIZES

pytestmark = pytest.mark.compress

pytest.importorskip("flip_evaluator")


def photographs() -> tuple[Target, ...]:
    """Stand-ins for photographs: renderings of the scene from nine cameras."""
    cameras = [
        replace(camera, cx=camera.cx + k, name=str(k))
        for k, camera in enumerate([held_out()[0]] * 9)
    ]
    scene = read_scene("a.ply").gaussians()
    return tuple(Target(c, render(scene, c).pixels, f"{c.name}.jpg") for c in cameras)


def test_photographs(fake, tmp_path, monkeypatch, capsys):
    """A baseline is trained once; changes are relative to its quality on held-out photographs."""
    found = SimpleNamespace(targets=photographs(), notes=("2 photographs are missing",))
    asked = []
    for name, function in {
        "read_photographs": lambda path, scale: asked.append((path, scale)) or found,
        "read_points": lambda path: (np.zeros((1, 3)), np.zeros((1, 3), np.uint8)),
    }.items():
        monkeypatch.setattr(compression_run, name, function)
    (tmp_path / "shots").mkdir()
    for _ in range(2):
        arguments = ("shots", "--ratios", "12", "--train-steps", "9", "--scale", "0.5")
        assert bench(*arguments) == 0
    assert fake.calls.count("train 7 9") == 1 and asked[0] == ("shots", 0.5)
    assert not [call for call in fake.calls if call.startswith("teacher")]
    scene = scenes()["shots"]
    assert scene["against"] == "photographs" and scene["views"] == 2 and scene["size"] == [96, 64]
    assert scene["ply_bytes"] == ply_bytes(300, 3)
    first, *_, last = scene["steps"]["rows"]
    quality = [
        difference(render(small(300).gaussians(), target.camera).pixels, target.image).psnr_db
        for target in found.targets[::7]
    ]
    assert first["psnr_db"] == pytest.approx(np.mean(quality), abs=0.02)
    assert first["psnr_db_change"] == 0 and last["psnr_db_change"] < 0
    assert last["psnr_db_change"] == last["psnr_db"] - first["psnr_db"]
    assert scene["curve"]["points"][0]["psnr_db_change"] is not None
    assert len(scene["schedule"]["rows"]) == len(SCHEDULES)
    assert "shots: 2 photographs are missing" in capsys.readouterr().err
    assert (tmp_path / "out" / "shots.png").exists()


def test_curve(fake, tmp_path, capsys):
    """Ratios below packing alone, and unreachable ratios, have a note instead of a result."""
    assert bench("a.ply", "--part", "curve", "--ratios", "2,9,10.5,14,500") == 0
    points = scenes()["a.ply"]["curve"]["points"]
    model = pack(read_scene("a.ply"), DEFAULT)[0]
    alone = ply_bytes(600, 3) / len(model.image)
    assert points[0]["ratio"] == pytest.approx(alone) and points[0]["target_ratio"] is None
    reached = [point for point in points[1:] if point["ratio"]]
    assert [point["target_ratio"] for point in points[1:]] == [2, 9, 10.5, 14, 500]
    for point in reached:
        assert point["ratio"] == pytest.approx(point["target_ratio"], rel=0.02)
        assert not point["note"]
    assert points[1]["note"] == f"packing alone gives {alone:.1f}×"
    assert points[-1]["note"] == "--target-ratio 500: cannot be reached"
    losses = [point["psnr_db"] for point in points if point["ratio"]]
    assert len(reached) == 3 and losses == sorted(losses, reverse=True)
    runs = [path for path in (tmp_path / "out" / "runs").iterdir() if path.is_dir()]
    kept = sorted(len(list(run.iterdir())) for run in runs)
    assert kept == [2, 2, 2, 3, 3], "steps.json, the model and the distilled scene stay"
    assert read_png("out/curve.png").std() > 5
    assert "reached" in capsys.readouterr().out


def test_missed_ratio_is_noted(fake, tmp_path, monkeypatch):
    compress = fake.compress

    def short(*arguments):
        *others, original = arguments
        return compress(*others, original / 0.8)

    monkeypatch.setattr(sys.modules["splatcore.model.compress.compress"], "compress", short)
    assert bench("a.ply", "--part", "curve", "--ratios", "15") == 0
    point = scenes()["a.ply"]["curve"]["points"][1]
    assert point["note"] == f"reached only {point['ratio']:.1f}×" and point["ratio"] < 12.5


def test_share_left_by_schedules():
    assert left(SCHEDULES[0]) == pytest.approx(0.1728)
    for schedule in (SCHEDULES[1], SCHEDULES[-1]):
        assert left(schedule) == pytest.approx(0.1728, abs=1e-5)
    assert len(SCHEDULES[1]) == 1 and len(SCHEDULES[-1]) == 5
    assert equal_rates(1) == pytest.approx((0.8272,))


def test_schedule(fake, tmp_path, capsys):
    """All schedules have the same number of fine-tuning steps, and end after pruning."""
    assert bench("a.ply", "--part", "schedule", "--steps", "10", "--schedule-scene", "a.ply") == 0
    found = scenes()["a.ply"]["schedule"]
    assert found["steps_in_all"] == 40
    rows = found["rows"]
    assert [row["steps"] * len(row["schedule"]) for row in rows] == 6 * [40]
    assert [tuple(row["schedule"]) for row in rows] == list(SCHEDULES)
    assert [row["gaussians"] for row in rows] == [104, 104, 78, 91, 117, 103]
    assert [row["gaussians_before"] for row in rows] == [130, 600, 130, 130, 130, 147]
    assert fake.calls.count("distill 1") == 1, "all make use of one distillation"
    done = len(fake.calls)
    assert "40 fine-tuning steps in total" in " ".join(capsys.readouterr().out.split())
    assert bench("a.ply", "--part", "steps", "--steps", "10") == 0
    later = fake.calls[done:]
    assert later and not any(call.startswith("prune") for call in later), "its run goes on"


def test_curve_of_both_kinds(tmp_path, monkeypatch):
    """One row of plots for photographs and one for originals: PSNR over ratio, bytes and speed,
    points joined in the order of ratios; without points nothing is drawn."""

    def scene(against: str) -> dict:
        points = [
            {"target_ratio": r if k else None, "ratio": r, "psnr_db": 40 - k, "psnr_db_change": -k}
            | {"bytes_each": 300 / r, "work": {"fps_at_800mhz": (100.0, 300.0, 200.0)[k]}}
            for k, r in enumerate((8.0, 20.0, 51.6))
        ]
        return {"against": against, "curve": {"points": [*points[::-1], {"ratio": None}]}}

    drawn, write = {}, plot.write_figure

    def noted(path, figure, **options):
        drawn[path.name] = [axes.lines[0].get_xydata() for axes in figure.axes]
        write(path, figure, **options)

    monkeypatch.setattr(plot, "write_figure", noted)
    plot.write_curve(tmp_path / "none.png", {"a": {"against": "original"}})
    assert not (tmp_path / "none.png").exists()
    plot.write_curve(tmp_path / "one.png", {"a": scene("original")})
    plot.write_curve(tmp_path / "two.png", {"a": scene("original"), "b": scene("photographs")})
    one, two = (read_png(tmp_path / name) for name in ("one.png", "two.png"))
    assert two.shape[0] == pytest.approx(2 * one.shape[0], abs=2)
    ratio, each, speed = drawn["one.png"]
    assert ratio.tolist() == [[8.0, 40], [20.0, 39], [51.6, 38]]
    assert each.tolist() == [[37.5, 40], [15.0, 39], [300 / 51.6, 38]]
    assert speed.tolist() == [[100.0, 40], [300.0, 39], [200.0, 38]]
    changes = [line[:, 1].tolist() for line in drawn["two.png"][:3]]
    assert changes == [[0, -1, -2]] * 3


def test_budget_separates_model_and_machine(fake, tmp_path):
    """The budget separates the model's error from the machine's, which is far smaller."""
    assert bench("a.ply", "--part", "budget") == 0
    found = scenes()["a.ply"]["budget"]
    model, machine, both = (found[name]["psnr_db"] for name in ("model", "machine", "both"))
    assert machine > 45 > model + 5
    assert both == pytest.approx(model, abs=0.2) and both != model
    with open(tmp_path / "out" / "budget.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["error"] for row in rows] == ["model", "machine", "both"]
    assert float(rows[1]["psnr_db"]) == machine


def test_slim_keeps_the_last(tmp_path):
    """`slim` deletes all checkpoints except the last."""
    kept = Checkpoints(tmp_path / "run", "key")
    scene = small(20)
    for name in ("original", "prune 0.4"):
        kept.save(name, name.split()[0], scene)
    stand = compression_run.Run.__new__(compression_run.Run)
    stand.checkpoints = kept
    stand.slim()
    assert sorted(p.name for p in kept.folder.iterdir()) == ["01-prune-0.4.npz", "steps.json"]


def test_steps_of_a_recipe():
    """Distillation steps scale with `--steps`."""
    recipe, default = Protocol(DEFAULT, steps=50, seed=7).recipe, Recipe()
    assert recipe.steps == 50 and recipe.seed == 7
    assert recipe.distill_steps / 50 == default.distill_steps / default.steps
    assert Protocol(DEFAULT).recipe == default


def gates(config, library, process, advance):
    """Replaces synthesis: gates of a fixed machine."""
    return GATES if library else gates_of(SIZES, config.energy)


def test_power(fake, tmp_path, monkeypatch, liberty_path, capsys):
    """Each step's power equals the estimate for the model of that step, by gates and in cells."""
    seen = []

    def counts(config, job, sample, label):
        seen.append((job.model, job.camera))
        return replace(COUNTS, cycles=1000 * len(job.model))

    monkeypatch.setattr(power, "counts_of", counts)
    monkeypatch.setattr(power, "machine_gates", gates)
    monkeypatch.setattr(power, "clocked", lambda config, registers: CLOCKS)
    asked = "a.ply", "--part", "power", "--steps", "5"
    assert bench(*asked, "--liberty", str(liberty_path), "--process", "130") == 0
    found, energy = scenes()["a.ply"]["power"], DEFAULT.energy
    assert found["size"] == [96, 64] and (found["view"], found["library"]) == ("left", "small")
    assert [row["step"] for row in found["rows"]][::6] == ["original", "quantize"]
    for row, (model, camera) in zip(found["rows"], seen, strict=True):
        counted = replace(COUNTS, cycles=1000 * row["gaussians"])
        plain = estimate(counted, gates_of(SIZES, energy), CLOCKS, energy)
        fps = min(129, plain.fps_max)
        assert repr(camera) == repr(held_out()[0]) and row["fps"] == fps
        assert row["power_w"] == plain.power(fps) == pytest.approx(row["frame_j"] * fps)
        assert (
            row["cells_w"] == estimate(counted, GATES, CLOCKS, energy).power(fps) != row["power_w"]
        )
        assert row["traffic_bytes"] == sum(COUNTS.traffic.values())
        assert (row["gaussians"], row["bytes"]) == (len(model), len(model.image))
    first, second, *_, last = seen
    exact = pack(read_scene("a.ply"), DEFAULT, quality="balanced")[0]
    assert np.array_equal(first[0].image, exact.image) and first[0].format.sh_degree == 3
    assert second[0].format.sh_degree == last[0].format.sh_degree == 1
    assert "power in cells, mW" in " ".join(capsys.readouterr().out.split())
    assert bench("a.ply", "--liberty", str(liberty_path), "--process", "130") == 2
    assert "small.lib: goes with --part power only" in capsys.readouterr().err
    assert bench(*asked) == 0
    assert "library" not in scenes()["a.ply"]["power"]
    assert (tmp_path / "out" / "power.csv").exists()
    check_documented("## `splatcore bench compression`", {*found, *found["rows"][0]})
