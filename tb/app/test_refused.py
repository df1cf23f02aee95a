"""Bad input of every command: one line of error, and no file is written; help texts."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from splatcore.model.generate.generate import GENERATORS, generate
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.study.compression import run as compression_run
from splatcore.study.report.titles import SECTIONS
from tb.helpers.command import check_refused, run, write_scene


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small scene, two cameras, its packed model, and broken files."""
    folder = tmp_path_factory.mktemp("refused")
    write_scene(folder)
    scene, model, cameras = map(folder.joinpath, ("scene.ply", "scene.splatcore", "cameras.json"))
    assert run("pack", scene, "-o", model, "--camera", cameras) == 0
    image, data = bytearray(model.read_bytes()), scene.read_bytes()
    image[1000] ^= 1
    less = data.replace(b"property float rot_3\n", b"", 1)
    files = {"damaged.splatcore": image, "cut.ply": data[:5000], "less.ply": less, "file": b""}
    files |= {"bare.json": b'[{"id": 0, "width": 4, "height": 4}]', "empty.json": b"[]"}
    scene = generate("garden", 30)
    for degree in (1, 3):
        sh = np.random.default_rng(degree).normal(size=(30, (degree + 1) ** 2, 3)) / 9
        packed, _ = pack(replace(scene, sh=sh), quality="balanced")
        files[f"degree{degree}.splatcore"] = packed.image.tobytes()
    files["plain.toml"] = b'name = "PLAIN"\nsh_degree = 2\n'
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def unchanged(place, monkeypatch):
    """That folder as the working folder; no test may change it."""
    monkeypatch.chdir(place)
    before = {path: path.read_bytes() for path in place.iterdir()}
    yield
    assert {path: path.read_bytes() for path in place.iterdir()} == before


WAVES = "render scene.ply --engine rtl --preset tiny --size 9x9 --waves w.vcd -o a.png"

