"""`bench rule`: each row equals the golden model's result for a machine with that rule."""

import csv
from dataclasses import replace

import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.sim.cycles.raster import raster_cycles
from splatcore.sim.frame.metric import difference
from splatcore.sim.frame.shot import View
from splatcore.spec.config import DEFAULT
from splatcore.study.bench import rule
from tb.helpers.command import check_documented, load, run

RULES = [(), (5, 11, 9), (4, 9, 7)]
VIEWS = [View(scene, "", "96x54", quality="compact") for scene in ("needles", "fog")]


def test_rules_are_valid_and_once():
    found = rule.rules()
    assert found[0] == () and len(set(found)) == len(found) and DEFAULT.faint in found
    assert all(replace(DEFAULT, faint=one).faint == one for one in found)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.scene)
def test_a_row_is_the_whole_machine_s(view):
    rows = rule.measure(view, DEFAULT, RULES)["rows"]
    assert [row["rule"] for row in rows] == ["3DGS", "5, 11, 9", "4, 9, 7"]
    shot = view.open()
    model, camera = shot.model, shot.camera
    truth = render_reference(model.gaussians(), camera).pixels
    for row, faint in zip(rows, RULES, strict=True):
        config = replace(DEFAULT, faint=faint)
        frame = render(config, model, camera)
        counts, error = frame.counts, difference(frame.pixels, truth)
        assert row["raster_cycles"] == raster_cycles(config, frame)
        assert row["visited"] == counts["visited"] > 0
        assert row["pairs"] == counts["pairs"] - counts["far"] - counts["empty"]
        found = row["psnr_db_machine"], row["ssim_machine"], row["max_error_machine"]
        assert found == (error.psnr_db, error.ssim, error.max_error)
    assert len({row["visited"] for row in rows}) > 1 or view.scene != "fog"


def made(name: str, scene: str, cycles: int, psnr: float | None, error: float = 0.02) -> dict:
    """A result row with these values."""
    work = {"raster_cycles": cycles, "visited": 3 * cycles, "pairs": cycles}
    decibels = {"psnr_db_machine": psnr, "max_error_machine": error}
    return {"rule": name, "scene": scene, "camera": "0"} | work | decibels


def test_summaries():
    """Means of shares with equal weight per view; only allowed rules are on the front."""
    rows = [made("3DGS", "a", 100, 60.0), made("3DGS", "b", 1000, 58.0)]
    rows += [made("1", "a", 50, 59.0), made("1", "b", 900, 57.0)]
    rows += [made("2", "a", 40, 61.0, 0.2), made("2", "b", 400, 61.0)]  # one wrong pixel
    rows += [made("3", "a", 40, 54.9), made("3", "b", 400, 61.0)]  # a view too faint
    rows += [made("4", "a", 60, 58.0), made("4", "b", 800, 57.0)]  # as fast as 1, and worse
    found = rule.summaries(rows)
    assert found["1"]["raster_cycles"] == found["4"]["raster_cycles"] == pytest.approx(0.7)
    assert found["1"]["visited"] == pytest.approx(0.7)
    ends = found["1"]["raster_cycles_share_min"], found["1"]["raster_cycles_share_max"]
    assert ends == (0.5, 0.9) and found["1"]["raster_cycles_max"] == 900
    assert found["3"]["psnr_db_machine_min"] == 54.9 and found["2"]["max_error_machine_max"] == 0.2
    assert [name for name, facts in found.items() if facts["allowed"]] == ["3DGS", "1", "4"]
    assert [name for name, facts in found.items() if facts["front"]] == ["3DGS", "1"]


def test_every_view_has_its_column():
    """Every view has its own column, also two files of one scene."""
    rows = [made("3DGS", "a.ply", 1000, 60.0), made("3DGS", "a.sog", 3000, None)]
    facts = {"rules": rule.summaries(rows), "rows": rows}
    *_, last = rule.markdown(facts).splitlines()
    assert last == "| 3DGS | 1, 60.00, 5 | 3, exact, 5 |"


@pytest.mark.slow
def test_command(tmp_path, capsys):
    arguments = ["bench", "rule", "needles", "fog", "--size", "96x54", "-o", tmp_path]
    assert run(*arguments) == 0
    assert "5, 11, 9" in capsys.readouterr().out
    facts = load(tmp_path / "rule.json")
    assert len(facts["rows"]) == 2 * len(rule.rules()) and not facts["failed"]
    names = list(map(rule.title, rule.rules()))
    assert list(facts["rules"]) == names
    table = (tmp_path / "rule.md").read_text()
    assert all(table.count(f"\n| {name} |") == 2 for name in names)
    with open(tmp_path / "rule.csv") as file:
        assert len(list(csv.DictReader(file))) == len(facts["rows"])
    documented = {*facts, *facts["rows"][0], *facts["rules"]["3DGS"]}
    check_documented("## `splatcore bench rule`", documented)
    part = next((tmp_path / "parts").iterdir())
    before = part.stat().st_mtime_ns
    assert run(*arguments) == 0 and part.stat().st_mtime_ns == before
