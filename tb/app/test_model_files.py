"""Model files on the command line: coded and plain hold the same model; both sizes reported."""

import re
from pathlib import Path

from splatcore.model.formats.model_file import read_model
from splatcore.sim.frame.picture import read_png
from tb.helpers.command import load, run


def test_plain_and_coded_files(folder, capsys):
    """Both files render the same picture; a plain file is the memory image byte by byte."""
    command = "pack scene.ply --camera cameras.json --quality faithful"
    assert run(f"{command} -o c.splatcore --json c.json") == 0
    printed = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert run(f"{command} -o p.splatcore --json p.json --plain") == 0
    coded, plain = load(folder / "c.json"), load(folder / "p.json")
    model = read_model("c.splatcore")
    assert Path("p.splatcore").read_bytes() == model.image.tobytes()
    assert plain["file_bytes"] == plain["bytes"] == coded["bytes"] == len(model.image)
    assert coded["file_bytes"] == Path("c.splatcore").stat().st_size < coded["bytes"]
    sizes = "bytes", "file_bytes"
    for name in sizes:
        shown = f"{coded[name]:,}".replace(",", " ")
        assert f" {name.replace('_', ' ')} {shown} " in printed
    assert run("info c.splatcore --json info.json") == 0
    facts = load(folder / "info.json")
    assert [facts[name] for name in sizes] == [coded[name] for name in sizes]
    for name in ("c", "p"):
        options = f"--camera cameras.json --engine golden -o {name}.png --json {name}.json"
        assert run(f"render {name}.splatcore --no-compare {options}") == 0
    assert (read_png("c.png") == read_png("p.png")).all()


def test_a_broken_coded_file(folder, capsys):
    run("pack scene.ply -o c.splatcore --camera cameras.json --quality faithful")
    data = Path("c.splatcore").read_bytes()
    Path("cut.splatcore").write_bytes(data[:3000])
    capsys.readouterr()
    for command in ("info", "cycles", "render -o a.png"):
        assert run(f"{command} cut.splatcore") == 2
        assert re.fullmatch(
            r"error: cut\.splatcore: .* only \d+ are left\n", capsys.readouterr().err
        )