BAD = {
    "bench ablation -o nowhere/X garden": "nowhere/X: folder .* does not exist",
    "bench coding scene.ply -o out": "bench coding: .* removed; .*2026-11-compression.md",
    "programs --show cull": "programs: .* removed; spec/programs.py",
    "bench scenes --out out scene.ply --timing x": "'x'.*ideal or lpddr4",
    "bench scenes --out out --cameras 3 scene.splatcore": "no camera file",
    "bench sort -o out --lengths 1,two": "--lengths '1,two': must be numbers",
    "bench sort -o out --lengths 0,4": "--lengths '0,4': must all be in 1",
    "bench sort -o out --preset HUGE": "HUGE",
    "bench sort -o none/out": "none/out",
    "bench sort -o out --json none/a.json": "none/a.json",
    "coverage nowhere": "nowhere: holds no counts of simulations",
    "soak frames -o out --count 0": "--count 0: must be ≥ 1",
    "soak faults -o out --seed -1": "--seed -1: must be ≥ 0",
    "soak faults -o none/out": "none/out",
    "bench sweep -o out --point best": "--point 'best': unknown",
    "bench sweep -o out garden --size 0x5": "--size 0x5: width 0 is not in",
    "compare scene.ply": "two images",
    "compare scene.ply scene.ply -o a.png": "scene.ply: is not an image",
    "compare reference reference -o a.png": "--scene",
    "error scene.ply --width wide": "'wide'.*7/16",
    "error empty": "empty: no Gaussian is visible",
    "error scene.ply --stage roof": "--stage 'roof'",
    "error --scenes none": "--scenes none: no such folder",
    "error --camera cameras.json --scenes .": "--camera: goes with a SCENE",
    "error scene.ply --scenes .": r"--scenes \.: name a folder or a SCENE",
    "error scene.ply none.ply": r"none\.ply: No such file",
    "error scene.ply --camera none.json": r"none\.json: no such file",
    "error scene.ply --preset HUGE": "HUGE",
    "fit scene.ply -o out.toml --fps 0": "--fps 0: is not in",
    "fit scene.ply -o out.toml --fps nan": "--fps nan: is not in",
    "fit scene.ply -o out.toml --fps -3": "--fps -3",
    "fit scene.ply -o out.toml --fps 9 --psnr inf": "--psnr inf",
    "fit scene.ply -o out.toml --fps 9 --psnr 0": "--psnr 0",
    "fit scene.ply -o out.toml --fps 9 --size 5000x10": "--size 5000x10: ",
    "fit scene.ply -o out.toml --fps 9 --cameras none.json": r"none\.json",
    "fit scene.ply -o out.toml --fps 9 --cameras empty.json": "holds no cameras",
    "fit scene.ply --fps 9 -o x.json": r"must end in \.toml",
    "fit scene.ply --fps 9 -o paper.toml": "the name of a built-in preset",
    "fpga --stage nothing": "--stage 'nothing': unknown",
    "fpga --whole --stage cull": "use --whole or --stage, not both",
    "fpga --device 12k": "--device '12k': unknown",
    "hard roof": "hard case 'roof'.*needles, flakes.*one_pixel",
    "hard one --engine gpu": "'gpu'",
    "hard one --preset huge": "'huge'",
    "hard one --size wide": "'wide'",
    "hard one --preset tiny --size 65x64": "65x64.*64x64",
    "hard one --engine rtl --timing slow": "'slow'.*ideal or lpddr4",
    "hard one --timing ideal": "--timing: goes with --engine rtl",
    "hard one -o none/pictures": "none/pictures: folder .* does not exist",
    "hard one -o file": "file: is not a folder",
    "hard one --json none/a.json": "none/a.json",
    "cycles scene.ply scene.splatcore --quality compact": "scene.splatcore is packed already",
    "bench scenes -o out scene.splatcore --quality small": "scene.splatcore is packed already",
    "bench rule -o out scene.splatcore --quality small": "scene.splatcore is packed already",
    "bench ablation -o out garden --rtl scene.splatcore --quality small": "is packed already",
    "info less.ply": "less.ply.*rot_3",
    "info gardn": "gardn: No such file or directory, and no generated scene has this name",
    "render scene.ply --camera 10 -o a.png": "10: no such file; camera 10 of FILE is FILE:10",
    "pack cut.ply -o a.splatcore": "cut.ply",
    "pack scene.splatcore -o a.splatcore": "scene.splatcore.*packed",
    "photographs none.ply -o a": "none.ply",
    "photographs cut.ply -o a": "cut.ply",
    "photographs less.ply -o a": "less.ply.*rot_3",
    "photographs jungle -o a": "jungle",
    "photographs scene.splatcore -o a": "scene.splatcore.*packed",
    "photographs scene.ply -o a --cameras bare.json": "bare.json.*fx",
    "photographs scene.ply -o a --cameras empty.json": "holds no cameras",
    "photographs scene.ply -o a --size 99999x10": "width 99999",
    "render none.ply -o a.png": "none.ply",
    "render cameras.json -o a.png": "cameras.json",
    "render scene.ply --camera none.json -o a.png": "none.json",
    "render scene.ply --camera cameras.json:5 -o a.png": "cameras.json.*5",
    "render scene.ply --camera bare.json -o a.png": "bare.json.*fx",
    "render scene.ply --size 0x10 -o a.png": "width 0",
    "render scene.ply --size 99999x10 -o a.png": "width 99999",
    "render scene.ply --size big -o a.png": "--size 'big'",
    "render scene.ply --engine golden --original -o a.png": "golden: no --original",
    "render scene.ply --engine rtl --heat-map h.png -o a.png": "rtl: no --original",
    "render scene.ply --engine rtl --no-compare -o a.png": "rtl: no --no-compare",
    "render scene.ply --engine rtl --preset tiny -o a.png": "1920x1080.*64x64",
    "render scene.ply --frames 2 -o a.png": "--frames: goes with --engine rtl",
    "render scene.ply --engine rtl --frames 0 -o a.png": "--frames 0",
    "render scene.ply --engine rtl --timing x -o a.png": "'x'.*ideal or lpddr4",
    "render scene.ply --engine rtl --waves w.vcd -o a.png": "--window or --tile",
    "render scene.ply --engine rtl --window 1:2 -o a.png": "--waves",
    f"{WAVES} --window 2": "--window '2'",
    "render scene.ply --engine rtl --scope top -o a.png": "--scope: goes with --waves",
    "render scene.ply --engine rtl --waves w.ghw --window 1:2 -o a.png": "w.ghw: must end in",
    "render scene.ply --scope top -o a.png": "--scope: goes with --engine rtl",
    "render scene.ply --waves-max 9 -o a.png": "--waves-max: goes with --engine rtl",
    f"{WAVES} --tile 1,0": "--tile 1,0.*9x9",
    "render scene.ply --engine gpu -o a.png": "gpu",
    "render scene.ply --preset HUGE -o a.png": "HUGE.*DEFAULT, PAPER, TINY",
    "render scene.ply -o none/a.png": "none/a.png",
    "render scene.ply -o a.png --json none/a.json": "none/a.json",
    "render scene.ply -o a.png --heat-map none/h.png": "none/h.png",
    "render scene.ply --background 1,2 -o a.png": "--background '1,2'",
    "render damaged.splatcore -o a.png": "damaged.splatcore: checksum",
    "render degree3.splatcore --engine golden --preset plain.toml -o a.png": (
        "degree3.*SH degree 3, preset PLAIN renders up to 2.*--preset PLAIN"
    ),
    "render degree3.splatcore --engine golden --preset paper -o a.png": "degree 3.*up to 1",
    "render degree1.splatcore --engine golden --preset paper -o a.png": "PAPER.*compact",
    "render scene.splatcore --engine golden --preset paper -o a.png": "'chunk', .*PAPER 'absolute'",
    "report -o out --section speed": r"--section 'speed': unknown; choose scenes, quality",
    "report -o out --size 3": "--size '3': is not WIDTHxHEIGHT",
    "report -o out --preset HUGE": "preset 'HUGE': unknown",
    "report -o out --scene none.ply": r"none\.ply",
    "report -o none/out": "none/out: folder .* does not exist",
    "scene jungle -o a.ply": "jungle.*garden",
    "scene garden --count 0 -o a.ply": "count: 0",
    "synth --stage roof": "'roof'.*project",
    "synth --stage add -o out": "-o out: goes with --liberty",
    "synth --stage add --process 130": "--process 130.0: goes with --liberty",
    "synth --stage add --liberty scene.ply": "scene.ply: not a liberty file",
    "verilog -o none/rtl": "none/rtl",
    "example -o none/a": "none/a",
}
"""Arguments → pattern of the error message."""


