"""The command `view`: refusals, and a page that is served until an interrupt."""

import signal
import socket
import subprocess
import sys
import urllib.request

import pytest

from splatcore.app.cli import view
from splatcore.app.view import server
from tb.helpers.command import check_refused, run


@pytest.fixture
def place(folder, monkeypatch):
    """A folder with a small scene, two cameras and a packed model."""
    assert run("pack scene.ply -o scene.splatcore --camera cameras.json") == 0
    monkeypatch.setattr(view, "wait", lambda address: pytest.fail("it serves a page"))


REFUSED = {
    "view none.ply": r"none\.ply",
    "view cameras.json": r"cameras\.json: ",
    "view scene.ply --camera cameras.json:5": "no camera '5'",
    "view scene.ply --size 9": "--size '9': is not WIDTHxHEIGHT",
    "view scene.ply --size 640x360 --preset tiny": "TINY renders up to 64x64",
    "view scene.ply --preset none": "preset 'none': unknown",
    "view scene.ply --quality best": "--quality 'best': unknown",
    "view scene.ply --quality faithful --preset paper": "PAPER renders compact models only",
    "view scene.splatcore --quality compact": "is packed already",
    "view empty": "has no Gaussians",
    "view scene.ply --port 70000": "'--port': .* 65535",
    "view scene.ply --host 203.0.113.1": "--host 203.0.113.1",
}


@pytest.mark.slow
def test_refused(place, capsys):
    for arguments, message in REFUSED.items():
        check_refused(capsys, arguments, message)


def test_a_port_that_is_taken(place, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        check_refused(capsys, f"view scene.ply --port {port}", f"--port {port}: Address already")


def test_without_viser(place, capsys, monkeypatch):
    monkeypatch.setattr(server, "find_spec", lambda name: None)
    check_refused(capsys, "view scene.ply", r"pip install 'splatcore\[view\]'")


def restore_interrupt():
    """Restore SIGINT in the child: shells disable it for background jobs."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
def test_page(place):
    command = "view", "scene.ply", "--camera", "cameras.json:7", "--preset", "tiny", "--port", "0"
    command = *command, "--no-antialiased"
    with subprocess.Popen(
        [sys.executable, "-m", "splatcore", *command], stdout=subprocess.PIPE, text=True,
        preexec_fn=restore_interrupt,
    ) as process:  # fmt: skip
        line = process.stdout.readline()
        address = line.split()[1]
        assert line.startswith("scene.ply: http://127.0.0.1:")
        assert line.endswith("; antialiased: no (--no-antialiased)\n")
        with urllib.request.urlopen(address) as answer:
            assert b"<html" in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "ended\n" and process.wait(60) == 0
