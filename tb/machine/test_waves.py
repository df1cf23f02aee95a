"""Waveforms: what is recorded is the window, and the view shows signals that are there."""

import re

import pytest

from splatcore.sim.machine.waves import signals
from tb.helpers.command import run

FIRST, LAST = 300, 420

STREAMS = ("preprocess.points", "preprocess.bin", "render.sort", "render.raster", "axi")
"""Modules whose streams the view must show."""


@pytest.mark.slow
def test_window(tmp_path):
    vcd = tmp_path / "w.vcd"
    assert run("render", "needles", "--engine", "rtl", "--preset", "tiny", "--size", "16x16",
               "-o", str(tmp_path / "w.png"), "--waves", str(vcd),
               "--window", f"{FIRST}:{LAST}") == 0  # fmt: skip
    times = [int(line[1:]) for line in vcd.read_text().splitlines() if line.startswith("#")]
    assert times[0] // 10 >= FIRST and times[-1] // 10 <= LAST + 1
    assert len({time // 10 for time in times}) >= LAST - FIRST
    names = {f"{scope}.{name}" for scope, name, _ in signals(vcd)}
    view = (tmp_path / "w.gtkw").read_text().splitlines()
    shown = [re.sub(r"\[.*", "", line) for line in view if line.startswith("TOP.top.")]
    assert shown and set(shown) <= names
    for module in STREAMS:
        assert any(line.startswith(f"TOP.top.{module}.") for line in shown), module
