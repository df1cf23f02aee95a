"""`splatcore simulate` and `bench scenes` on TINY, against the golden model."""

import json
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.picture import read_png
from splatcore.sim.machine.diagnosis import diagnose, tile_splats
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.path import STEP, orbit
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.camera import look_at
from splatcore.spec.config import TINY
from splatcore.study.bench import scenes as bench_scenes
from tb.helpers.command import KEYS, check_documented, load, run

TINY_VIEW = ("--preset", "tiny", "--size", "64x48")

MORE_KEYS = ["timing", "halves", "frames"]


@pytest.fixture(scope="module")
def golden():
    """A job of the scene `needles`, and its frame by the golden model."""
    model, _ = pack(generate("needles"), TINY)
    job = Job(model, generated_camera("needles").resized(64, 48))
    return job, render(TINY, *job)


@pytest.fixture(scope="module")
def rendered(golden) -> Run:
    return Machine(TINY).run([golden[0]] * 3, LPDDR4)


def changed(frame, **arrays):
    """Return a golden frame with some arrays of binning replaced."""
    return replace(frame, binned=replace(frame.binned, **arrays))


@pytest.mark.slow
def test_render(tmp_path, capsys):
    """Three frames in RTL: pictures, cycles and JSON, each frame against the golden model."""
    picture, map_, file = (tmp_path / name for name in ("a.png", "e.png", "a.json"))
    options = "--frames", "3", "--timing", "ideal", "--error-map", map_, "--json", file
    assert run("simulate", "needles", *TINY_VIEW, *options, "-o", picture) == 0
    result = load(file)
    assert list(result) == KEYS + MORE_KEYS and result["timing"] == "ideal"
    assert result["identical"] and result["psnr_db_machine"] > 45 and len(result["frames"]) == 3
    drawn = [frame["finished"] - frame["ready"] for frame in result["frames"]]  # of the slower half
    assert drawn[0] == max(result["halves"].values())
    # The last frame is left out: no next frame is preprocessed during it.
    assert result["cycles"] == pytest.approx(np.mean(drawn[:-1]), rel=0.03)
    assert result["traffic_bytes"]["write_pixels"] >= 64 * 48 * 3
    pictures = [read_png(tmp_path / f"a-00{k}.png") for k in range(3)]
    assert (pictures[0] != pictures[1]).any() and (pictures[1] != pictures[2]).any()
    assert run("render", "needles", "--engine", "golden", *TINY_VIEW, "-o", picture) == 0
    np.testing.assert_array_equal(read_png(picture), pictures[0])
    assert read_png(map_).std() > 0
    assert capsys.readouterr().out.count("identical to the golden model") == 3
    check_documented("### `splatcore simulate`", (*MORE_KEYS, *result["frames"][0]))


@pytest.mark.verify
def test_saves(tmp_path, capsys):
    """A run whose last save is in mid-frame, as after an interruption, goes on from there."""
    picture, saves = tmp_path / "a.png", tmp_path / "a.saves"
    words = "simulate", "needles", *TINY_VIEW, "-o", picture
    assert run(*words, "--save-every", 2000) == 0
    whole, saved = read_png(picture), sorted(int(path.stem) for path in saves.iterdir())
    assert saved == list(range(2000, saved[-1] + 1, 2000)) and len(saved) > 3
    picture.unlink()
    for cycle in saved[2:]:
        (saves / f"{cycle}.save").unlink()
    assert run(*words, "--from", 9999) == 0
    np.testing.assert_array_equal(read_png(picture), whole)
    printed = capsys.readouterr()
    assert "a.saves/4000.save: the run goes on" in printed.err.replace("\n", "")
    assert printed.out.count("identical to the golden model") == 2
    assert run(*words, "--from", 1999) == 2
    assert "has no save at or before cycle 1,999" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.slow
def test_compare(capsys):
    assert run("compare", "golden", "rtl", "--scene", "needles", *TINY_VIEW) == 0
    assert "identical" in capsys.readouterr().out


