"""The first command of the README, `make demo`, as a user runs it."""

import json
import sys
from fnmatch import fnmatch
from pathlib import Path

import pytest

from splatcore.sim.frame.picture import read_png
from tb.helpers.command import ROOT, make, run


@pytest.mark.slow
def test_demo():
    """It succeeds, and the picture from RTL is bit-identical to the golden model's."""
    done = make("demo", BIN=str(Path(sys.executable).parent), SIZE="160x90")
    assert done.returncode == 0, done.stderr
    assert json.loads((ROOT / "out/rtl.json").read_text())["identical"]
    assert read_png(ROOT / "out/rtl.png").shape == (90, 160, 3)


def test_git_ignores_its_files(tmp_path):
    """git ignores the register files that `make demo` writes into docs/."""
    assert run("registers", "-o", tmp_path) == 0
    patterns = (ROOT / ".gitignore").read_text().split()
    for path in tmp_path.iterdir():
        assert any(fnmatch(f"docs/{path.name}", pattern) for pattern in patterns), path.name
