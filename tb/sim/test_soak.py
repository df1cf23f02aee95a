"""Random runs: repeatable by number, right ones pass, wrong ones are found, kept and reported."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.read import read_scene
from splatcore.model.pack.pack import pack
from splatcore.sim.soak import fault_kinds, frame_runs
from splatcore.sim.soak.machines import MACHINES
from splatcore.spec.preset import check_buildable
from splatcore.spec.scene import ARRAYS
from splatcore.study.bench import campaign
from tb.helpers.command import check_documented, load
from tb.helpers.command import run as command

SEED = 3
TINY_RUNS = 0, len(MACHINES)
"""Numbers of two runs of frames on the first machine, TINY."""


def test_machines_are_of_all_kinds():
    """The machines cover every number of rasterizers, sorters and so on, and the widest image."""
    for config in MACHINES.values():
        check_buildable(config)
    for name, values in {
        "rasterizers": {1, 2, 4, 8, 16},
        "group": {1, 2, 4},
        "sub_sorters": {1, 2, 4},
        "port": {128, 256},
        "rgba": {False, True},
        "levels": {False, True},
    }.items():
        assert {getattr(config, name) for config in MACHINES.values()} >= values, name
    assert max(config.width_max for config in MACHINES.values()) == 4096


def test_a_number_is_a_run():
    """The same seed and number draw the same run; another seed draws another."""
    for number in range(3):
        one, again = (frame_runs.drawn(SEED, number) for _ in range(2))
        other = frame_runs.drawn(SEED + 1, number)
        assert one.timing == again.timing != other.timing
        for first, second in zip(one.jobs, again.jobs, strict=True):
            assert repr(first.camera) == repr(second.camera)
            assert first.background == second.background
            assert np.array_equal(first.model.image, second.model.image)


@pytest.mark.slow
def test_runs_are_right():
    for number in TINY_RUNS:
        found = frame_runs.frame_run(SEED, number)
        assert found["machine"] == "tiny" and not found["wrong"]
        assert found["frames"] == frame_runs.FRAMES and found["cycles"] > 0
    assert not any(fault_kinds.fault_run(SEED, number)["wrong"] for number in range(0, 41, 5))


class Wrong:
    """A machine that renders the second frame with a wrong background."""

    def __init__(self, machine):
        self.machine = machine

    def run(self, jobs, *rest, **options):
        first, second, *others = jobs
        second = second._replace(background=tuple(code ^ 256 for code in second.background))
        return self.machine.run([first, second, *others], *rest, **options)


@pytest.fixture
def wrong(monkeypatch):
    """The machine renders wrong frames; tasks run in this process."""
    right = frame_runs.machine
    monkeypatch.setattr(frame_runs, "machine", lambda config: Wrong(right(config)))

    def here(tasks):
        return ((task, task.function(*task.arguments)) for task in tasks)

    monkeypatch.setattr(campaign, "in_processes", here)


@pytest.mark.slow
def test_wrong_runs_are_reported_and_kept(wrong, tmp_path, capsys):
    assert command(f"soak frames --seed {SEED} --only 0 -o {tmp_path}/out") == 1
    printed = capsys.readouterr()
    again = f"splatcore soak frames --seed {SEED} --only 0 "
    assert "frame 1: " in printed.err and "pixels differ" in printed.err and again in printed.err
    assert "1 runs, 8 frames" in printed.out and "1 wrong" in printed.out
    result = load(tmp_path / "out" / "frames.json")
    check_documented("## `splatcore soak frames`", result)
    assert result["machines"] == {"tiny": 1} and "frame 1: " in result["wrong"][0]["wrong"]
    made, kept = frame_runs.drawn(SEED, 0), tmp_path / "out" / "wrong" / "0"
    assert len(read_cameras(kept / "cameras.json")) == frame_runs.FRAMES
    for k, (scene, quality) in enumerate(zip(made.scenes, made.qualities, strict=True)):
        found = read_scene(kept / f"scene{k}-{quality}.ply")
        assert all(getattr(found, name).shape == getattr(scene, name).shape for name in ARRAYS)
        models = [pack(s, made.config, quality=quality)[0].image for s in (found, scene)]
        assert models[0].shape == models[1].shape
    assert f"memory {made.timing}" in (kept / "run.txt").read_text()


@pytest.mark.slow
def test_goes_on_where_it_stopped(tmp_path, monkeypatch, capsys):
    options = f"--seed {SEED} -o {tmp_path}"
    assert command(f"soak frames --only 0 {options}") == 0
    begun = []
    monkeypatch.setattr(campaign, "in_processes", lambda tasks: begun.extend(tasks) or ())
    assert command(f"soak frames --only 0 --only 16 {options}") == 0
    assert [task.name for task in begun] == [f"{SEED}-16"]
    assert "1 runs, 8 frames" in capsys.readouterr().out


@pytest.mark.slow
def test_a_wrong_outcome_of_a_fault_is_found(monkeypatch):
    right = fault_kinds.run_fault

    def other(*arguments):
        found = right(*arguments)
        return replace(found, good=found.good ^ 1)

    monkeypatch.setattr(fault_kinds, "run_fault", other)
    assert fault_kinds.fault_run(SEED, 0)["wrong"]
    assert len(fault_kinds.WAYS) == len(fault_kinds.KINDS) + len(fault_kinds.PAIR_KINDS) + 2 == 41
