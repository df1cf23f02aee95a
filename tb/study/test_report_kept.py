"""Kept results, stored as tables: the report made from them alone, and broken tables refused."""

import json
import re
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

from splatcore.sim.common import version
from splatcore.sim.common.output import write_json
from splatcore.spec.config import CLOCK_HZ
from splatcore.study.report.kept import FOLDER, decoded, encoded, files, read_kept, tables
from splatcore.study.results.fields import leaves
from splatcore.study.results.known import RESULTS
from splatcore.study.results.scale import Cost
from tb.helpers.command import ROOT, make, run
from tb.helpers.report_page import Page, Report
from tb.helpers.report_samples import VERSION, write

PAGES = [(ROOT / name).read_text() for name in ("README.md", "docs/performance.md")]

KEPT_BYTES = 300_000  # maximum size of a kept file


@pytest.fixture
def kept(samples, tmp_path, monkeypatch) -> Path:
    """A copy of the kept tables, used by the command in place of the repository's."""
    place = tmp_path / "kept"
    shutil.copytree(samples / "kept", place)
    monkeypatch.setattr("splatcore.study.report.kept.FOLDER", place)
    return place


def page(folder: Path, capsys, *words: str) -> Report:
    """Run `splatcore report` on kept results; return the report."""
    status = run("report", "-o", str(folder / "out"), *words)
    return Report(folder / "out", status, capsys.readouterr().err)


def content(sections: dict) -> dict:
    """Tables and figures of a report, without their commands, which contain folder names."""
    return {
        name: {
            key: {k: v for k, v in item.items() if k not in ("commands", "versions")}
            for kind in ("tables", "figures")
            for key, item in section[kind].items()
        }
        for name, section in sections.items()
        if name != "fit"  # its results stay with the user
    }


def test_the_same_page_from_kept_results(samples, kept, tmp_path, capsys):
    found = page(tmp_path, capsys)
    assert found.status == 0, found.messages
    measured = Report(samples / "measured", 0, "")
    assert content(found.sections) == content(measured.sections)
    assert sum(map(len, content(found.sections).values())) > 25
    drawn, before = ([f.tags for f in Page(r.text).figures] for r in (found, measured))
    assert len(drawn) == len(before) - 2  # fit's


