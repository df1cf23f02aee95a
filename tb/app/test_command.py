"""Main commands end to end: files and JSON keys written, one-line errors, exit status, imports."""

import subprocess
import sys

import numpy as np
import pytest

from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app, groups
from splatcore.app.cli.verilog import PARTS
from splatcore.eda.deliver.verilog import WRITERS
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.model_file import read_model
from splatcore.model.formats.read import read_scene
from splatcore.sim.frame.metric import Compared, Result, against, difference, metrics_line
from splatcore.sim.frame.picture import read_png
from tb.helpers.command import KEYS, ROOT, load, run


def test_render(folder, capsys):
    files = "-o a.png --json a.json --heat-map tiles.png"
    assert run(f"render scene.ply --camera cameras.json:7 {files}") == 0
    result = load(folder / "a.json")
    assert list(result) == KEYS
    assert result["engine"] == "reference" and result["preset"] == "DEFAULT"
    assert result["size"] == [64, 48] and result["camera"] == "cameras.json:7"
    assert result["counts"]["gaussians"] == 200 and result["seconds"] > 0
    assert result["psnr_db_machine"] is None and result["cycles"] is None
    picture = read_png("a.png")
    assert picture.shape == (48, 64, 3) and picture.std() > 5
    assert read_png("tiles.png").shape[2] == 3
    assert "contributions" in capsys.readouterr().out


def test_golden_compares_by_default(folder):
    run("pack scene.ply -o m.splatcore --quality faithful --camera cameras.json")
    for name, more in (("a", ""), ("b", " --no-compare")):
        files = f"-o {name}.png --json {name}.json"
        assert run(f"render m.splatcore --camera cameras.json --engine golden {files}{more}") == 0
    a, b = load(folder / "a.json"), load(folder / "b.json")
    assert (read_png("a.png") == read_png("b.png")).all() and a["counts"] == b["counts"]
    assert a["psnr_db_machine"] > 40 and b["psnr_db_machine"] is None


def test_size_scales_the_intrinsics(folder):
    run("render", "scene.ply", "--camera", "cameras.json:4", "-o", "a.png")
    run("render", "scene.ply", "--camera", "cameras.json:4", "--size", "256x192", "-o", "b.png")
    small, large = read_png("a.png").astype(float), read_png("b.png").astype(float)
    shrunk = large.reshape(48, 4, 64, 4, 3).mean((1, 3))
    assert np.abs(shrunk - small).mean() < 6  # the same view


def test_options_reach_the_renderer(folder):
    run("render", "scene.ply", "--camera", "cameras.json", "-o", "a.png")
    run("render", "scene.ply", "--camera", "cameras.json", "-o", "b.png", "--background", "0,0,1")
    run("render scene.ply --camera cameras.json -o c.png --original --json c.json")
    a, b = read_png("a.png").astype(int), read_png("b.png").astype(int)
    assert (b - a)[..., 2].max() > 100 and (a[..., :2] == b[..., :2]).all()
    counts = load(folder / "c.json")["counts"]
    assert counts["pairs"] == counts["pairs_3sigma"]


def test_a_generated_scene_by_name(folder):
    assert run("render", "needles", "-o", "a.png", "--json", "a.json") == 0
    assert load(folder / "a.json")["scene"] == "needles"


@pytest.mark.slow
def test_an_empty_scene_is_a_black_picture(folder):
    """A scene without Gaussians is falsy in Python, but valid: every command accepts it."""
    assert run("render", "empty", "-o", "a.png", "--json", "a.json") == 0
    assert load(folder / "a.json")["counts"]["gaussians"] == 0 and not read_png("a.png").any()
    assert run("info", "empty") == 0
    assert run("pack", "empty", "-o", "empty.splatcore") == 0
    assert run("info", "empty.splatcore") == 0
    assert run("render", "empty.splatcore", "--size", "20x10", "-o", "b.png") == 0
    assert not read_png("b.png").any()


def test_the_default_camera_sees_the_scene(folder):
    assert run("render", "scene.ply", "--size", "96x54", "-o", "a.png") == 0
    assert read_png("a.png").shape == (54, 96, 3) and read_png("a.png").std() > 5


def test_pack_render_compare(folder, capsys):
    """`compare` of scene and model pictures gives the PSNR that `pack` reports."""
    assert run("pack scene.ply -o scene.splatcore --json pack.json --camera cameras.json") == 0
    report = load(folder / "pack.json")
    assert report["packed"] + report["transparent"] == 200 and report["psnr_db_packing"] > 30
    assert len(read_model("scene.splatcore")) == report["packed"]
    for name in ("scene.ply", "scene.splatcore"):
        run("render", name, "--camera", "cameras.json", "-o", name + ".png")
    assert run("compare scene.ply.png scene.splatcore.png -o map.png --json c.json") == 0
    result = load(folder / "c.json")
    assert list(result) == list(vars(Compared("", ""))) and result["against"] == "scene.ply.png"
    assert result["psnr_db"] == pytest.approx(report["psnr_db_packing"]) and not result["identical"]
    assert read_png("map.png").size > 0
    options = "--scene scene.ply --camera cameras.json --json three.json"
    run(f"compare scene.ply.png reference scene.ply.png {options}")
    images = load(folder / "three.json")["images"]
    assert [image["identical"] for image in images] == [True, True]
    assert "identical" in capsys.readouterr().out


