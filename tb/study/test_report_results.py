"""`splatcore report` names missing results; `make results` measures these and no others."""

import json
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from splatcore.study.report.kept import Options
from splatcore.study.report.results import Results
from splatcore.study.results.known import RESULTS
from tb.helpers.command import make
from tb.helpers.report_page import Page, Report, report
from tb.helpers.report_samples import SIZE, VIEWS, write


@pytest.fixture
def results(samples, tmp_path):
    """A folder with samples of all results."""
    shutil.copytree(samples / "results", tmp_path / "results")
    return tmp_path


def test_equal_results_make_equal_pages(results, capsys):
    arguments = ("--section", "ablation", "--section", "scenes")
    assert report(results, capsys, *arguments).status == 0
    first = (results / "out" / "report.html").read_bytes()
    report(results, capsys, *arguments)
    assert (results / "out" / "report.html").read_bytes() == first
    assert list(json.loads((results / "out" / "report.json").read_text())["sections"]) == [
        "ablation", "scenes",
    ]  # fmt: skip


def broken(path: Path, fault: str):
    """Break a result file."""
    texts = {"no JSON": "{", "NaN": '{"parts": NaN}', "no object": "[1]"}
    if fault == "missing":
        path.unlink()
    elif fault in texts:
        path.write_text(texts[fault])
    else:
        value = json.loads(path.read_text())
        if fault == "no key":
            del value["parts"]["array"]["luts"]
        elif fault == "odd":
            value["parts"]["array"] = 3
        else:
            value["failed"] = {"sub_sorter": "does not fit"}
        write(path, value)


@pytest.mark.parametrize(
    "fault, named",
    {
        "missing": "fpga.json: does not exist; create with: make RESULTS=",
        "no JSON": "fpga.json: is not JSON",
        "NaN": "fpga.json: is not JSON (NaN is not a number)",
        "no object": "fpga.json: is not a JSON object",
        "no key": "fpga.json: parts.array has no key 'luts'",
        "odd": "fpga: invalid content (TypeError",
        "failed": "fpga.json: sub_sorter is not placed: does not fit",
    }.items(),
)
def test_broken_results_are_named(results, capsys, fault, named):
    broken(results / "results" / "fpga.json", fault)
    found = report(results, capsys, "--section", "fpga", "--section", "power")
    assert found.status == 1
    page = Page(found.text)
    for text in (found.messages, page.sections["fpga"], page.sections["missing"]):
        assert named in text
    assert found.messages.count("\n") == 1 and found.messages.startswith("fpga: ")
    assert found.table("power", "power") and not found.sections["power"]["problems"]
    if fault != "odd":
        rows = found.table("fpga", "fpga")
        assert [row["part"] for row in rows if row["machine"] == "FPGA"] == [
            "whole, seed 1", "whole, seed 2",
        ]  # fmt: skip
        assert any(row["machine"] == "TINY" for row in rows)


def test_everything_is_missing(tmp_path, capsys):
    found = report(tmp_path, capsys)
    assert found.status == 1
    for name, section in found.sections.items():
        assert bool(section["problems"]) == (name != "fit"), name
    for result in RESULTS.values():
        assert result.file in found.messages, result.file
    Page(found.text)


def test_a_campaign_that_failed_in_parts(results, capsys):
    path = results / "results" / "ablation" / "ablation.json"
    value = json.loads(path.read_text())
    write(path, value | {"failed": [{"what": "ablation vase.ply", "why": "memory exhausted"}]})
    found = report(results, capsys, "--section", "ablation")
    assert found.status == 1 and "ablation vase.ply: memory exhausted" in found.messages
    assert len(found.table("ablation", "ablation")) == 1 + len(VIEWS)


def test_only_some_scenes(results, capsys, monkeypatch):
    monkeypatch.chdir(results)
    for name in ("vase.ply", "new.spz"):
        Path(name).write_text("scene")
    words = ("--section", "ablation", "--scene", "vase.ply")
    found = report(results, capsys, *words)
    assert found.status == 0
    scenes = [row["scene"] for row in found.table("ablation", "ablation")]
    assert "vase.ply" in scenes and "hall.spz" not in scenes
    found = report(results, capsys, *words, "--scene", "new.spz")
    assert found.status == 1 and "ablation.json: has no rows of new.spz" in found.messages


