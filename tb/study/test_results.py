"""Fields of results: their tables, keys in docs/json.md, rules of make, and a new result."""

import json

import pytest

from splatcore.study.report import sections, titles
from splatcore.study.report.kept import read_kept, tables
from splatcore.study.results import known, page
from splatcore.study.results.fields import Errors, columns, errors, facts, item, result, table
from splatcore.study.results.known import RESULTS, Result
from tb.helpers.command import ROOT
from tb.helpers.report_page import report
from tb.helpers.report_samples import sample, write


@result
class Row:
    """A row of the new result."""

    name: str = item("of the trial")
    speed: float = item("of the trial", "MB/s", 1, per=1e6)
    note: str | None = item("why it is slow", maybe=True, kept=False)
    error: Errors = errors("machine")


@result
class Trials:
    """The new result."""

    preset: str = item("the machine")
    rows: list[Row] = table("one for each trial")


TRIALS = Result(
    "trials", "trials.json", "trials --json $@ $(preset)", Trials, title="Trials", about="All.",
)  # fmt: skip


def test_a_new_result_is_one_entry(tmp_path, monkeypatch, capsys):
    """It has a kept table, keys for docs/json.md, a rule, a terminal's table, and a section."""
    monkeypatch.setitem(RESULTS, "trials", TRIALS)
    found = sample(Trials)
    assert tables(TRIALS, found, "make trials", tmp_path)[tmp_path / "trials.csv"] == (
        "# command: make trials\n# version: not said\n# preset: text\n"
        "name,speed,psnr_db_machine,ssim_machine,max_error_machine\n"
        f"text,0.5,55.5,0.999,{2 / 255}\n"
    )
    write(tmp_path / "results/trials.json", found)
    words = ("--section", "trials", "--keep", str(tmp_path / "kept"))
    shown = report(tmp_path, capsys, *words)
    assert shown.status == 0, shown.messages
    del found["rows"][0]["note"]
    assert read_kept(TRIALS, tmp_path / "kept").items() >= found.items()
    assert shown.table("trials", "trials") == [
        {"name": "text", "speed, MB/s": 5e-7, "PSNR, machine, dB": 55.5, "SSIM, machine": 0.999,
         "max error, machine, of 255": pytest.approx(2)},
    ]  # fmt: skip
    assert "Trials" in shown.text and "All." in shown.text
    assert TRIALS.takes == ("PRESET",)
    assert "$(RESULTS)/trials.json: ; $(measure) trials --json $@ $(preset)" in known.rules()
    assert page.table(Trials).splitlines()[2:] == [
        "| `preset` | the machine |",
        "| `rows` | one for each trial |",
        "| … `name`, `speed` | of the trial |",
        "| … `note` | why it is slow |",
        "| … `psnr_db_machine`, `ssim_machine`, `max_error_machine` | as above |",
    ]


def test_a_result_has_all_its_fields():
    """A dataclass of a result refuses a missing or unknown key; one that may miss is left out."""
    values = {"name": "a", "speed": 1.0, "psnr_db_machine": None, "ssim_machine": 1.0}
    with pytest.raises(TypeError, match="max_error_machine"):
        Row(**values)
    with pytest.raises(TypeError, match="other"):
        Row(**values, max_error_machine=0.0, other=1)
    assert facts(Row(**values, max_error_machine=0.0)) == values | {"max_error_machine": 0.0}


def test_cells():
    """None, an absent key and a number in their unit."""
    speed, psnr = columns(Row, "speed psnr_db_machine")
    assert speed.cell(speed.value({"speed": 2_500_000})) == "2.5" and speed.heading == "speed, MB/s"
    assert psnr.cell(psnr.value({"psnr_db_machine": None})) == "exact"
    with pytest.raises(KeyError):
        psnr.value({})


def test_generated_files_are_those_of_the_fields():
    path = ROOT / "docs" / "json.md"
    assert page.written(path.read_text()) == path.read_text()
    assert (ROOT / "study/results/rules.mk").read_text().splitlines() == list(known.rules())


def test_sections_are_those_of_titles_and_results():
    assert list(titles.SECTIONS) == [*sections.BLOCKS]
    assert json.dumps([each.name for each in RESULTS.values()]) == json.dumps(list(RESULTS))
