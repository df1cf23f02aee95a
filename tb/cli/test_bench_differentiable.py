"""`splatcore bench differentiable`: what it measures, writes and refuses."""

import json

import pytest

from splatcore.golden.reference import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.sim.cli import bench_differentiable
from tb.helpers.command import run

pytestmark = pytest.mark.compress


def test_measures(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    arguments = "--gaussians 300 --size 70x40 --repeat 3 --json a.json"
    assert run("bench", "differentiable", *arguments.split()) == 0
    found = json.loads((tmp_path / "a.json").read_text())
    camera = generated_camera("garden", 70, 40)
    counts = render(generate("garden", 300).gaussians(), camera).counts
    assert found["gaussians"] == 300 and found["size"] == [70, 40] and found["repeat"] == 3
    assert found["visible"] == counts["visible"] and found["pairs"] == counts["pairs"]
    assert found["threads"] >= 1
    assert found["forward_seconds"] > 0 and found["backward_seconds"] > 0
    printed = capsys.readouterr().out
    for text in ("300 Gaussians at 70×40", f"{found['forward_seconds']:.3f} s", "bound: 1.5 s",
                 f"{found['backward_seconds']:.3f} s", f"{counts['pairs']:,} pairs"):  # fmt: skip
        assert text in printed


def test_times_are_medians_without_the_first(monkeypatch):
    pytest.importorskip("torch")
    ticks = iter([0, 100, 300, 0, 1, 11, 0, 3, 33, 0, 2, 22])  # start, middle, end of each run
    monkeypatch.setattr(bench_differentiable, "perf_counter", lambda: next(ticks))
    camera = generated_camera("garden", 16, 16)
    found = bench_differentiable.measure(generate("garden", 20).gaussians(), camera, 3)
    assert found["forward_seconds"] == 2 and found["backward_seconds"] == 20


@pytest.mark.parametrize(
    "arguments, message",
    {
        "--gaussians 0": "--gaussians: count: 0 is not in 1",
        "--size 0x5": "--size 0x5: width 0",
        "--repeat 0": "--repeat 0: is not at least 1",
        "--json none/a.json": "none/a.json",
    }.items(),
)
def test_bad_input(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("bench", "differentiable", *arguments.split()) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ") and message in printed.err and not printed.out


def test_without_torch(monkeypatch, capsys):
    monkeypatch.setattr(bench_differentiable, "find_spec", lambda name: None)
    assert run("bench", "differentiable", "--gaussians", "20") == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and "pip install 'splatcore[compress]'" in printed.err
    assert not printed.out