@pytest.mark.parametrize("arguments", BAD)
def test_bad_input(unchanged, capsys, arguments):
    check_refused(capsys, arguments, BAD[arguments])


@pytest.mark.parametrize(
    "arguments",
    [
        "bench compression garden --out out",
        "compress scene.ply -o m",
        "train . -o m",
    ],
)
def test_without_torch(unchanged, monkeypatch, capsys, arguments):
    monkeypatch.setattr(compression_run, "find_spec", lambda name: None)
    message = r"needs PyTorch: pip install 'splatcore\[compress\]'"
    check_refused(capsys, arguments, message)


PLAIN = "photographs info pack render compare error verilog synth memories cycles"
HELP = dict.fromkeys(["", *PLAIN.split()], ()) | {
    "scene": list(GENERATORS)[:3], "bench": ["sort"], "bench sort": ["--lengths"],
    "soak": ["frames", "faults"], "soak frames": ["--only"],
    "hard": [*HARD, "52 dB"],
    "report": ["make results", "--keep", "--section", "report.html", "needs no network", *SECTIONS],
}  # fmt: skip
"""Commands → words that their help contains."""


@pytest.mark.parametrize("command", HELP)
def test_help(command, capsys):
    assert run(*command.split(), "--help") == 0
    printed = capsys.readouterr().out
    for line, following in pairwise(printed.partition("╭")[0].splitlines()):
        words = (*line.split(), *following.split()[:1])
        assert not line.strip() or not following.strip() or len(" ".join(words)) > 70, line
    text = re.sub(r"\s|│", "", printed)
    assert len(text) > 300 and "--no-run" not in text
    assert all("".join(words.split()) in text for words in HELP[command])
