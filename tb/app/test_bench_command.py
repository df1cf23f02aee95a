"""`splatcore bench sort` and `bench differentiable`: measured values, files and printed lines."""

import pytest

from splatcore.golden.reference import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.sim.cycles.sort import stage_cycles
from splatcore.sim.frame.picture import read_png
from splatcore.spec.config import TINY
from splatcore.study.bench.sort import BOUND
from splatcore.study.bench.sort_rows import KEYS, entries_of
from tb.helpers.command import check_documented, load, run

LENGTHS = [1, 16, 65, 300]


@pytest.mark.slow
def test_bench_sort(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = "--preset tiny --lengths 1,16,65,300 -o out --json sort.json"
    assert run(f"bench sort {options}") == 0
    found = load(tmp_path / "sort.json")
    assert found["preset"] == "TINY" and found["lengths"] == LENGTHS
    assert list(found["cycles"]) == list(KEYS)
    keys = [entries_of(TINY, "random", [length])["key"] for length in LENGTHS]
    assert found["model"] == [stage_cycles(TINY, [some]) for some in keys]
    for kind, values in found["cycles"].items():
        assert values[1] <= BOUND * 16 and values == sorted(values)
        known = len(LENGTHS) if kind == "random" else 2  # bucket rounds depend on the keys
        assert values[:known] == pytest.approx(found["model"][:known], rel=0.02, abs=2)
    assert read_png("out/sort.png").std() > 5
    printed = capsys.readouterr().out
    assert f"{BOUND * 16:.0f}" in printed and "out/sort.png" in printed and "…" not in printed
    check_documented("## `splatcore bench sort`", found)


@pytest.mark.compress
def test_bench_differentiable(tmp_path, monkeypatch, capsys):
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


@pytest.mark.compress
def test_times_are_medians_without_the_first(monkeypatch):
    pytest.importorskip("torch")
    from splatcore.app.cli import (
        bench_differentiable,  # imported late: `main` sets the order of commands
    )

    ticks = iter([0, 100, 300, 0, 1, 11, 0, 3, 33, 0, 2, 22])  # start, middle, end of each run
    monkeypatch.setattr(bench_differentiable, "perf_counter", lambda: next(ticks))
    camera = generated_camera("garden", 16, 16)
    found = bench_differentiable.measure(generate("garden", 20).gaussians(), camera, 3)
    assert found["forward_seconds"] == 2 and found["backward_seconds"] == 20
