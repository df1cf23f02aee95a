"""`splatcore bench differentiable`: what it measures, writes and refuses."""

import pytest

from splatcore.golden.reference import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.sim.cli import bench_differentiable
from tb.helpers.command import check_refused, load, run

pytestmark = pytest.mark.compress


def test_measures(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    arguments = "--gaussians 300 --size 70x40 --repeat 3 --json a.json"
    assert run(f"bench differentiable {arguments}") == 0
    found = load(tmp_path / "a.json")
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
    check_refused(capsys, f"bench differentiable {arguments}", message)


def test_without_torch(monkeypatch, capsys):
    monkeypatch.setattr(bench_differentiable, "find_spec", lambda name: None)
    message = r"pip install 'splatcore\[compress\]'"
    check_refused(capsys, "bench differentiable --gaussians 20", message)