@pytest.mark.slow
def test_the_stage_that_differs(rendered, golden):
    """Faults planted in the golden frame look like the machine's: each is found in its stage."""
    _, frame = golden
    assert all(diagnose(TINY, rendered, k, frame) is None for k in range(3))
    pixels = frame.raster.pixels.copy()
    pixels[20, 33, 1] ^= 4
    pixels[40, 3] ^= 1
    wrong = replace(frame, raster=frame.raster._replace(pixels=pixels))
    found = diagnose(TINY, rendered, 2, wrong)
    assert found.pixel == (33, 20) and found.tile == (2, 1) and found.pixels == 2
    assert found.stage.startswith("sorting or rasterizing")
    assert str(tuple(map(int, pixels[20, 33]))) in str(found)
    assert "overwritten" in diagnose(TINY, rendered, 0, wrong).stage

    features = dict(frame.binned.features)
    features["shear"] = features["shear"].copy()
    features["shear"][7] ^= 1
    found = diagnose(TINY, rendered, 1, changed(wrong, features=features))
    assert found.stage.startswith("preprocessing: splat 7 has shear")
    lists = frame.binned.lists
    counts = lists.count.copy()
    counts[1] += 1
    found = diagnose(TINY, rendered, 1, changed(wrong, lists=replace(lists, count=counts)))
    assert found.stage.startswith("binning: group 1 has count")
    slots = lists.slots.copy()
    slots[5, 2] ^= 1
    found = diagnose(TINY, rendered, 2, changed(wrong, lists=replace(lists, slots=slots)))
    assert found.stage.startswith(f"binning: slot 2 of burst {lists.address[5]}")


def test_splats_of_a_tile(golden):
    """Only splats of that tile, sorted by depth; all tiles together have every splat."""
    _, frame = golden
    found = tile_splats(TINY, frame, (1, 2))
    depth = frame.binned.entries["key"][[
        np.flatnonzero(frame.binned.entries["splat"] == splat)[0] for splat in found
    ]]  # fmt: skip
    assert len(found) and (np.diff(depth.astype(int)) >= 0).all()
    everywhere = {
        splat for y in range(3) for x in range(4) for splat in tile_splats(TINY, frame, (x, y))
    }
    assert everywhere == set(range(len(frame.binned.kept)))


def test_orbit():
    """The camera's target stays at the picture's centre, at the same distance."""
    camera = look_at(np.array([1.0, -2, -5]), np.zeros(3), 64, 48, 60.0)
    points = np.random.default_rng(0).normal(0, 0.1, (501, 3))
    path = orbit(camera, points, 4)
    assert path[0] is camera
    distance = np.median((points @ camera.rotation.T + camera.translation)[:, 2])
    target = camera.position + distance * camera.rotation[2]
    for k, view in enumerate(path):
        np.testing.assert_allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-12)
        seen = view.rotation @ target + view.translation
        np.testing.assert_allclose(seen, [0, 0, distance], atol=1e-9)
        turned = np.arccos(np.clip(view.rotation[2] @ camera.rotation[2], -1, 1))
        assert turned == pytest.approx(k * STEP, abs=1e-6)


@pytest.mark.slow
def test_bench_scenes(golden, tmp_path, monkeypatch, capsys):
    """Kept results are reused until the machine changes."""
    arguments = ("bench", "scenes", "--out", tmp_path, "needles", *TINY_VIEW)
    assert run(*arguments) == 0
    files = sorted(tmp_path.glob("*.json"))
    assert [file.name for file in files] == [
        "needles-64x48-ideal.json", "needles-64x48-lpddr4.json",
    ]  # fmt: skip
    ideal, slow = map(load, files)
    assert ideal["identical"] and ideal["psnr_db_machine"] > 45
    assert ideal["psnr_db_scene"] < ideal["psnr_db_machine"] and ideal["ssim_scene"] is not None
    assert ideal["cycles"]["frame"] < slow["cycles"]["frame"]
    assert ideal["model_cycles"]["raster"] == frame_cycles(TINY, golden[1]).raster
    table = (tmp_path / "scenes.md").read_text()
    assert table.count("| needles ") == 6 and table in capsys.readouterr().out
    assert len((tmp_path / "scenes.csv").read_text().splitlines()) == 3

    def refuse(*_):
        raise AssertionError("simulated again")

    monkeypatch.setattr(bench_scenes, "measure", refuse)
    assert run(*arguments) == 0
    slow["key"] = "another machine"
    files[1].write_text(json.dumps(slow))
    with pytest.raises(AssertionError, match="simulated again"):
        run(*arguments)