def test_another_size_or_machine(results, capsys):
    words = ("--section", "ablation")
    assert report(results, capsys, *words, "--size", SIZE, "--preset", "default").status == 0
    found = report(results, capsys, *words, "--size", "32x32")
    assert found.status == 1 and f"ablation.json: is for size {SIZE}, not 32x32" in found.messages
    found = report(results, capsys, *words, "--preset", "TINY")
    assert found.status == 1 and "ablation.json: is for preset DEFAULT, not TINY" in found.messages


COMMANDS = {
    "scenes": "bench scenes --timing lpddr4 --quality compact --out DIR/scenes SCENES SIZE PRESET",
    "budget": "error --stage all --json DIR/budget.json SCENES SIZE PRESET",
    "quality": "bench quality --psnr , --out DIR/quality SCENES SIZE PRESET",
    "sweep": "bench sweep --out DIR/sweep SCENES SIZE",
    "synth": "synth --stage top --json DIR/synth.json PRESET",
    "memories": "memories --json DIR/memories.json PRESET",
    "ablation": "bench ablation --out DIR/ablation SCENES SIZE PRESET",
    "power": "power --json DIR/power.json x.ply SIZE PRESET",
    "hard": "hard --engine golden -o DIR/hard --json DIR/hard/hard.json PRESET",
    "hard-rtl": "hard --engine rtl --preset TINY -o DIR/hard-rtl --json DIR/hard-rtl/hard.json",
    "hard-paper": "hard --engine golden --preset PAPER -o DIR/hard-paper "
    "--json DIR/hard-paper/hard.json",
    "fpga-tiny": "fpga --preset TINY --json DIR/fpga-tiny.json",
    "fpga": "fpga --json DIR/fpga.json PRESET",
    "fpga-whole": "fpga --whole --speed 8 --json DIR/fpga-whole.json",
    "compression": "bench compression --part steps,curve,power --ratios 15,20,30,40,60,80 "
    "--view-size 960x540 --steps 40 --out DIR/compression SCENES",
    "scale": "bench scale --out DIR/scale SIZE",
    "levels": "bench levels x.ply --out DIR/levels SIZE PRESET",
}


def commands(*words: str, **variables: str) -> list[list[str]]:
    """Arguments of the `splatcore` commands that make would run."""
    made = make("-n", *words, SPLATCORE="splatcore", **variables)
    assert made.returncode == 0, made.stderr
    lines = [line.partition("&& splatcore ") for line in made.stdout.splitlines()]
    return [after.split() for _, found, after in lines if found]


def test_the_named_command_makes_the_result(tmp_path):
    found = Results(tmp_path, Options(("x.ply", "y.ply"), "32x16", "TINY"))
    variables = {"SCENES": "x.ply y.ply", "SIZE": "--size 32x16", "PRESET": "--preset TINY"}
    assert set(COMMANDS) == set(RESULTS)
    for name, command in COMMANDS.items():
        for word, value in variables.items():
            command = command.replace(f" {word}", f" {value}")
        program, *words = shlex.split(found.command(name))
        assert program == "make" and str(tmp_path / RESULTS[name].file) == words[-1]
        assert commands(*words) == [command.replace("DIR", str(tmp_path)).split()], name


def test_default_scenes(tmp_path):
    """By default make measures all scenes of SPLATCORE_SCENES, or a generated one without it."""
    asked = {"RESULTS": str(tmp_path), "SPLATCORE_SCENES": str(tmp_path / "nowhere")}
    ablation, power = (f"{tmp_path}/{file}" for file in ("ablation/ablation.json", "power.json"))
    words = ["bench", "ablation", "--out", f"{tmp_path}/ablation"]
    generated = ["garden", "--size", "640x360"]
    assert commands(ablation, **asked) == [[*words, *generated]]
    assert commands(power, **asked) == [["power", "--json", power, *generated]]
    asked["SPLATCORE_SCENES"] = str(tmp_path)
    for name in ("b.spz", "a.x.ply", "a.cameras.json"):
        (tmp_path / name).write_text("")
    assert commands(ablation, **asked) == [words]
    one = [f"{tmp_path}/a.x.ply", "--camera", f"{tmp_path}/a.cameras.json"]
    assert commands(power, **asked) == [["power", "--json", power, *one]]


