"""Campaigns: results are kept, failures named, other tasks survive; sweep, ablation."""

import pickle
import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from distributed import LocalCluster

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.common.pool import how_ended
from splatcore.sim.common.sources import code_key
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.choose import packed
from splatcore.sim.frame.shot import Shot, View
from splatcore.sim.frame.source import Source
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import DEFAULT, PRESETS, TINY
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.study.bench import scenes
from splatcore.study.bench.campaign import Failure, Task, results
from splatcore.study.bench.campaigns import ablation_machines, confirmed, front, summary
from splatcore.study.bench.sweep import LANES, SPEED, Point, measure, picture_of, points
from tb.helpers.campaign_tasks import crash, die, double
from tb.helpers.command import load
from tb.helpers.command import run as command

SIZE = "96x80"
GARDEN = View("garden", "", SIZE)


def task(number: int, log, function=double) -> Task:
    return Task(f"number {number}", str(number), function, (number, str(log)))


def run(tasks: list[Task], folder, scheduler=None) -> dict:
    return {task.name: found for task, found in results(tasks, folder, scheduler, "test")}


@pytest.mark.slow
def test_results_are_kept(tmp_path):
    """Only tasks with a missing, broken or outdated result run again."""
    log = tmp_path / "log"
    tasks = [task(number, log) for number in range(3)]
    first = run(tasks, tmp_path / "parts")
    assert {name: found["value"] for name, found in first.items()} == {
        "number 0": 0, "number 1": 2, "number 2": 4,
    }  # fmt: skip
    (tmp_path / "parts" / "number 1.json").write_text("{broken")
    other = replace(tasks[2], about="another")
    again = run([tasks[0], tasks[1], other], tmp_path / "parts")
    assert again["number 2"]["value"] == 4
    assert sorted(log.read_text().split()) == ["0", "1", "1", "2", "2"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "cluster",
    [False, pytest.param(True, marks=pytest.mark.verify)],
    ids=["processes", "cluster"],
)
def test_failures_are_named_and_lose_nothing(tmp_path, cluster):
    """One task raises and one kills its process; all other tasks return their results."""
    tasks = [task(n, tmp_path / "log") for n in (0, 1, -1, 2)]
    tasks.insert(3, task(9, tmp_path / "log", die))
    if cluster:  # workers of a Dask scheduler
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as workers:
            found = run(tasks, tmp_path / "parts", workers.scheduler_address)
    else:
        found = run(tasks, tmp_path / "parts")
    lost = found.pop("number 9")
    assert cluster or lost == Failure("number 9", "its process ended with status 1")
    assert isinstance(lost, Failure)
    assert found.pop("number -1") == Failure("number -1", "ValueError: -1 is negative")
    assert {name: f["value"] for name, f in found.items()} == {
        f"number {n}": 2 * n for n in range(3)
    }


@pytest.mark.slow
def test_signals_are_named(tmp_path):
    """Only SIGKILL, by which the kernel frees memory, is said to be of memory."""
    signals = {signal.SIGSEGV: "", signal.SIGKILL: ", maybe out of memory", signal.SIGTERM: ""}
    for number, why in signals.items():
        found = run([task(number, tmp_path / "log", crash)], tmp_path / "parts")
        text = f"its process ended by signal {number:d} ({number.name}){why}"
        assert [*found.values()] == [Failure(f"number {number}", text)]


def test_the_lost_process_is_named_among_terminated_ones():
    assert how_ended([0, -15, -11, -15]) == "ended by signal 11 (SIGSEGV)"
    assert how_ended([-15, 3]) == "ended with status 3"


