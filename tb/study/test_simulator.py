"""`splatcore bench simulator`: its figures from the seconds of commands."""

import json

from splatcore.spec.cache import VARIABLE
from splatcore.study.bench.measured import Checkout
from splatcore.study.results.scale import Cost
from tb.helpers.command import ROOT, check_refused, load, run


def test_figures(monkeypatch, tmp_path, capsys):
    """Building is the first small frame less the second; simulating is what the golden model's
    command does not take. The checkouts have caches of their own, and take turns."""
    built, large, scene = set(), [], tmp_path / "scene.ply"
    scene.touch()
    monkeypatch.chdir(tmp_path)

    def measured(checkout, command, folder, variables):
        slow = 3 if checkout.folder else 1
        assert command[1] == str(scene)  # commands run in other folders
        words = dict(zip(command[2::2], command[3::2], strict=True))
        seconds = 1.0 if words["--engine"] == "golden" else 2.0
        if words["--engine"] == "rtl" and variables[VARIABLE] not in built:
            built.add(variables[VARIABLE])
            seconds += 60 * slow
        if words["--size"] == "64x48" and words["--engine"] == "rtl":
            large.append(slow)
            seconds += 4 * slow
            halves = {"preprocessing": 3000, "rendering": 5000 * slow}
            (folder / words["--json"]).write_text(json.dumps({"halves": halves}))
        return Cost(cpu_seconds=seconds, wall_seconds=1.0, peak_bytes=1, why="")

    monkeypatch.setattr(Checkout, "measured", measured)
    file = tmp_path / "a.json"
    words = "bench", "simulator", "scene.ply", "--size", "64x48", "--against", ROOT
    assert run(*words, "--json", file) == 0
    assert [tuple(row.values())[1:] for row in load(file)["rows"]] == [
        (60.0, 180.0, 0.333), (5.0, 13.0, 0.385), (1600.0, 1384.615, 1.156),
    ]  # fmt: skip
    assert large == [1, 3, 3, 1, 1, 3] and "8,000 cycles" in capsys.readouterr().out


def test_refused(capsys, tmp_path):
    check_refused(capsys, f"bench simulator garden --against {tmp_path}", "is no checkout")
