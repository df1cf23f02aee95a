"""`splatcore bench compression --part power`: the machine's power after each step."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.eda.power.estimate import estimate, gates_of
from splatcore.model.formats.read import read_scene
from splatcore.model.pack.pack import pack
from splatcore.spec.config import DEFAULT
from splatcore.study.compression import power
from tb.helpers.command import check_documented
from tb.helpers.compression_stand_in import bench, held_out, installed, scenes
from tb.helpers.power import COUNTS, GATES, SIZES

pytestmark = pytest.mark.compress

pytest.importorskip("flip_evaluator")


@pytest.fixture
def fake(tmp_path, monkeypatch):
    return installed(tmp_path, monkeypatch)


def gates(config, library, process, advance):
    """Replaces synthesis: gates of a fixed machine."""
    return GATES if library else gates_of(SIZES, config.energy)


def test_power(fake, tmp_path, monkeypatch, liberty_path, capsys):
    """Each step's power equals the estimate for the model of that step, by gates and in cells."""
    seen = []

    def counts(config, job, sample, label):
        seen.append((job.model, job.camera))
        return replace(COUNTS, cycles=1000 * len(job.model))

    monkeypatch.setattr(power, "counts_of", counts)
    monkeypatch.setattr(power, "machine_gates", gates)
    asked = "a.ply", "--part", "power", "--steps", "5"
    assert bench(*asked, "--liberty", str(liberty_path), "--process", "130") == 0
    found, energy = scenes()["a.ply"]["power"], DEFAULT.energy
    assert found["size"] == [96, 64] and (found["view"], found["library"]) == ("left", "small")
    assert [row["step"] for row in found["rows"]][::6] == ["original", "quantize"]
    for row, (model, camera) in zip(found["rows"], seen, strict=True):
        counted = replace(COUNTS, cycles=1000 * row["gaussians"])
        plain = estimate(counted, gates_of(SIZES, energy), energy)
        fps = min(129, plain.fps_max)
        assert repr(camera) == repr(held_out()[0]) and row["fps"] == fps
        assert row["power_w"] == plain.power(fps) == pytest.approx(row["frame_j"] * fps)
        assert row["cells_w"] == estimate(counted, GATES, energy).power(fps) != row["power_w"]
        assert row["traffic_bytes"] == sum(COUNTS.traffic.values())
        assert (row["gaussians"], row["bytes"]) == (len(model), len(model.image))
    first, second, *_, last = seen
    exact = pack(read_scene("a.ply"), DEFAULT, quality="balanced")[0]
    assert np.array_equal(first[0].image, exact.image) and first[0].format.sh_degree == 3
    assert second[0].format.sh_degree == last[0].format.sh_degree == 1
    assert "power in cells, mW" in " ".join(capsys.readouterr().out.split())
    assert bench("a.ply", "--liberty", str(liberty_path), "--process", "130") == 2
    assert "small.lib: goes with --part power only" in capsys.readouterr().err
    assert bench(*asked) == 0
    assert "library" not in scenes()["a.ply"]["power"]
    assert (tmp_path / "out" / "power.csv").exists()
    check_documented("## `splatcore bench compression`", {*found, *found["rows"][0]})
