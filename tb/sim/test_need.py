"""Memory that work needs and that is available: the check before long work, and what it reads."""

import os
from pathlib import Path

import numpy as np
import pytest

from splatcore.model.export.writers import find_writer
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate
from splatcore.sim.common.pool import processes
from splatcore.spec import need
from splatcore.spec.error import InputError
from splatcore.spec.need import NEEDS, anonymous, available, check_need

MEGA = 1_000_000

LINE = (
    "^a.splatcore: rendering 2,000,000 Gaussians of SH degree 1 by the golden model needs "
    r"\d.\d GB of memory, but \d.\d GB are available; fewer"
)


@pytest.fixture
def little(monkeypatch):
    """A function that sets the available memory."""
    return lambda room: monkeypatch.setattr(need, "available", lambda: room)


def test_work_that_does_not_fit_is_refused(little):
    wanted = NEEDS["golden"].bytes(2 * MEGA, 1)
    little(wanted)
    check_need("golden", 2 * MEGA, 1, "a.splatcore")
    little(wanted - 1)
    with pytest.raises(InputError, match=LINE):
        check_need("golden", 2 * MEGA, 1, "a.splatcore")


def test_an_open_scene_is_part_of_the_need(little, monkeypatch):
    """Memory that the process has counts as available, up to what an opened scene takes."""
    opened = int(NEEDS["reading"].bytes(MEGA, 3))
    wanted = NEEDS["packing"].bytes(MEGA, 3)
    monkeypatch.setattr(need, "anonymous", lambda: 10**15)  # more than a scene takes
    little(wanted - opened + 1)
    check_need("packing", MEGA, 3, "a.ply")
    little(wanted - opened - 1)
    with pytest.raises(InputError, match="packing"):
        check_need("packing", MEGA, 3, "a.ply")


def test_a_system_that_does_not_say_refuses_nothing(little):
    little(None)
    check_need("packing", 10**12, 3, "a.ply")


@pytest.mark.parametrize("suffix", [".ply", ".spz", ".sog"])
def test_readers_name_what_they_read(tmp_path, little, suffix):
    """The count, and for a PLY or SPZ file the degree, before the arrays are made."""
    path = tmp_path / f"a{suffix}"
    find_writer(path).write(path, generate("garden", 100))
    little(0)
    degree = 0 if suffix == ".sog" else 1
    with pytest.raises(InputError, match=f"reading 100 Gaussians of SH degree {degree} needs"):
        read_scene(path)


def group(folder: Path, **files: object):
    """Write the files of a control group."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / f"memory.{name}").write_text(f"{text}\n")


@pytest.fixture
def system(tmp_path, monkeypatch):
    """A made-up /proc with 1000 kB of free memory and 24 kB of swap, and no control groups."""
    monkeypatch.setattr(need, "PROC", tmp_path / "proc")
    monkeypatch.setattr(need, "GROUPS", tmp_path / "groups")
    (tmp_path / "proc" / "self").mkdir(parents=True)
    text = "MemTotal: 9000 kB\nMemAvailable:    1000 kB\nSwapFree: 24 kB\nHugePages_Free: 0\n"
    (tmp_path / "proc" / "meminfo").write_text(text)
    return tmp_path


def test_available_memory(system):
    assert available() == 1024 * 1024
    (system / "proc" / "meminfo").unlink()
    assert available() is None


def test_a_control_group_or_one_above_it_limits(system):
    (system / "proc" / "self" / "cgroup").write_text("0::/user/app\n")
    group(system / "groups")
    group(system / "groups/user", max="max", current=5, stat="inactive_file 3")
    group(system / "groups/user/app", max=10**9, current=5, stat="inactive_file 3")
    assert available() == 1024 * 1024
    group(system / "groups/user", max=70_000, current=50_000, stat="anon 1\ninactive_file 3000")
    assert available() == 23_000
    group(system / "groups/user", current=90_000)
    assert available() == 0


def test_control_groups_of_version_1(system):
    (system / "proc" / "self" / "cgroup").write_text("4:cpu,memory:/a\n3:pids:/b\n")
    place = system / "groups" / "memory" / "a"
    group(place, limit_in_bytes=70_000, usage_in_bytes=60_000, stat="total_inactive_file 5")
    assert available() == 10_005


def grown() -> tuple[int, int]:
    """Anonymous memory of this process before it makes an array of ones, and with it."""
    before, held = anonymous(), np.ones(4 * MEGA)
    return before, anonymous() * int(held[0])


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc")
def test_anonymous_memory_of_a_process_and_its_children():
    """It grows with an array of ones, and with a child process."""
    with processes(1) as pool:
        child = pool.submit(os.getpid).result()
        before, held = pool.submit(grown).result()
        assert held - before > 0.9 * np.ones(4 * MEGA).nbytes
        alone = anonymous(child)
        assert alone > MEGA and anonymous() > alone
    assert anonymous(child) is None
