"""`--rgba`: PNG files with straight alpha, of the reference and of a machine that has alpha."""

import numpy as np
import pytest
from PIL import Image

from splatcore.golden.pipeline import render
from splatcore.sim.common.preset_file import write_preset
from splatcore.sim.frame.engines import reference
from splatcore.sim.frame.picture import straight, write_png
from splatcore.sim.frame.shot import Shot
from splatcore.spec.config import TINY
from tb.helpers.command import load, run
from tb.helpers.configs import ALPHA


@pytest.fixture
def preset(tmp_path):
    path = tmp_path / "alpha.toml"
    write_preset(path, ALPHA, TINY)
    return path


def premultiplied(path) -> np.ndarray:
    """Read a PNG file with alpha, and multiply its colour by alpha, rounded to nearest."""
    with Image.open(path) as image:
        assert image.mode == "RGBA"
        pixels = np.asarray(image).astype(int)
    colour = np.rint(pixels[..., :3] * pixels[..., 3:] / 255)
    return np.concatenate([colour, pixels[..., 3:]], axis=2)


def test_straight_alpha(tmp_path):
    """Every colour and alpha comes back from a file: exactly if the colour is at most alpha."""
    colour, alpha = (values.astype(np.uint8) for values in np.mgrid[:256, :256])
    pixels = np.stack([colour, colour // 2, 0 * colour, alpha], axis=2)
    write_png(tmp_path / "a.png", pixels)
    expected = np.minimum(pixels, alpha[..., None])
    assert np.array_equal(premultiplied(tmp_path / "a.png"), expected)
    found = straight(pixels)
    assert found[100, 200, 0] == 128 and found[200, 100, 0] == 255 and not found[:, 0].any()


@pytest.mark.parametrize("engine", ["golden", "reference"])
def test_render(engine, preset, tmp_path):
    """The file has the engine's pixels; the comparison includes alpha."""
    picture, file = tmp_path / "a.png", tmp_path / "a.json"
    words = "--engine", engine, "--preset", preset, "--size", "64x48", "--rgba", "--json", file
    assert run("render", "needles", *words, "-o", picture) == 0
    shot = Shot.open("needles", None, "64x48", config=ALPHA, rgba=True)
    pixels = render(ALPHA, *shot.job).pixels if engine == "golden" else reference(shot).pixels
    assert np.array_equal(premultiplied(picture), np.minimum(pixels, pixels[..., 3:]))
    assert engine == "reference" or load(file)["psnr_db_machine"] > 45
    assert np.ptp(pixels[..., 3]) > 100


@pytest.mark.verify
def test_simulate(preset, tmp_path):
    picture, file = tmp_path / "a.png", tmp_path / "a.json"
    words = "--preset", preset, "--size", "64x48", "--rgba", "--timing", "ideal", "--json", file
    assert run("simulate", "needles", *words, "-o", picture) == 0
    assert load(file)["identical"] and premultiplied(picture).shape == (48, 64, 4)
