"""Notes on odd Gaussians of any format: too bright, transparent, not finite."""

import numpy as np
import pytest

from splatcore.spec.scene import Scene
from tb.helpers.harmonics import harmonics
from tb.helpers.scene_file import ply_bytes, ply_columns, read_written
from tb.helpers.scenes import random_scene

C0 = np.sqrt(1 / (4 * np.pi))


def notes_of(tmp_path, scene: Scene) -> tuple[str, ...]:
    data = ply_bytes({"vertex": ply_columns(scene)})
    return read_written(tmp_path / "scene.ply", data).notes


@pytest.mark.parametrize("degree", range(4))
def test_colours_that_saturate(tmp_path, degree):
    """Colours of 8 or more in any channel, from the constant term alone or along one direction."""
    scene = random_scene(20, degree)
    scene.sh[3, 0, 1] = 7.51 / C0
    scene.sh[4, 0, 2] = 30
    scene.sh[5, 0, 0] = 7.4 / C0  # its own colour is 7.9
    scene.sh[6, 0] = -30
    scene.sh[3:7, 1:] = 0
    count = 2
    if degree:
        scene.sh[7] = 0
        scene.sh[7, 0, 0] = 7 / C0
        scene.sh[7, degree * degree, 0] = 2  # 0.5 + 7 + 2 · at least 0.48
        count = 3
    note = f"{count} Gaussians with colours from 8 on, which saturate in the machine"
    assert notes_of(tmp_path, scene) == (note,)
    scene.sh[3:8] /= 10
    assert notes_of(tmp_path, scene) == ()


def test_bright_sides_by_brute_force(tmp_path):
    """The count in the note, against the brightest of 2,000 random directions."""
    scene = random_scene(3000, 3)
    scene.sh[...] *= np.random.default_rng(1).uniform(0, 8, (3000, 1, 1))
    direction = np.random.default_rng(2).normal(size=(2000, 3))
    colour = 0.5 + np.einsum("dk,nkc->ndc", harmonics(direction, 3), scene.sh.astype(np.float32))
    brightest = colour.max(axis=(1, 2))
    (note,) = notes_of(tmp_path, scene)
    found = int(note.split()[0])
    # One of 2,000 directions is almost surely within 8° of the brightest one.
    assert (brightest > 8.4).sum() <= found <= (brightest > 7.9).sum()
    assert (brightest > 8).sum() > 300


def test_transparent_gaussians(tmp_path):
    scene = random_scene(20, 0)
    scene.opacity[[2, 7]], scene.opacity[3] = 1 / 260, 1 / 254
    assert notes_of(tmp_path, scene) == ("2 transparent Gaussians (opacity below 1/255)",)
    columns = ply_columns(scene)
    columns["opacity"][2] = np.nan
    scene = read_written(tmp_path / "scene.ply", ply_bytes({"vertex": columns}))
    faint = "1 transparent Gaussian (opacity below 1/255)"
    assert scene.notes == ("1 Gaussian with NaN or Inf", faint)