def test_only_missing_results_are_measured(results):
    place = results / "results"
    (place / "memories.json").unlink()
    (place / "hard" / "hard.json").unlink()
    hard = f"hard --engine golden -o {place}/hard --json {place}/hard/hard.json"
    memories = f"memories --json {place}/memories.json"
    assert commands("results", RESULTS=str(place)) == [hard.split(), memories.split()]
    (results / "new.spz").write_text("scene")
    newer = commands("results", RESULTS=str(place), SCENES=str(results / "new.spz"))
    assert len(newer) == 2 + 6  # campaigns and power, too


def test_a_measurement_that_fails(results):
    """The others are measured, the report is written, and a file left by a failure counts."""
    place, program, log = results / "results", results / "program", results / "log"
    for file in ("fpga.json", "hard/hard.json", "synth.json"):
        (place / file).unlink()
    program.write_text(
        f'#!/bin/sh\necho "$@" >> {log}\n'
        f'case "$1" in report|synth) exit 0;; hard) echo {{}} > {place}/hard/hard.json; exit 1;; '
        "*) exit 2;; esac\n"
    )
    program.chmod(0o755)
    asked = {"SPLATCORE": str(program), "RESULTS": str(place), "REPORT": str(results / "out")}
    assert make("-k", "results", **asked).returncode
    assert make("report", **asked).returncode == 0
    *made, last = log.read_text().splitlines()
    assert [line.split()[0] for line in made] == ["hard", "synth", "fpga"]
    assert last == f"report -o {results}/out --results {place}"
    assert (place / "hard" / "hard.json").exists()
    log.unlink()
    make("-k", "results", "report", **asked)
    assert [line.split()[0] for line in log.read_text().splitlines()] == ["synth", "fpga", "report"]


@pytest.mark.slow
def test_make_report(results, tmp_path):
    """With the real program: one result is measured, one fails and its message is passed on."""
    for name in ("memories.json", "power.json"):
        (tmp_path / "results" / name).unlink()
    (tmp_path / "odd.ply").write_text("no scene")
    place = tmp_path / "results"
    made = make(
        "-k", "results", "report",
        SPLATCORE=f"{sys.executable} -m splatcore", REPORT=str(tmp_path / "out"),
        RESULTS=str(place), SCENE=str(tmp_path / "odd.ply"),
    )  # fmt: skip
    found = Report(tmp_path / "out", made.returncode, made.stderr)
    kilobytes = json.loads((place / "memories.json").read_text())["kilobytes"]
    sizes = {row["memory"]: row["size, KB"] for row in found.table("paper", "memories")[:9]}
    assert sizes["all"] == kilobytes != 4
    assert found.status and found.messages.count("error: ") == 1 and "odd.ply" in found.messages
    assert f"power.json: does not exist; create with: make RESULTS={place}" in found.text
    assert found.table("paper", "gates") and not found.sections["power"]["tables"]


def test_the_command_has_the_result_s_options(results):
    """The command below a figure has the options its result was measured with."""
    place = results / "results"
    found = Results(place)
    start, path = f"make RESULTS={place} ", place / "ablation" / "ablation.json"
    assert found.command("ablation") == f"{start}{path}"  # before the result is read
    found.facts("ablation")
    assert found.command("ablation") == f"{start}SIZE={SIZE} {path}"
    value = json.loads(path.read_text())
    rows = [row | {"scene": "garden"} for row in value["rows"]]
    write(path, value | {"rows": rows, "size": "1920x1080", "preset": "TINY"})
    found.facts("ablation")
    assert found.command("ablation") == f"{start}SCENES=garden PRESET=TINY {path}"
