"""Coverage: what a simulation reached of a part, by lines of hdl/, and what it did not."""

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
"""Of the condition that an item behind another one has to wait for."""


@pytest.fixture
def counting(tmp_path, monkeypatch):
    """A folder in which simulations count."""
    folder = tmp_path / "counts"
    folder.mkdir()
    monkeypatch.setenv(FOLDER, str(folder))
    return folder


def reached(folder, items: int, stall: float) -> Counter[Arm]:
    """What a register's simulation takes, beyond what was counted before."""
    rows = np.arange(items, dtype=np.uint8)[:, None]
    Simulation(Register(8)).run({"i": rows}, expected={"o": items}, stall=stall)
    return arms(folder)


def test_arms_are_those_that_were_taken(counting, tmp_path, capsys):
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
