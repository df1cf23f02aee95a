"""`splatcore bench`: what it measures, writes and refuses."""

import pytest

from splatcore.sim.bench.sort import BOUND
from splatcore.sim.bench.sort_rows import KEYS
from splatcore.sim.common.picture import read_png
from splatcore.sim.cycles.sort import cycles
from splatcore.spec.config import TINY
from tb.helpers.command import check_documented, check_refused, load, run

LENGTHS = [1, 16, 65, 300]


@pytest.mark.slow
def test_bench_sort(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = "--preset tiny --lengths 1,16,65,300 -o out --json sort.json"
    assert run(f"bench sort {options}") == 0
    found = load(tmp_path / "sort.json")
    assert found["preset"] == "TINY" and found["lengths"] == LENGTHS
    assert list(found["cycles"]) == list(KEYS)
    assert found["model"] == [cycles(TINY, [length]) for length in LENGTHS]
    for values in found["cycles"].values():
        assert values[1] <= BOUND * 16 and values == sorted(values)
        assert values == pytest.approx(found["model"], rel=0.03, abs=2)
    assert read_png("out/sort.png").std() > 5
    printed = capsys.readouterr().out
    assert f"{BOUND * 16:.0f}" in printed and "out/sort.png" in printed and "…" not in printed
    check_documented("## `splatcore bench sort`", found)


@pytest.mark.parametrize(
    "arguments, message",
    {
        "-o out --lengths 1,two": "--lengths '1,two': are not numbers",
        "-o out --lengths 0,4": "--lengths '0,4': are not all in 1",
        "-o out --preset HUGE": "HUGE",
        "-o none/out": "none/out",
        "-o out --json none/a.json": "none/a.json",
    }.items(),
)
def test_bad_input(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    check_refused(capsys, f"bench sort {arguments}", message)
    assert not list(tmp_path.iterdir())


def test_help(capsys):
    assert run("bench", "--help") == 0
    assert "sort" in capsys.readouterr().out
    assert run("bench", "sort", "--help") == 0
    assert "--lengths" in capsys.readouterr().out
    assert run("bench", "fly") == 2
