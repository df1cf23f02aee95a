"""`splatcore bench`: what it measures, writes and refuses."""

import json

import pytest

from splatcore.sim.bench.sort import BOUND
from splatcore.sim.bench.sort_rows import KEYS
from splatcore.sim.common.picture import read_png
from splatcore.sim.cycles.sort import cycles
from splatcore.spec.config import TINY
from tb.helpers.command import ROOT, run

LENGTHS = [1, 16, 65, 300]


@pytest.mark.slow
def test_bench_sort(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("bench", "sort", "--preset", "tiny", "--lengths", "1,16,65,300", "-o", "out",
               "--json", "sort.json") == 0  # fmt: skip
    found = json.loads((tmp_path / "sort.json").read_text())
    assert found["preset"] == "TINY" and found["lengths"] == LENGTHS
    assert list(found["cycles"]) == list(KEYS)
    assert found["model"] == [cycles(TINY, [length]) for length in LENGTHS]
    for values in found["cycles"].values():
        assert values[1] <= BOUND * 16 and values == sorted(values)
        assert values == pytest.approx(found["model"], rel=0.03, abs=2)
    assert read_png("out/sort.png").std() > 5
    printed = capsys.readouterr().out
    assert f"{BOUND * 16:.0f}" in printed and "out/sort.png" in printed and "…" not in printed
    text = (ROOT / "docs" / "json.md").read_text()
    documented = text.partition("## `splatcore bench sort`")[2].partition("\n## ")[0]
    assert all(f"`{key}`" in documented for key in found)


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
    assert run("bench", "sort", *arguments.split()) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ") and message in printed.err and not printed.out
    assert not list(tmp_path.iterdir())


def test_help(capsys):
    assert run("bench", "--help") == 0
    assert "sort" in capsys.readouterr().out
    assert run("bench", "sort", "--help") == 0
    assert "--lengths" in capsys.readouterr().out
    assert run("bench", "fly") == 2