def test_speed_changes_no_picture():
    """Machines that differ only in `SPEED` fields share picture and counts, but not cycles."""
    model, camera = pack(generate("garden", 2000), DEFAULT)[0], generated_camera("garden", 200, 150)
    fast = replace(DEFAULT, rasterizers=8, pe_arrays=2, sub_sorters=4, skip_zeros=False)
    assert picture_of(fast) == picture_of(DEFAULT)
    one, other = (render(config, model, camera) for config in (DEFAULT, fast))
    assert np.array_equal(one.pixels, other.pixels) and one.counts == other.counts
    assert frame_cycles(DEFAULT, one) != frame_cycles(fast, one)
    assert all(hasattr(DEFAULT, name) for name in SPEED)
    assert picture_of(replace(DEFAULT, weight=10)) != picture_of(DEFAULT)


def test_points_are_different():
    """All points are different machines with different names, and list the fields they change."""
    found = list(points())
    assert len({replace(point.config, name="") for point in found}) == len(found)
    assert len({point.name for point in found}) == len(found)
    assert all(point.fields for point in found if point.name != "DEFAULT")


def test_front():
    """The front excludes a point if another is at least as good in all and better in one value."""
    values = {"a": (10, 5, 5, 60), "b": (10, 5, 6, 60), "c": (9, 5, 7, 60), "d": (11, 5, 4, 50)}
    values |= {"e": values["a"], "f": (10, 4, 6, 60)}
    names = ("frame_cycles_max", "frame_cycles_mean", "nand2", "psnr_db_machine_mean")
    found = {name: dict(zip(names, value, strict=True)) for name, value in values.items()}
    assert front(found) == ["a", "c", "d", "e", "f"]


def test_summary_of_a_point():
    keys = ("fps_at_800mhz", "psnr_db_machine", "max_error_machine")
    rows = [
        {"point": "p", "cycles": {"frame": cycles}} | dict(zip(keys, values, strict=True))
        for cycles, *values in ((100, 8.0, 50.0, 0.5), (200, 4.0, None, 0.0), (50, 16.0, 60.0, 0.1))
    ]
    point, other = Point("p", "knob", "1", DEFAULT), {"point": "q", "max_error_machine": 1}
    found = summary(point, [*rows, rows[0] | other], {"nand2": 5.0}, 2.0)
    wanted = {"frame_cycles_max": 200, "frame_cycles_mean": pytest.approx(100), "fps_min": 4.0}
    wanted |= {"psnr_db_machine_min": 50.0, "psnr_db_machine_mean": 55.0}
    wanted |= {"max_error_machine_max": 0.5, "nand2": 7.0}
    assert found | wanted == found
    assert summary(point, rows, {}, 2.0)["nand2"] is None


@pytest.mark.slow
def test_ablation(tmp_path):
    """Each step adds one technique; the last step is DEFAULT, and frames never get slower."""
    steps = list(ablation_machines(DEFAULT).values())
    assert replace(steps[-1], name="DEFAULT") == DEFAULT
    assert steps[0].culling == "none" and not steps[0].skip_zeros and not steps[0].early_termination
    assert command(f"bench ablation -o {tmp_path}/out garden --size {SIZE}") == 0
    facts = load(tmp_path / "out" / "ablation.json")
    rows = facts["rows"]
    assert [row["step"] for row in rows] == [step["name"] for step in facts["steps"]]
    work = [row["counts"] for row in rows]
    assert work[0]["projected"] > work[1]["projected"] > work[2]["projected"]
    assert rows[2]["cycles"]["project"] > rows[3]["cycles"]["project"]
    assert work[3]["pairs"] > work[4]["pairs"] and work[3]["visited"] > work[4]["visited"]
    assert work[4]["contributions"] > work[5]["contributions"]
    frames = [row["cycles"]["frame"] for row in rows]
    assert frames == sorted(frames, reverse=True)


@pytest.mark.parametrize("name", PRESETS)
def test_ablation_keeps_the_lanes(name):
    """Each preset has all steps with its number of lanes, the last with its lanes."""
    config = PRESETS[name]
    steps = list(ablation_machines(config).values())
    lanes = {step.rasterizers * LANES[step.lanes] for step in [*steps, config]}
    assert len(lanes) == 1
    assert (steps[0].lanes, steps[-1].lanes) == ("block", config.lanes)