def test_against_model_and_scene(folder, capsys):
    """`render`, `compare` and `cycles` report both PSNRs for a scene, one for a packed model."""
    view = "--camera cameras.json --json"
    assert run(f"render scene.ply --engine golden -o g.png {view} g.json") == 0
    assert run(f"render scene.ply -o scene.png {view} r.json") == 0
    assert run("pack scene.ply -o scene.splatcore --camera cameras.json") == 0
    assert run(f"render scene.splatcore -o model.png {view} r.json") == 0
    wanted = {
        of: difference(read_png("g.png"), read_png(f"{file}.png"))
        for of, file in (("machine", "model"), ("scene", "scene"))
    }
    result = load(folder / "g.json")
    assert result | against(wanted) == result
    assert result["psnr_db_machine"] > result["psnr_db_scene"] + 1
    printed = capsys.readouterr().out
    assert f"against the reference: {metrics_line(wanted)}" in printed
    assert run(f"render scene.splatcore --engine golden -o g.png {view} m.json") == 0
    assert load(folder / "m.json")["psnr_db_machine"] == result["psnr_db_machine"]
    assert load(folder / "m.json")["psnr_db_scene"] is None
    capsys.readouterr()
    assert run(f"compare reference golden --scene scene.ply {view} both.json") == 0
    both = load(folder / "both.json")
    assert both | against(wanted) == both and both["psnr_db"] == both["psnr_db_machine"]
    printed = capsys.readouterr().out
    assert printed.split("\n")[0].strip() == "against reference"
    assert "machine: reference on the packed model; scene: reference on the original" in printed
    rows = [line.split() for line in printed.splitlines() if line.startswith(" golden ")]
    assert [row[:3] for row in rows] == [
        ["golden", of, f"{wanted[of].psnr_db:.2f}"] for of in ("machine", "scene")
    ]
    assert run(f"compare reference golden --scene scene.splatcore {view} one.json") == 0
    one = load(folder / "one.json")
    assert one["psnr_db_machine"] == both["psnr_db_machine"] and one["psnr_db_scene"] is None
    assert run(f"cycles scene.ply scene.splatcore {view} c.json") == 0
    of_scene, of_model = load(folder / "c.json")["scenes"].values()
    assert of_scene | against(wanted) == of_scene
    assert of_model | against({"machine": wanted["machine"]}) == of_model
    assert "psnr_db_scene" not in of_model
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith(" FPS at 800 MHz ")]
    rows = [line.split() for line in lines if line.startswith(" dB, ")]
    db = {of: f"{wanted[of].psnr_db:.2f}" for of in wanted}
    assert rows == [["dB,", "machine", db["machine"], db["machine"]],
                    ["dB,", "scene", db["scene"], "–"]]  # fmt: skip
    background = "--engine golden --background 0,0,1"
    assert run(f"render scene.ply {background} -o b.png {view} b.json") == 0
    assert load(folder / "b.json")["psnr_db_machine"] > 45


def test_scene_and_info(folder, capsys):
    assert run("scene", "garden", "-o", "g.ply", "--count", "500", "--cameras", "g.json") == 0
    assert len(read_scene("g.ply")) == 500 and len(read_cameras("g.json")) == 1
    assert run("info", "g.ply", "--json", "info.json") == 0
    facts = load(folder / "info.json")
    assert facts["gaussians"] == 500 and facts["sh_degree"] == 1 and facts["notes"] == []
    run("pack", "g.ply", "-o", "g.splatcore", "--camera", "g.json", "--size", "32x18")
    assert run("info", "g.splatcore", "--json", "info.json") == 0
    assert load(folder / "info.json")["bytes_per_gaussian"] > 20
    assert "SH degree 1" in capsys.readouterr().out


@pytest.mark.slow
def test_synth(folder):
    stages = "--stage", "add", "--stage", "cull"
    assert run("synth", *stages, "--preset", "tiny", "--json", "s.json") == 0
    stages = load(folder / "s.json")["stages"]
    assert 1000 < stages["add"]["nand2"] < stages["cull"]["nand2"] < stages["cull"]["speed_nand2"]
    assert stages["cull"]["paper_nand2"] == 12_900
    assert stages["add"]["flip_flops"] > 50 and stages["add"]["depth"] > 5


@pytest.mark.slow
def test_empty_model(folder, capsys):
    """A model without Gaussians is falsy in Python, but valid."""
    assert run("pack", "empty", "-o", "empty.splatcore") == 0
    assert run("render", "empty.splatcore", "--engine", "golden", "-o", "e.png") == 0
    assert run("compare", "reference", "golden", "--scene", "empty.splatcore") == 0
    assert "identical" in capsys.readouterr().out
    assert run("cycles", "empty.splatcore", "--json", "e.json") == 0
    assert load(folder / "e.json")["scenes"]["empty.splatcore"]["psnr_db_machine"] is None


