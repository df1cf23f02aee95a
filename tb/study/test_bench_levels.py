"""`splatcore bench levels`: rows, the decimated scene, the path, files and refusals."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import LEVELS, psnr
from splatcore.sim.frame.picture import read_png
from splatcore.spec.config import DEFAULT
from splatcore.study.bench.levels import decimated, median_depth, moved_back
from tb.helpers.command import check_refused, load, run

pytestmark = pytest.mark.slow

BACK = 8.0  # median depths
WORDS = "--size 160x90 --quality compact"


def test_rows_and_files(tmp_path, monkeypatch):
    """Rows are those of frames rendered here; the nearest view needs more than the farthest."""
    monkeypatch.chdir(tmp_path)
    assert run(f"bench levels garden -o out {WORDS} --away 0,{BACK:g} --pixels 1 --frames 3") == 0
    found = load(Path("out/levels.json"))
    rows = {(row["away"], row["lod_pixels"]): row for row in found["rows"]}
    assert list(rows) == [(0, 0), (0, 1), (BACK, 0), (BACK, 1)]
    for away in (0, BACK):
        finest, coarse = rows[away, 0], rows[away, 1]
        assert finest["share"] == finest["cycles_share"] == 1
        assert finest["psnr_db_finest"] is finest["psnr_db_decimated"] is None
        assert coarse["psnr_db_decimated"] < coarse["psnr_db_scene"] < finest["psnr_db_scene"]
    assert rows[BACK, 1]["share"] < 0.55 < rows[0, 1]["share"] < 1
    assert rows[BACK, 1]["cycles_share"] < rows[0, 1]["cycles_share"] < 1

    scene = generate("garden")
    near = generated_camera("garden", 160, 90)
    camera = moved_back(near, BACK * median_depth(scene, near))
    plain, _ = pack(scene, DEFAULT, quality="compact")
    model, clipped = with_levels(plain, DEFAULT)
    frame = render(DEFAULT, model, replace(camera, lod_pixels=1.0))
    truth = render_reference(scene, camera).pixels
    row = rows[BACK, 1]
    assert row["gaussians"] == frame.counts["points_read"]
    assert row["psnr_db_scene"] == psnr(frame.pixels / LEVELS, truth / LEVELS)
    assert (found["gaussians"], found["with_levels"]) == (len(scene), model.count)
    assert found["clipped"] == clipped and 1 < found["bytes_ratio"] < 2.2

    assert [each["lod_pixels"] for each in found["popping"]] == [0, 1]
    assert found["popping"][0]["ratio"] == 1
    middle = moved_back(near, BACK / 2 * median_depth(scene, near))
    shown = [render(DEFAULT, model, each).pixels.astype(int) for each in (near, middle, camera)]
    most = max(np.abs(one - other).max() for one, other in pairwise(shown))
    assert found["popping"][0]["change_max"] == most / LEVELS
    for picture in ("levels.png", "pictures.png"):
        assert read_png(Path("out") / picture).std() > 5
    assert (tmp_path / "out/levels.csv").read_text().count("\n") == 1 + len(rows)


def test_decimated():
    """As many Gaussians as asked for, all from the scene, of the same area in all."""
    scene = generate("garden", 1000)
    fewer = decimated(scene, 0.25)
    assert len(fewer) == 250
    rows = [np.flatnonzero((scene.position == each).all(1))[0] for each in fewer.position]
    assert len(set(rows)) == 250
    np.testing.assert_allclose(fewer.scale, 2 * scene.scale[rows], rtol=1e-6)


def test_refusals(capsys, tmp_path):
    for words, why in {
        "--preset PAPER": "PAPER renders no levels",
        "--away 1,-1": "--away '1,-1'",
        "--pixels x": "--pixels",
    }.items():
        check_refused(capsys, f"bench levels garden -o {tmp_path / 'out'} {WORDS} {words}", why)
    model = tmp_path / "garden.splatcore"
    assert run(f"pack garden -o {model} --quality compact --size 160x90") == 0
    check_refused(capsys, f"bench levels {model} -o {tmp_path / 'out'}", "is packed")
    assert not (tmp_path / "out").exists()
