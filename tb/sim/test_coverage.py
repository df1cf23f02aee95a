"""Coverage: which branches of hdl/ a simulation took, by line, and which it missed."""

import re
from collections import Counter

import numpy as np
import pytest

from splatcore.hdl.lib.stream import Register
from splatcore.sim.rtl.coverage import FOLDER, Arm, arms
from splatcore.sim.rtl.streams import Simulation
from tb.helpers.command import ROOT, check_documented, load
from tb.helpers.command import run as command

pytestmark = pytest.mark.slow

ITEMS = 200
LINE = 1 + next(
    number
    for number, text in enumerate((ROOT / "hdl/lib/stream.py").read_text().splitlines())
    if re.search(r"m.If\(~self.o.valid \| self.o.ready\)", text)
)
"""Line of the condition that is false while an item waits at the output."""


@pytest.fixture
def counting(tmp_path, monkeypatch):
    """A folder into which simulations write their counts."""
    folder = tmp_path / "counts"
    folder.mkdir()
    monkeypatch.setenv(FOLDER, str(folder))
    return folder


def reached(folder, items: int, stall: float) -> Counter[Arm]:
    """Simulate a register; return the accumulated counts of all arms."""
    rows = np.arange(items, dtype=np.uint8)[:, None]
    Simulation(Register(8)).run({"i": rows}, expected={"o": items}, stall=stall)
    return arms(folder)


def test_taken_arms(counting, tmp_path, capsys):
    """Without items no stall is counted; with items and stalls every arm is."""
    few = reached(counting, 0, 0.0)
    assert {arm.place.file for arm in few} == {"hdl/lib/stream.py"}
    stall = [arm for arm in few if arm.place.line == LINE and arm.arm.endswith("not taken")]
    assert stall and not any(few[arm] for arm in stall)
    assert command(f"coverage {counting} --json {tmp_path}/few.json") == 0
    assert f"hdl/lib/stream.py:{LINE} " in capsys.readouterr().out
    many = reached(counting, ITEMS, 0.5)
    assert set(many) == set(few) and all(many.values())
    assert command(f"coverage {counting} --json {tmp_path}/many.json") == 0
    before, after = (load(tmp_path / f"{name}.json") for name in ("few", "many"))
    check_documented("## `splatcore coverage`", [*after, *after["files"][0]])
    assert before["missed"] and not after["missed"]
    assert before["files"][-1]["file"] == "all"
    assert before["files"][-1]["branches"] == after["files"][-1]["branches_taken"] == len(many)
