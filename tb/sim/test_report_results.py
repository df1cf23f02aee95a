"""`splatcore report`: what is missing is named, and only that is measured."""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from splatcore.sim.report import results as report_results
from splatcore.sim.report.options import Options
from splatcore.sim.report.results import SOURCES, Results
from splatcore.sim.report.sections import SECTIONS
from tb.helpers.command import run
from tb.helpers.report_page import Page, Report, report
from tb.helpers.report_samples import SIZE, VIEWS, everything, write


@pytest.fixture
def results(tmp_path):
    """A folder with all results."""
    everything(tmp_path / "results")
    return tmp_path


def test_equal_results_make_equal_pages(results, capsys):
    arguments = ("--no-run", "--section", "work", "--section", "scenes")
    assert report(results, capsys, *arguments).status == 0
    first = (results / "out" / "report.html").read_bytes()
    report(results, capsys, *arguments)
    assert (results / "out" / "report.html").read_bytes() == first
    assert list(json.loads((results / "out" / "report.json").read_text())["sections"]) == [
        "work", "scenes",
    ]  # fmt: skip


def broken(path: Path, what: str):
    """Spoil a result."""
    if what == "missing":
        path.unlink()
    elif what == "no JSON":
        path.write_text("{")
    elif what == "NaN":
        path.write_text('{"parts": NaN}')
    elif what == "no object":
        path.write_text("[1]")
    else:
        value = json.loads(path.read_text())
        if what == "no key":
            del value["parts"]["array"]["luts"]
        elif what == "odd":
            value["parts"]["array"] = 3
        else:
            value["failed"] = {"sub_sorter": "does not fit"}
        write(path, value)


@pytest.mark.parametrize(
    "what, named",
    {
        "missing": "fpga.json: is not there; made by: splatcore fpga --json",
        "no JSON": "fpga.json: is not JSON",
        "NaN": "fpga.json: is not JSON (NaN is no number)",
        "no object": "fpga.json: holds no object",
        "no key": "fpga.json: parts.array has no key 'luts'",
        "odd": "fpga: not as they should be (TypeError",
        "failed": "fpga.json: sub_sorter is not placed: does not fit",
    }.items(),
)
def test_what_is_missing_is_named(results, capsys, what, named):
    broken(results / "results" / "fpga.json", what)
    found = report(results, capsys, "--no-run", "--section", "fpga", "--section", "power")
    assert found.status == 1
    page = Page(found.text)
    for text in (found.said, page.sections["fpga"], page.sections["missing"]):
        assert named in text
    assert found.said.count("\n") == 1 and found.said.startswith("fpga: ")
    assert found.table("power", "power") and not found.sections["power"]["problems"]
    if what != "odd":
        assert any(row["machine"] == "TINY" for row in found.table("fpga", "fpga"))


def test_everything_is_missing(tmp_path, capsys):
    found = report(tmp_path, capsys, "--no-run")
    assert found.status == 1
    for name, section in found.sections.items():
        assert bool(section["problems"]) == (name != "fit"), name
    assert found.table("paper", "checks")  # needs no result
    for source in SOURCES.values():
        assert source.file in found.said, source
    Page(found.text)


def test_a_campaign_that_failed_in_parts(results, capsys):
    path = results / "results" / "work" / "work.json"
    value = json.loads(path.read_text())
    write(path, value | {"failed": [{"what": "work vase.ply", "why": "memory exhausted"}]})
    found = report(results, capsys, "--no-run", "--section", "work")
    assert found.status == 1 and "work vase.ply: memory exhausted" in found.said
    assert len(found.table("work", "work")) == 2 + len(VIEWS) + 1


def test_only_some_scenes(results, capsys, monkeypatch):
    monkeypatch.chdir(results)
    for name in ("vase.ply", "new.spz"):
        Path(name).write_text("scene")
    words = ("--no-run", "--section", "work", "--scene", "vase.ply")
    found = report(results, capsys, *words)
    assert found.status == 0
    scenes = [row["scene"] for row in found.table("work", "work")]
    assert "vase.ply" in scenes and "hall.spz" not in scenes
    found = report(results, capsys, *words, "--scene", "new.spz")
    assert found.status == 1 and "work.json: has nothing about new.spz" in found.said


def test_another_size_or_machine(results, capsys):
    words = ("--no-run", "--section", "work")
    assert report(results, capsys, *words, "--size", SIZE, "--preset", "default").status == 0
    found = report(results, capsys, *words, "--size", "32x32")
    assert found.status == 1 and f"work.json: is for size {SIZE}, not 32x32" in found.said
    found = report(results, capsys, *words, "--preset", "TINY")
    assert found.status == 1 and "work.json: is for preset DEFAULT, not TINY" in found.said


@dataclass
class Ran:
    """Stands for running commands: what they were, what they end with, and what they leave."""

    status: int = 0
    leaves: dict[str, Path] = field(default_factory=dict)
    commands: list[list[str]] = field(default_factory=list)

    def __call__(self, arguments: list[str]) -> tuple[int, str]:
        self.commands.append(arguments)
        for name, path in self.leaves.items():
            if arguments[0] == name:
                everything(path)
        return self.status, "error: no luck" if self.status else ""


