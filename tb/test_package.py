"""The installed package: a wheel holds `splatcore` alone, with its rooms inside."""

import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from tb.helpers.command import ROOT

ROOMS = ("spec", "model", "golden", "hdl", "sim", "eda", "study", "app")

RESULTS = "docs/results"  # kept results for the report, no Python


def run(*command: str | Path, folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run(
        [str(word) for word in command], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from a copy, because building leaves files among the sources."""
    folder = tmp_path_factory.mktemp("wheel")
    for room in (*ROOMS, "src", RESULTS):
        shutil.copytree(
            ROOT / room,
            folder / room,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    done = run(
        sys.executable, "-m", "pip", "wheel", ".", "--no-deps", "--no-build-isolation", "-w", "out",
        folder=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return next((folder / "out").glob("splatcore-*.whl"))


def environment(folder: Path) -> Path:
    """Create an environment; return its Python."""
    venv.create(folder / "venv", with_pip=True, symlinks=True)
    return folder / "venv" / "bin" / "python"


def check_command(folder: Path):
    """Check that the command renders and reports, and that only `splatcore` can be imported."""
    commands, work = folder / "venv" / "bin", folder / "work"
    work.mkdir()
    assert "render" in run(commands / "splatcore", "--help", folder=work).stdout
    for command in (["splatcore"], ["python", "-m", "splatcore"]):
        picture = f"{len(command)}.png"
        done = run(
            commands / command[0], *command[1:], "render", "empty", "-o", picture, folder=work
        )
        assert done.returncode == 0, done.stderr
        assert (work / picture).read_bytes().startswith(b"\x89PNG")
    done = run(
        commands / "splatcore", "report", "-o", "report", "--section", "quality", folder=work
    )
    assert done.returncode == 0, done.stderr
    assert "<svg" in (work / "report" / "report.html").read_text()
    for room in (*ROOMS, "tb"):
        done = run(commands / "python", "-c", f"import {room}", folder=work)
        assert f"No module named '{room}'" in done.stderr, room
        named = run(commands / "python", "-c", f"import splatcore.{room}", folder=work)
        assert (named.returncode == 0) == (room != "tb"), named.stderr


@pytest.mark.slow
def test_wheel(wheel, tmp_path):
    """The wheel works in an environment with this one's libraries but not its Splatcore."""
    python = environment(tmp_path)
    done = run(python, "-m", "pip", "install", "--no-deps", wheel, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    site = next((tmp_path / "venv").glob("lib/python*/site-packages"))
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    check_command(tmp_path)


def test_wheel_has_every_file(wheel):
    """The wheel has Python, templates, style sheets, C++, waivers, kept results, nothing else.

    Rules for `make` are of use only in a checkout.
    """
    files = {path.relative_to(ROOT) for room in ROOMS for path in (ROOT / room).rglob("*.*")}
    files = {
        f"splatcore/{path}" for path in files if not {"__pycache__", "rules.mk"} & {*path.parts}
    }
    files |= {f"splatcore/results/{path.name}" for path in (ROOT / RESULTS).iterdir()}
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == files | {"splatcore/__init__.py", "splatcore/__main__.py"}


@pytest.mark.verify
def test_wheel_brings_its_libraries(wheel, tmp_path):
    """The wheel works with only its declared dependencies, from the package registry."""
    done = run(environment(tmp_path), "-m", "pip", "install", wheel, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    check_command(tmp_path)
