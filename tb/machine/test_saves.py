"""Saved runs: one that goes on from a save ends as one without, bit for bit; others are refused."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.sim.machine.execute import Saves
from splatcore.sim.machine.machine import Machine, Run
from splatcore.sim.machine.script import LPDDR4
from splatcore.sim.machine.waves import Recording, Window, write_waves
from splatcore.sim.rtl.convert import converted
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from tb.helpers.copier import FAULT, Copier, jobs

pytestmark = pytest.mark.slow

TIMING = replace(LPDDR4, bandwidth=8.0, stall=0.3, seed=5)


@pytest.fixture(scope="module")
def machine() -> Machine:
    return Machine(TINY, converted(Copier()), "vcd", saves=True)


def run(machine: Machine, saves: Saves | None, seed: int = TIMING.seed) -> Run:
    return machine.run(
        jobs(3), replace(TIMING, seed=seed), sizes={"features": FAULT}, saves=saves,
        settings=lambda areas: {"window": "1000000 1000000"},
    )  # fmt: skip


def test_a_resumed_run_equals_a_whole_one(machine, tmp_path):
    """From each of many saves: report, pictures, counters and all bytes of memory."""
    whole = run(machine, Saves(tmp_path, every=97))
    assert whole.done, whole.why
    saved = sorted(int(path.stem) for path in tmp_path.iterdir())
    assert saved == list(range(97, whole.report.cycles, 97)) and len(saved) > 10
    for until in saved[::3]:
        resumed = run(machine, Saves(tmp_path, until=until + 5))
        assert resumed.report == whole.report
        np.testing.assert_array_equal(resumed.memory, whole.memory)
        for one, other in zip(resumed.frames, whole.frames, strict=True):
            np.testing.assert_array_equal(one.pixels, other.pixels)
            assert one.counters == other.counters


def test_a_window_after_a_save(machine, tmp_path):
    """The same waveforms as without a save."""
    files = [tmp_path / "a.vcd", tmp_path / "b.vcd"]
    for file, saves in zip(files, [Saves(tmp_path, 400), Saves(tmp_path, until=900)], strict=True):
        recording, sizes = Recording(file, Window((900, 950))), {"features": FAULT}
        write_waves(machine, jobs(2), TIMING, recording, "", sizes=sizes, saves=saves)
    assert files[0].read_text() == files[1].read_text()


def test_refused(machine, tmp_path):
    run(machine, Saves(tmp_path, every=500))
    with pytest.raises(InputError, match=r"00.save: is of another machine, scene or view; delete"):
        run(machine, Saves(tmp_path), seed=6)
    for path in tmp_path.iterdir():
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    with pytest.raises(InputError, match=r"00.save: is damaged; delete it"):
        run(machine, Saves(tmp_path))
    with pytest.raises(InputError, match="has no save at or before cycle 499"):
        run(machine, Saves(tmp_path, until=499, needed=True))
