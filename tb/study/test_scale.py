"""`splatcore bench scale`: rows, files, ratios to another checkout, and commands that fail."""

import csv
import sys
from pathlib import Path

import pytest

from splatcore.sim.frame.picture import read_png
from splatcore.spec.error import InputError
from splatcore.spec.need import NEEDS
from splatcore.study.bench import scale
from splatcore.study.bench.measured import Checkout
from splatcore.study.results.scale import Cost, ScaleRow
from tb.helpers.command import ROOT, check_refused, load, run

FEW = {"info": "info scene.ply", "golden": "render none.splatcore -o golden.png"}
"""A command that works, and one that fails."""


@pytest.fixture
def few(monkeypatch, tmp_path):
    """Few commands, and nothing that is compiled first; a working folder."""
    monkeypatch.setattr(scale, "COMMANDS", FEW)
    monkeypatch.setattr(scale, "WARM", 10)
    monkeypatch.chdir(tmp_path)


def test_rows_files_and_failures(few, capsys):
    """A failed command is a row with its reason; the others go on. Nothing temporary is left."""
    assert run("bench scale -o out --counts 2000,4000 --degrees 1 --size 64x48") == 1
    found, why = load(Path("out/scale.json")), "none.splatcore: No such file or directory"
    assert [(row["gaussians"], row["run"], row["cost"]["why"]) for row in found["rows"]] == [
        (count, name, why if name == "golden" else "")
        for count in (2000, 4000)
        for name in ("scene", "info", "golden")
    ]
    for row in found["rows"]:
        assert row["cost"]["cpu_seconds"] > 0.1 and row["cost"]["wall_seconds"] > 0
        assert 10e6 < row["cost"]["peak_bytes"] < 1e9
        assert "against" not in row and "cpu_ratio" not in row
    assert found["failed"][0] == {"what": "golden, 2,000 Gaussians of degree 1", "why": why}
    assert [need["work"] for need in found["needs"]] == ["reading"]
    rows = list(csv.DictReader(Path("out/scale.csv").read_text().splitlines()))
    assert [row["Gaussians, M"] for row in rows] == ["0.002"] * 3 + ["0.004"] * 3
    assert read_png("out/scale.png").std() > 5
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "scale.csv", "scale.json", "scale.png",
    ]  # fmt: skip
    printed = capsys.readouterr()
    assert "reading" in printed.out and printed.err.count("missing: golden, 2,000 Gau") == 1


def test_a_scene_that_cannot_be_generated_is_one_row(few, monkeypatch):
    made = []

    def measured(checkout, command, folder):
        made.append(command)
        return Cost(cpu_seconds=1.0, wall_seconds=1.0, peak_bytes=1, why="no")

    monkeypatch.setattr(Checkout, "measured", measured)
    assert run("bench scale -o out --counts 2000 --degrees 0,3") == 1
    assert [row["run"] for row in load(Path("out/scale.json"))["rows"]] == ["scene", "scene"]
    assert [command[4:6] for command in made] == [["--sh-degree", "0"]] * 2 + [["--sh-degree", "3"]]


def test_the_same_checkout_is_as_fast(few, capsys):
    """The repository itself as the other checkout: with a ratio for what works."""
    words = f"-o out --counts 2000,2001 --degrees 1 --against {ROOT} --against-most 2000"
    assert run(f"bench scale {words}") == 1
    _, info, golden, *larger = load(Path("out/scale.json"))["rows"]
    assert info["against"]["why"] == "" and golden["against"]["why"] == golden["cost"]["why"] != ""
    assert 0.2 < info["cpu_ratio"] < 5 and 0.8 < info["peak_ratio"] < 1.25
    assert golden["cpu_ratio"] is golden["peak_ratio"] is None
    assert [row["gaussians"] for row in larger] == [2001] * 3
    assert not any("against" in row for row in larger)
    assert "CPU ratio" in capsys.readouterr().out


def test_the_order_of_checkouts_alternates(tmp_path, monkeypatch):
    ran = []

    def measured(checkout, command, folder):
        ran.append((checkout.folder, command[0], folder.name))
        return Cost(cpu_seconds=2.0, wall_seconds=1.0, peak_bytes=1, why="")

    monkeypatch.setattr(Checkout, "measured", measured)
    rows = list(scale.of_scene(tmp_path, 10, 1, "64x48", [Checkout(), Checkout(ROOT)]))
    assert [row.cpu_ratio for row in rows[1:]] == [1.0] * len(scale.COMMANDS)
    others = [k for k, (folder, *_) in enumerate(ran[1:]) if folder == ROOT]
    assert others[:4] == [1, 2, 5, 6]
    assert all(name == ("1" if folder else "0") for folder, _, name in ran[1:])