MEMORIES = """
import gc
from splatcore.app.cli.main import main
try:
    main(["memories", "--json", "m.json"])
finally:
    gc.collect()
"""


@pytest.mark.slow
def test_memories(folder):
    """In a separate process, because Amaranth warns about unused components only when they are
    deleted, which may be long after the test that created them."""
    command = [sys.executable, "-W", "always", "-c", MEMORIES]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    facts = load(folder / "m.json")
    bits = [m["words"] * m["bits"] * m["count"] for part in facts["stages"].values() for m in part]
    assert sum(bits) / 8192 == pytest.approx(facts["kilobytes"]) and facts["kilobytes"] > 50
    assert "The paper (Chang and Chang): 120 KB" in done.stdout


IN_ORDER = """
from splatcore.app.cli.main import register
from splatcore.app.cli.options import app, groups
register()
for group, part in {"": app, **groups}.items():
    for command in part.registered_commands:
        file = command.callback.__module__.split(".")[-1]
        print(f"{group} {command.name}".strip(), file, sep=",")
"""


def test_commands_are_in_the_order_of_the_table():
    """In a process that has not imported any command yet."""
    printed = subprocess.run([sys.executable, "-c", IN_ORDER], capture_output=True, text=True)
    found = [tuple(line.split(",")) for line in printed.stdout.splitlines()]
    assert found == [(name, file) for name, (file, *_) in COMMANDS.items()]


def test_the_table_matches_the_help():
    register()
    helps = {
        " ".join([group] * bool(group) + [command.name]): command.help or command.callback.__doc__
        for group, part in {"": app, **groups}.items()
        for command in part.registered_commands
    }
    assert set(helps) == set(COMMANDS)
    for name, entry in COMMANDS.items():
        first = " ".join(helps[name].split("\n\n")[0].split())
        assert len(entry.summary) <= 75 and entry.summary == first, name


HEAVY = "amaranth matplotlib numba scipy skimage sklearn torch".split()
"""Libraries that take 0.1 seconds or more to import."""

IMPORTED = """
import sys
from splatcore.app.cli.main import main
try:
    main()
finally:
    print("|", *sys.modules)
"""


@pytest.mark.parametrize(
    "words",
    ["--help", "", "bench", "bench --help", "rendr", "render --help", "render none.ply -o a.png",
     "render none.ply --engine golden -o a.png", "render none.ply --engine rtl -o a.png",
     "render garden -o a.jpg", "info none.ply", "pack none.ply -o a", "cycles none.ply",
     "cycles --size 0x1 garden", "compare reference golden", "compare none.png none.png",
     "compare reference golden --scene none.ply", "cycles garden --cameras none.json",
     "compare reference golden --scene none.ply --cameras 1", "render garden --cameras 1 -o a",
     "render garden --cameras none.json --video v.mp4", "scene jungle -o a.ply", "error none.ply",
     "fit none.ply --fps 9 -o a.toml", "programs --show none", "verilog --part none -o a",
     "registers -o none/a", "example -o none/a", "train none -o none/a", "bench rule none.ply -o a",
     "photographs none.ply -o a", "photographs garden -o a --cameras none.json",
     "bench scenes none.ply -o a", "bench sort -o none/a", "soak", "soak frames --help",
     "soak faults -o a --count 0", "hard --help", "hard none", "report --help",
     "report -o a --section none", "power --help", "power none.ply",
     "power garden --liberty none.lib --process 130"],
)  # fmt: skip
def test_help_and_refusals_import_nothing_heavy(tmp_path, words):
    """Help and errors come at once: no slow library is imported before them."""
    command = [sys.executable, "-c", IMPORTED, *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == (0 if "--help" in words else 2), done.stderr
    modules = {name.partition(".")[0] for name in done.stdout.rpartition("|")[2].split()}
    assert not modules & set(HEAVY) and "numpy" in modules
    assert not [*tmp_path.iterdir()]


def test_verilog_parts_match_the_writers():
    assert list(PARTS) == list(WRITERS)


def test_usage_errors_exit_with_2(capsys):
    assert run("render") == 2
    assert run("fly") == 2 == run("bench", "fly")
    assert "Traceback" not in capsys.readouterr().err


def test_result_has_the_documented_keys():
    assert list(vars(Result("reference", "DEFAULT"))) == KEYS
    keys = [*KEYS, *vars(Compared("", ""))]
    others = "psnr_db_packing bytes_per_gaussian middle_98_percent nand2".split()
    documented = (ROOT / "docs" / "json.md").read_text()
    assert all(f"`{key}`" in documented for key in (*keys, *others))


@pytest.mark.slow
def test_python_m_sim():
    command = [sys.executable, "-m", "splatcore", "render", "none.ply", "-o", "none.png"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr == "error: none.ply: No such file or directory\n"
