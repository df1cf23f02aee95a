"""Long work: out of memory is foreseen, and Ctrl-C leaves nothing behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from splatcore.spec import need
from splatcore.spec.need import NEEDS
from tb.helpers.command import check_refused, run

COMMANDS = {
    "info scene.ply": ("scene.ply: reading", "--lod"),
    "pack scene.ply -o a.splatcore": ("scene.ply: packing", "--sh-degree 1"),
    "render scene.ply -o a.png": ("scene.ply: rendering .* by the reference", "--engine golden"),
    "render scene.ply --engine golden -o a.png": ("scene.ply: packing", "--sh-degree 1"),
    "render model.splatcore --engine golden -o a.png": ("model.* golden model", "splatcore pack"),
    "cycles model.splatcore": ("model.* golden model", "splatcore pack"),
}
"""Command → pattern of the work that does not fit, and of what needs less."""


@pytest.mark.parametrize("command", COMMANDS)
def test_memory_is_checked_before_the_work(folder, monkeypatch, capsys, command):
    """One line with the need, the memory and what needs less; status 2 and no output."""
    assert run("pack scene.ply --quality compact --camera cameras.json -o model.splatcore") == 0
    work, less = COMMANDS[command]
    room = 0 if "reading" in work else NEEDS["reading"].bytes(200, 1)
    monkeypatch.setattr(need, "available", lambda: room)
    monkeypatch.setattr(need, "anonymous", lambda: 0)
    words = command if command.startswith("info") else f"{command} --camera cameras.json"
    check_refused(capsys, words, rf"{work} .*needs \d\.\d GB of memory, but \d\.\d GB .*{less}")
    assert not Path("a.png").exists() and not Path("a.splatcore").exists()


STARTED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may ignore it in background jobs
from splatcore.app.cli import main
from splatcore.sim.common import output
output.EVERY = 0.05
main.main(sys.argv[1:])
"""
"""Program that runs the command line, with frequent lines of progress."""

INTERRUPTED = {
    "scene garden --count 400000 -o new/a.ply": "generating",
    "pack garden.ply --quality faithful --size 64x48 -o new/a.splatcore": "packing",
    "render garden.ply --size 1000x1000 -o new/a.png": "rendering",
    "cycles garden.ply --quality compact --json new/a.json": "packing",
    "export garden.ply -o new/a.spz": "writing",
    "bench scale --counts 100000 -o new/out": "scale|Gaussians",
}
"""Command → pattern of the line of progress at which it is interrupted."""


@pytest.fixture(scope="module")
def garden(tmp_path_factory):
    """A scene that keeps each command busy for a while."""
    place = tmp_path_factory.mktemp("garden") / "garden.ply"
    assert run(f"scene garden --count 60000 -o {place}") == 0
    assert run(f"cycles {place} --size 64x48") == 0  # numba, which compiles here, drops signals
    return place


@pytest.mark.parametrize("command", INTERRUPTED)
def test_an_interrupt_leaves_nothing(garden, tmp_path, command):
    """One line and status 130; neither an output nor a temporary file or folder is left."""
    (tmp_path / "new").mkdir()
    (tmp_path / "tmp").mkdir()
    (tmp_path / "garden.ply").symlink_to(garden)
    process = subprocess.Popen(
        [sys.executable, "-c", STARTED, *command.split()], cwd=tmp_path, text=True,
        env=os.environ | {"TMPDIR": str(tmp_path / "tmp")}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    lines = iter(process.stderr.readline, "")
    label = INTERRUPTED[command].split("|")
    assert any(any(text in line for text in label) for line in lines), "it ended before"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    out, left = process.communicate()
    assert process.returncode == 130, left
    assert not out and left.splitlines()[-1] == "interrupted" and "Traceback" not in left
    assert not [*(tmp_path / "new").iterdir(), *(tmp_path / "tmp").iterdir()]