def checkout(folder: Path, where: str, text: str) -> Checkout:
    """A checkout whose command line is a program."""
    place = folder / where / "splatcore"
    place.mkdir(parents=True)
    (place / "__init__.py").touch()
    (place / "__main__.py").write_text(text)
    return Checkout(folder)


@pytest.mark.parametrize("where", ["", "src"])
def test_a_checkout_without_an_environment(tmp_path, where):
    """Its rooms are folders of its root; arguments arrive; the last line of an error is kept."""
    text = "import sys\nfrom splatcore.sim import deep\nprint('a\\nerror:', sys.argv[1:], file="
    text += "sys.stderr)\nsys.exit(deep.STATUS)"
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "deep.py").write_text("STATUS = 3")
    made = checkout(tmp_path, where, text)
    assert made.measured(["x", "--y"], tmp_path).why == "['x', '--y']"


def test_an_own_environment_is_used(tmp_path):
    place = tmp_path / ".venv" / "bin"
    place.mkdir(parents=True)
    (place / "python").symlink_to(sys.executable)
    assert Checkout(tmp_path).words == [str(place / "python"), "-m", "splatcore"]


def test_no_checkout(tmp_path):
    with pytest.raises(InputError, match=f"--against {tmp_path}: is no checkout"):
        _ = Checkout(tmp_path).words


def test_a_killed_command_is_a_cost(tmp_path):
    """Its peak is of its children, too."""
    text = "import os, signal, subprocess, sys\nprint('half done', file=sys.stderr, flush=True)\n"
    text += "grow = 'import time; held = b\"1\" * 50_000_000; time.sleep(0.5)'\n"
    text += "subprocess.run([sys.executable, '-c', grow])\nos.kill(os.getpid(), signal.SIGKILL)"
    found = checkout(tmp_path, "", text).measured([], tmp_path)
    assert found.why == "ended by signal 9 (SIGKILL), maybe out of memory"
    assert 50e6 < found.peak_bytes < 100e6 and found.wall_seconds > 0.5


def rows(**bytes_of) -> list[ScaleRow]:
    """Rows of two counts and degrees whose peaks follow base + count · (each + 7·coefficients)."""
    base = 5e6
    return [
        ScaleRow(gaussians=count, sh_degree=degree, run=name, cost=Cost(
            cpu_seconds=1.0, wall_seconds=1.0, why="",
            peak_bytes=int(base + count * (each + 7 * (degree + 1) ** 2)),
        ))
        for name, each in bytes_of.items()
        for count in (10**5, 10**6)
        for degree in (1, 3)
    ]  # fmt: skip


def test_needs_are_fitted():
    """The larger of two commands counts; the work is that of `NEEDS`."""
    made = rows(info=50, balanced=100, compact=90)
    for row in made:
        row.run = {"compact": "pack compact", "balanced": "pack balanced"}.get(row.run, row.run)
    found = {need.work: need for need in scale.needs(made)}
    assert list(found) == ["reading", "packing"] and set(scale.WORK) == set(NEEDS)
    for work, each in (("reading", 50), ("packing", 100)):
        need = found[work]
        fitted = need.base, need.gaussian, need.coefficient
        assert fitted == pytest.approx((5e6, each, 7), rel=1e-3)


@pytest.mark.parametrize("option", ["--counts 0", "--counts 1,x", "--degrees 4", "--degrees -1"])
def test_numbers_out_of_range(few, capsys, option):
    check_refused(capsys, f"bench scale -o out {option}", option.split()[0])
    assert not Path("out").exists()


@pytest.mark.slow
def test_all_commands(tmp_path, monkeypatch):
    """Everything works in the repository, and takes as much memory in the same checkout."""
    monkeypatch.chdir(tmp_path)
    words = f"-o out --counts 2000,4000 --degrees 1,3 --size 64x48 --against {ROOT}"
    assert run(f"bench scale {words}") == 0
    found = load(Path("out/scale.json"))
    assert len(found["rows"]) == 4 * (1 + len(scale.COMMANDS)) and len(found["needs"]) == 4
    assert all(0.7 < row["peak_ratio"] < 1.4 for row in found["rows"] if row["run"] != "scene")
