"""Metrics against their definitions, and pictures that can be opened."""

import numpy as np
import pytest
from PIL import Image

from sim.metric import difference
from sim.picture import read_png, write_error_map, write_heat_map, write_png
from spec.error import InputError


def noise(seed: int, height: int = 40, width: int = 50) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_psnr_and_maximum_by_hand():
    a = np.zeros((20, 30, 3), np.uint8)
    b = a.copy()
    b[3, 4, 1] = 51  # one channel of one pixel is off by 0.2
    metrics = difference(b, a)
    assert metrics.max_error == pytest.approx(0.2)
    assert metrics.psnr_db == pytest.approx(10 * np.log10(20 * 30 * 3 / 0.04))
    assert not metrics.identical
    assert metrics == difference(a, b)


def test_identical():
    metrics = difference(noise(0), noise(0))
    assert metrics.identical and metrics.psnr_db is None
    assert metrics.ssim == pytest.approx(1) and metrics.max_error == 0


def plain_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Wang et al. 2004, equation 13, one channel in 0 … 255, window positions inside the image."""
    k = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    window = np.outer(k, k) / k.sum() ** 2
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    values = []
    for y in range(a.shape[0] - 10):
        for x in range(a.shape[1] - 10):
            p, q = a[y : y + 11, x : x + 11], b[y : y + 11, x : x + 11]
            mp, mq = (window * p).sum(), (window * q).sum()
            vp, vq = (window * p * p).sum() - mp**2, (window * q * q).sum() - mq**2
            cov = (window * p * q).sum() - mp * mq
            values.append(
                (2 * mp * mq + c1) * (2 * cov + c2) / ((mp**2 + mq**2 + c1) * (vp + vq + c2))
            )
    return float(np.mean(values))


def test_ssim_by_definition():
    a = noise(1, 18, 21)
    b = np.clip(a.astype(int) + noise(2, 18, 21) // 8, 0, 255).astype(np.uint8)
    expected = np.mean([plain_ssim(a[..., c] * 1.0, b[..., c] * 1.0) for c in range(3)])
    assert difference(a, b).ssim == pytest.approx(expected, abs=1e-6)


def test_small_images_have_no_ssim():
    assert difference(noise(0, 1, 1), noise(1, 1, 1)).ssim is None


def test_sizes_must_agree():
    with pytest.raises(InputError, match=r"b.png: size 50x40 differs from the first image's 40x50"):
        difference(noise(0), noise(0, 50, 40), "b.png")


def test_png_round_trip(tmp_path):
    write_png(tmp_path / "a.png", noise(3))
    assert (read_png(tmp_path / "a.png") == noise(3)).all()


@pytest.mark.parametrize("content", [b"", b"text", b"\x89PNG\r\n\x1a\n"])
def test_broken_png(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=r"a.png: "):
        read_png(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"none.png: "):
        read_png(tmp_path / "none.png")


def test_truncated_png(tmp_path):
    write_png(tmp_path / "a.png", noise(3))
    data = (tmp_path / "a.png").read_bytes()
    for length in range(8, len(data) - 12, 97):
        (tmp_path / "b.png").write_bytes(data[:length])
        with pytest.raises(InputError, match=r"b.png: "):
            read_png(tmp_path / "b.png")


def bright_columns(path, is_bright) -> np.ndarray:
    """Columns, as parts of the width, of bright pixels in the upper 85 % (no colour bar there)."""
    with Image.open(path) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    picture = picture[: int(0.85 * len(picture))]
    return np.flatnonzero(is_bright(picture).any(axis=0)) / picture.shape[1]


def inferno(picture: np.ndarray) -> np.ndarray:
    """Pixels in the upper third of the error map's colours; neither white nor black."""
    return (picture[..., 0] > 240) & (picture[..., 2] < 200)


def viridis(picture: np.ndarray) -> np.ndarray:
    """Pixels in the upper tenth of the heat map's colours."""
    return (picture[..., 0] > 220) & (picture[..., 2] < 100)


def test_maps_show_what_they_map(tmp_path):
    """A wrong spot and a full tile shine where they are, and nothing else does."""
    a = np.zeros((64, 96, 3), np.uint8)
    b = a.copy()
    b[30:36, 80:84, 2] = 200
    tiles = np.zeros((8, 6), int)
    tiles[3, 5] = 1000
    write_error_map(tmp_path / "error.png", b, a, "title")
    write_heat_map(tmp_path / "heat.png", tiles, "title")
    for name, colour in (("error.png", inferno), ("heat.png", viridis)):
        columns = bright_columns(tmp_path / name, colour)
        assert len(columns) and columns.min() > 0.7, name
    write_error_map(tmp_path / "none.png", a, a, "nothing differs")
    write_heat_map(tmp_path / "empty.png", tiles * 0, "no splats")
    assert not len(bright_columns(tmp_path / "none.png", inferno))
    assert not len(bright_columns(tmp_path / "empty.png", viridis))
