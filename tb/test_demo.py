"""The first command of the README, `make demo`, as a user runs it."""

import json
import sys
from pathlib import Path

import pytest

from splatcore.sim.common.picture import read_png
from tb.helpers.command import ROOT, make


@pytest.mark.slow
def test_demo():
    """It ends well, and its picture from the hardware is the golden model's to the bit."""
    done = make("demo", BIN=str(Path(sys.executable).parent))
    assert done.returncode == 0, done.stderr
    assert json.loads((ROOT / "out/rtl.json").read_text())["identical"]
    assert read_png(ROOT / "out/rtl.png").shape == (360, 640, 3)