def test_only_what_is_missing_is_run(results, capsys, monkeypatch):
    ran = Ran(leaves={"memories": results / "results"})
    monkeypatch.setattr(report_results, "run", ran)
    (results / "results" / "memories.json").unlink()
    found = report(results, capsys, "--section", "paper", "--section", "fpga")
    path = str(results / "results" / "memories.json")
    assert found.status == 0 and ran.commands == [["memories", "--json", path]]
    assert f"$ splatcore memories --json {path}" in found.said.replace("\n", " ")


def test_a_command_that_fails_is_named(results, capsys, monkeypatch):
    monkeypatch.setattr(report_results, "run", Ran(status=2))
    path = results / "results" / "fpga.json"
    path.unlink()
    found = report(results, capsys, "--section", "fpga")
    assert found.status == 1
    assert f"splatcore fpga --json {path}: exit status 2, error: no luck" in found.text
    assert found.table("fpga", "fpga")  # TINY's stand


@pytest.mark.parametrize("name, status", [("hard", 0), ("memories", 1)])
def test_what_exit_status_1_means(results, capsys, monkeypatch, name, status):
    """A hard case that fails is a result; a command that fails and leaves a file is told."""
    ran = Ran(status=1, leaves={name: results / "results"})
    monkeypatch.setattr(report_results, "run", ran)
    (results / "results" / SOURCES[name].file).unlink()
    section = {"memories": "paper"}.get(name, name)
    found = report(results, capsys, "--section", section)
    assert found.status == status and len(ran.commands) == 1
    assert ("exit status 1, error: no luck" in found.text) == bool(status)


@pytest.mark.slow
def test_commands_are_run(tmp_path, capfd):
    """Truly: one that works, and one whose message is passed on and kept."""
    everything(tmp_path / "results")
    for name in ("programs.json", "power.json"):
        (tmp_path / "results" / name).unlink()
    (tmp_path / "odd.ply").write_text("no scene")
    place = tmp_path / "results"
    words = ["--results", str(place), "--section", "paper", "--section", "power"]
    status = run("report", "-o", str(tmp_path), *words, "--scene", str(tmp_path / "odd.ply"))
    said = capfd.readouterr().err
    made = json.loads((place / "programs.json").read_text())["programs"]["project_sh"]
    found = Report(tmp_path, status, said)
    row = found.table("paper", "operations")[3]
    assert row["all, operations"] == made["operations"] != 100
    assert status == 1 and said.count("error: ") == 2
    assert re.search(r"splatcore power .*odd.ply: exit status 2, error: .*odd.ply", found.text)
    assert found.table("paper", "gates") and not found.sections["power"]["tables"]


def test_what_is_measured_by_default(tmp_path, monkeypatch):
    """All scenes of the folder, without it a generated one; options reach who takes them."""
    words = ["bench", "work", "--out", f"{tmp_path}/work"]
    monkeypatch.setenv("SPLATCORE_SCENES", str(tmp_path / "nowhere"))
    assert Results(tmp_path).arguments("work") == [*words, "garden", "--size", "640x360"]
    power = Results(tmp_path).arguments("power")
    assert power[3:] == ["garden", "--size", "640x360"]
    monkeypatch.setenv("SPLATCORE_SCENES", str(tmp_path))
    for name in ("b.spz", "a.ply"):
        (tmp_path / name).write_text("")
    (tmp_path / "a.cameras.json").write_text("")
    assert Results(tmp_path).arguments("work") == words
    one = [f"{tmp_path}/a.ply", "--camera", f"{tmp_path}/a.cameras.json"]
    assert Results(tmp_path).arguments("power")[3:] == one
    given = Results(tmp_path, Options(("x.ply", "y.ply"), "32x16", "TINY"))
    assert given.arguments("work") == [
        *words, "x.ply", "y.ply", "--size", "32x16", "--preset", "TINY"
    ]  # fmt: skip
    assert given.arguments("programs-paper")[:3] == ["programs", "--preset", "PAPER"]
    assert "--preset" not in given.arguments("sweep")


def test_the_command_is_that_of_the_result(results, monkeypatch):
    """What is shown below a figure makes that figure, not what would be measured now."""
    monkeypatch.setenv("SPLATCORE_SCENES", str(results / "nowhere"))
    place = results / "results"
    found = Results(place)
    assert found.command("work").endswith(" garden --size 640x360")  # it would be run so
    found.facts("work")
    assert found.command("work") == f"splatcore bench work --out {place}/work --size {SIZE}"
    path = place / "work" / "work.json"
    value = json.loads(path.read_text())
    rows = [row | {"scene": "garden"} for row in value["rows"]]
    write(path, value | {"rows": rows, "size": "1920x1080", "preset": "TINY"})
    found.facts("work")
    assert found.command("work").endswith("/work garden --preset TINY")


@pytest.mark.parametrize(
    "arguments, message",
    {
        "-o out --section speed": "--section 'speed': unknown (there are scenes, sweep, paper",
        "-o out --size 3": "--size '3': is not WIDTHxHEIGHT",
        "-o out --preset HUGE": "preset 'HUGE': unknown",
        "-o out --scene none.ply": "none.ply",
        "-o none/out": "none/out: there is no folder",
    }.items(),
)
def test_bad_input(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("report", *arguments.split()) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ") and message in printed.err and not printed.out
    assert not list(tmp_path.iterdir())


def test_help(capsys):
    assert run("report", "--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    for word in ("--no-run", "--section", "report.html", "needs no network", *SECTIONS):
        assert word in text
