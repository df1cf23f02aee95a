"""Work counts of real full-HD frames against the table that the design was based on."""

from dataclasses import replace

import pytest

from splatcore.golden.reference import render
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from tb.helpers.scenes import needs_scenes, scene_path

WITHIN = 0.01

COLUMNS = (
    "gaussians", "visible", "pairs_3sigma", "pairs", "pairs_after_termination", "blocks",
    "contributions", "tile_list_mean", "tile_list_p99", "tile_list_max", "tile_rows",
)  # fmt: skip

TABLE = {
    "flowers.spz": "542104 405k 4.22M 1.71M 1.50M 7.9M 80M 210 847 1220 0.90M",
    "playbot.spz": "500k 432k 4.30M 1.77M 1.69M 8.1M 79M 216 1025 1521 0.82M",
    "skull.sog": "95k 89k 7.57M 1.53M 1.14M 9.7M 126M 187 860 1294 0.43M",
    "luma-seal.splat": "102k 96k 3.69M 0.97M 0.71M 5.5M 68M 119 849 1172 0.25M",
    "kitchen.spz": "214k 118k 3.56M 1.46M 1.08M 9.9M 132M 179 407 458 0.41M",
}
"""Counts for camera 0 of each scene, opacities as stored, rounded to the digits shown."""

CULLED = {"flowers.spz": 0.02, "playbot.spz": 0, "skull.sog": 0, "luma-seal.splat": 0,
          "kitchen.spz": 0.01}  # fmt: skip
"""Fraction of Gaussians culled by the near plane, rounded to a percent."""


def printed(text: str) -> tuple[float, float]:
    """Return the value of a printed figure, and half a unit of its last digit."""
    unit = {"k": 1e3, "M": 1e6}.get(text[-1], 1)
    digits = text.rstrip("kM")
    return float(digits) * unit, unit * 0.5 / 10 ** len(digits.partition(".")[2])


@pytest.mark.slow
@needs_scenes
@pytest.mark.parametrize("file", TABLE)
def test_counts(file):
    scene = replace(read_scene(scene_path(file)).with_sh_degree(1), antialiased=False)
    view = read_camera(f"{scene_path(file.split('.')[0] + '.cameras.json')}:0")
    assert (view.width, view.height) == (1920, 1080)
    counts = render(scene.gaussians(), view).counts
    assert round(counts["near_culled"] / counts["gaussians"], 2) == CULLED[file]
    for column, expected in zip(COLUMNS, TABLE[file].split(), strict=True):
        value, rounding = printed(expected)
        bound = WITHIN * value + rounding
        assert abs(counts[column] - value) <= bound, (column, counts[column], expected)
