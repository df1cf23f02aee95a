"""`splatcore bench sort`: measured values, files and printed lines."""

import pytest

from splatcore.sim.cycles.sort import stage_cycles
from splatcore.sim.frame.picture import read_png
from splatcore.spec.config import TINY
from splatcore.study.bench.sort import BOUND
from splatcore.study.bench.sort_parts import KEYS, entries_of
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