def test_ablation_of_a_quality():
    """The view's quality decides how its scene is packed."""
    found = {
        name: measure(View("garden", "", "64x48", quality=name), {"TINY": TINY})["rows"][0]
        for name in ("compact", "faithful")
    }
    assert found["compact"]["psnr_db_scene"] < found["faithful"]["psnr_db_scene"] - 1


@pytest.mark.slow
def test_no_scheduler(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command("bench rule -o X garden --scheduler tcp://127.0.0.1:9")
    assert "--scheduler" in capsys.readouterr().err


@pytest.mark.parametrize(
    "identical, why",
    [(True, None), (False, "the picture is not the golden model's"), (None, "the machine hangs")],
)
def test_failed_confirmation_is_reported(identical, why, monkeypatch, tmp_path):
    view = {"scene": "garden", "camera": "0", "size": SIZE, "identical": identical}

    def row(*_):
        if identical is None:
            raise InputError("the machine hangs")
        return view | {"cycles": {"frame": 5}, "model_cycles": {"frame": 4}}

    simulator = SimpleNamespace(row=row)
    monkeypatch.setattr("splatcore.study.bench.campaigns.Simulator", lambda config: simulator)
    failed = []
    found = confirmed(DEFAULT, GARDEN, tmp_path, "point", failed)
    assert found == (None if identical is None else view | {"cycles": 5, "model_cycles": 4})
    assert [failure["why"] for failure in failed] == ([why] if why else [])


def test_a_row_is_kept_until_packing_changes(monkeypatch, tmp_path):
    """A kept row is measured again if the packing code changes, even with the same Verilog."""
    monkeypatch.setattr(scenes, "machine_source", lambda config: "verilog")
    monkeypatch.setattr(scenes, "build", lambda config, source: None)
    done = []
    monkeypatch.setattr(scenes, "measure", lambda *_: done.append(1) or {"identical": True})
    assert code_key(packed) == scenes.code_key(packed)
    for packs, times in ((code_key(packed), 1), (code_key(packed), 1), ("other", 2)):
        monkeypatch.setattr(scenes, "code_key", {packed: packs}.__getitem__)
        scenes.Simulator(DEFAULT).row(GARDEN, LPDDR4, tmp_path / "row.json")
        assert len(done) == times


def test_pictures_of_packing_are_reused(monkeypatch):
    """The pictures by which a packing was chosen are used again in their view, and only there."""
    shot = View("garden", "", "64x48").open()
    model, source = shot.model, shot.source
    with monkeypatch.context() as patch:
        patch.delattr("splatcore.golden.reference.render")
        found = shot.truths
    assert list(found) == ["machine", "scene"]
    for name, gaussians in (("machine", model.gaussians()), ("scene", source.gaussians)):
        assert np.array_equal(found[name], render_reference(gaussians, shot.camera).pixels)
    again = replace(shot, convention=replace(SPLATCORE, background=(0, 0, 1)))
    assert (again.truth[..., 2] > found["scene"][..., 2]).any()
    moved = replace(shot.camera, cx=shot.camera.cx + 5)
    other = replace(shot, camera=moved, quality=shot.packed.quality)
    assert not np.array_equal(other.truth, found["scene"]) and other.model is model
    alone = Shot(Source("m", model=model), shot.camera).truths
    assert list(alone) == ["machine"] and np.array_equal(alone["machine"], found["machine"])


def test_another_process_opens_the_scene_by_name():
    """A pickled frame has the scene's name; frames of one scene share it and its packing."""
    shot = View("garden", "", "64x48", quality="compact").open(TINY)
    data = pickle.dumps(shot)
    assert len(data) < 5000
    one, other = pickle.loads(data), pickle.loads(data)
    assert one.source is other.source is not shot.source and one.model is other.model
    assert (one.config, one.quality, one.size) == (TINY, "compact", (64, 48))
    assert np.array_equal(one.reference, shot.reference)