def test_the_repository_s_own_page(tmp_path):
    """In a clone without scenes the report is made from the repository's kept tables."""
    done = subprocess.run(
        [sys.executable, "-m", "splatcore", "report", "-o", str(tmp_path / "out")],
        cwd=tmp_path, env={"PATH": "", "SPLATCORE_SCENES": str(tmp_path / "nowhere")},
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    found = Report(tmp_path / "out", done.returncode, done.stderr)
    kept = {name for name in RESULTS if all(path.exists() for path in files(RESULTS[name], FOLDER))}
    assert {"quality", "hard", "synth", "memories"} <= kept
    lines = done.stderr.splitlines()
    missing = set(RESULTS) - kept
    assert done.returncode == bool(lines), done.stderr
    assert all("; create with: make " in line for line in lines), done.stderr
    for name in missing:
        assert any(RESULTS[name].file in line for line in lines), name
    for section, key in (("quality", "quality"), ("published", "published")):
        assert len(found.table(section, key)) > 3, key
    assert {row["machine"] for row in found.table("published", "published")} > {"GSCore", "Neo"}


@pytest.mark.parametrize("name", RESULTS)
def test_the_repository_s_tables(name):
    """The repository's kept tables are complete, small, and without absolute paths."""
    present = [path for path in files(RESULTS[name], FOLDER) if path.exists()]
    if not present:
        return
    facts = read_kept(RESULTS[name], FOLDER)
    assert facts["command"].startswith("make ") and RESULTS[name].file in facts["command"]
    assert "commit " in facts["version"] and "dirty" not in facts["version"]
    for path in present:
        assert path.stat().st_size < KEPT_BYTES
        assert not re.search(r"""(^|[\s=,'"])/\w""", path.read_text()), "an absolute path"
    texts = tables(RESULTS[name], facts, facts["command"], FOLDER)
    assert {path: path.read_text() for path in present} == texts


def test_command_and_version_are_shown(kept, tmp_path, capsys):
    found = page(tmp_path, capsys, "--section", "quality")
    table = found.sections["quality"]["tables"]["quality"]
    command = "make 'SCENES=vase.ply hall.spz' SIZE=64x48 out/report/results/quality/quality.json"
    assert table["commands"] == [command] and table["versions"] == [VERSION]
    assert f"measured with {VERSION}" in found.text
    assert any(command in figure.command for figure in Page(found.text).figures)


def test_empty_text_is_no_missing_value():
    """An empty reason of a failure comes back as it was; an empty cell is a missing value."""
    why = next(leaf for leaf in leaves(Cost) if leaf.key == "why")
    for text in ("", "out of memory"):
        cell = encoded(why, text)
        assert cell and decoded(why, cell) == text


def test_no_folder_is_kept(samples, tmp_path):
    """Kept results name scene and camera files without their folders."""
    facts = json.loads((samples / "results" / "power.json").read_text())
    write(tmp_path / "power.json", facts | {"scene": "/a/b/c.ply", "camera": "/a/b/c.json:2"})
    words = ["--section", "power", "--results", str(tmp_path), "--keep", str(tmp_path / "kept")]
    assert run("report", "-o", str(tmp_path / "out"), *words) == 0
    found = read_kept(RESULTS["power"], tmp_path / "kept")
    assert (found["scene"], found["camera"]) == ("c.ply", "c.json:2")
    assert found["command"] == "make SCENES=c.ply SIZE=64x48 out/report/results/power.json"


def test_the_kept_command_makes_the_result(tmp_path):
    """The kept command works: make finds its scene files in SPLATCORE_SCENES."""
    (tmp_path / "vase.ply").write_text("")
    words = ["SCENES=vase.ply garden", "SIZE=64x48", f"{tmp_path}/quality/quality.json"]
    made = make("-n", *words, RESULTS=str(tmp_path), SPLATCORE_SCENES=str(tmp_path))
    assert made.returncode == 0, made.stderr
    command = f"--out {tmp_path}/quality {tmp_path}/vase.ply garden --size 64"
    assert f"bench quality --psnr , {command}" in made.stdout


def test_views_that_were_not_simulated_are_named(kept, tmp_path, capsys):
    path = kept / "scenes.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("vase.ply")) + "\n")
    found = page(tmp_path, capsys, "--section", "scenes")
    assert found.status == 1
    assert "scenes: not simulated in RTL: vase 0; create with: make RESULTS=" in found.messages
    assert len(found.table("scenes", "scenes")) == 2


def test_make_report_measures_nothing():
    """`make report` runs no measurement; with RESULTS it shows that folder alone."""
    for words, more in (((), ""), (("RESULTS=there",), " --results there")):
        made = make("-n", "report", *words, SPLATCORE="splatcore")
        assert made.stdout.splitlines()[-1].strip() == f"splatcore report -o out/report{more}"


def test_a_new_result_replaces_the_kept_one(samples, kept, tmp_path, capsys):
    facts = json.loads((samples / "results" / "memories.json").read_text())
    write(tmp_path / "out/results/memories.json", facts | {"kilobytes": 7.0, "version": "new"})
    found = page(tmp_path, capsys, "--section", "paper")
    assert found.status == 0, found.messages
    memories = found.sections["paper"]["tables"]["memories"]
    assert memories["rows"][1][2] == 7.0 and memories["versions"] == ["new"]
    assert "out/results/memories.json" in memories["commands"][0]
    assert found.table("paper", "gates")


def renamed(text: str) -> str:
    return text.replace("psnr_db_scene", "psnr_scene", 1)


def dropped(text: str) -> str:
    """Return a table without its last column."""
    return "\n".join(
        line if line.startswith("#") else line.rpartition(",")[0] for line in text.splitlines()
    )


BROKEN = {
    "renamed": (renamed, "column 'psnr_db_scene' is missing"),
    "dropped": (dropped, "column 'cycles.frame' is missing"),
    "added": (lambda text: text.replace(",asked,", ",asked,seen,", 1), "column 'seen' is unknown"),
    "short": (lambda text: text.rpartition(",")[0], "line 15: has 26 cells, not 27"),
    "no number": (lambda text: text.replace("21.75", "many", 1),
                  "line 7: bytes_per_gaussian: 'many' is not a value"),
    "no version": (lambda text: text.replace("# version", "# made by", 1),
                   "has no line '# version: …'"),
    "empty": (lambda text: "", "has no line '# command: …'"),
}  # fmt: skip


@pytest.mark.parametrize("edit, named", BROKEN.values(), ids=list(BROKEN))
def test_broken_tables_are_refused(kept, tmp_path, capsys, edit, named):
    path = kept / "quality.csv"
    path.write_text(edit(path.read_text()))
    found = page(tmp_path, capsys, "--section", "quality", "--section", "ablation")
    assert found.status == 1 and f"quality: {path}: {named}" in found.messages.replace("\n", " ")
    assert found.messages.count("\n") == 1 and named in unescape(found.text)
    assert found.table("ablation", "ablation") and not found.sections["quality"]["tables"]


def test_without_kept_results(tmp_path, monkeypatch, capsys):
    """Without kept results the command fails with one line and writes nothing."""
    monkeypatch.setattr("splatcore.study.report.kept.FOLDER", tmp_path / "nowhere")
    assert run("report", "-o", str(tmp_path / "out")) == 2
    assert "nowhere: folder does not exist; use --results" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_results_state_their_version(tmp_path, monkeypatch):
    """Version and commit in a checkout, elsewhere the version alone; a stated version is kept."""
    found = version.version()
    assert re.fullmatch(r"[\d.]+(, commit [0-9a-f]{10,}(-dirty)?)?", found), found
    for value, expected in (({}, found), ({"version": "old"}, "old")):
        write_json(tmp_path / "a.json", value)
        assert json.loads((tmp_path / "a.json").read_text()) == {"version": expected}
        assert "version" not in value or value["version"] == "old"
    monkeypatch.setattr(version, "CHECKOUT", tmp_path)
    version.version.cache_clear()
    assert re.fullmatch(r"[\d.]+", version.version())
    version.version.cache_clear()


def test_published_machines_have_sources():
    """Every published machine names its source, and the paper's row has the paper's figures."""
    from splatcore.eda.paper import FPS, GATES_ALL, MEMORIES, POWER
    from splatcore.study.report.published import PUBLISHED

    own = PUBLISHED[0]
    assert all(machine.source for machine in PUBLISHED)
    assert own.gates == GATES_ALL / 1e3 and own.memory == sum(MEMORIES.values())
    assert own.power == pytest.approx(POWER, abs=5e-4) and str(FPS) in own.fps
    assert (ROOT / "docs/performance.md").exists()


HEADLINE = r"^\| .* \| (.*) \| `make (?:.* )?out/report/results/(.*)` \|$"


def headline() -> list[list[str]]:
    """The figures of the README's first table and of docs/performance.md's, of what is kept."""
    quality, scenes = (read_kept(RESULTS[name], FOLDER)["rows"] for name in ("quality", "scenes"))
    by_packing = {
        asked: [row for row in quality if row["asked"] == asked]
        for asked in ("compact", "balanced", "faithful")
    }
    fps = sorted(CLOCK_HZ / row["cycles"]["frame"] for row in by_packing["compact"])
    rtl = sorted(CLOCK_HZ / row["cycles"]["frame"] for row in scenes)
    against_scene = [min(row["psnr_db_scene"] for row in rows) for rows in by_packing.values()]
    most_bytes = [max(row["bytes_per_gaussian"] for row in rows) for rows in by_packing.values()]
    cases = read_kept(RESULTS["hard"], FOLDER)["cases"].values()
    assert all(row["identical"] for row in scenes)
    readme = [
        f"{rtl[0]:,.0f} to {rtl[-1]:,.0f}, {len(rtl)} views",
        f"{min(row['psnr_db_machine'] for row in quality):.1f} dB",
        f"{', '.join(f'{each:.1f}' for each in against_scene)} dB",
        f"{read_kept(RESULTS['synth'], FOLDER)['top']['nand2'] / 1e3:,.0f} k NAND2",
        f"{read_kept(RESULTS['memories'], FOLDER)['kilobytes']:.1f} KB",
    ]
    performance = [
        f"{fps[0]:.0f} to {fps[-1]:,.0f}, {len(fps)} views",
        f"{', '.join(f'{each:.2f}' for each in most_bytes)} bytes",
        f"{sum(case['passed'] for case in cases)} of {len(cases)}",
    ]
    return [readme, performance]


def test_the_headline_figures():
    """Each stands in the page's table as kept results have it, with a command that exists."""
    for page, figures in zip(PAGES, headline(), strict=True):
        rows = re.findall(HEADLINE, page, re.M)
        assert [value for value, _ in rows] == figures
        assert {file for _, file in rows} <= {result.file for result in RESULTS.values()}
