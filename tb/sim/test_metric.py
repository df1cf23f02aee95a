"""Metrics against their definitions; PNG files; error and heat maps."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from splatcore.sim.frame import metric
from splatcore.sim.frame.metric import difference, flip, flip_map, lpips
from splatcore.sim.frame.picture import read_png, write_error_map, write_heat_map, write_png
from splatcore.spec.error import InputError


def noise(seed: int, height: int = 40, width: int = 50) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_psnr_and_maximum():
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
    """SSIM by Wang et al. 2004, equation 13: one channel in 0 … 255, windows inside the image."""
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


@pytest.mark.compress
def test_flip():
    """FLIP equals the package's mean, is 0 for equal images and grows with the difference."""
    package = pytest.importorskip("flip_evaluator")
    a = noise(1)
    near, far = (np.clip(a.astype(int) + d, 0, 255).astype(np.uint8) for d in (4, 40))
    assert flip(a, a) == 0 < flip(near, a) < flip(far, a) < 1
    expected = package.evaluate(a / np.float32(255), far / np.float32(255), "LDR")[1]
    assert flip(far, a) == pytest.approx(expected, abs=1e-5)
    spot = a.copy()
    spot[30:34, 40:44] = 255 - spot[30:34, 40:44]
    found = flip_map(spot, a)
    assert found.shape == (40, 50) and found.max() <= 1
    assert found[30:34, 40:44].mean() > 5 * found[:20, :20].mean()
    with pytest.raises(InputError, match=r"b.png: size 50x40 differs"):
        flip(noise(0), noise(0, 50, 40), "b.png")


def test_without_flip(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(InputError, match=r"FLIP: needs flip-evaluator: pip install"):
        flip(noise(0), noise(1))


@pytest.mark.parametrize("weights", [True, False])
def test_lpips_only_with_weights_on_disk(tmp_path, monkeypatch, weights):
    """Without weights on disk the network is never created, because it would download them."""
    torch, torchvision, models, package = (
        ModuleType(name) for name in ("torch", "torchvision", "torchvision.models", "lpips")
    )
    made = []
    torch.hub = SimpleNamespace(get_dir=lambda: str(tmp_path))
    url = "https://example.org/models/alexnet-1.pth"
    models.AlexNet_Weights = SimpleNamespace(IMAGENET1K_V1=SimpleNamespace(url=url))
    package.LPIPS = lambda **options: made.append(options) or "network"
    for module in (torch, torchvision, models, package):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(metric, "find_spec", lambda name: name in sys.modules)
    monkeypatch.setattr(metric, "_lpips_network", metric._lpips_network.__wrapped__)
    if weights:
        (tmp_path / "checkpoints").mkdir()
        (tmp_path / "checkpoints" / "alexnet-1.pth").write_bytes(b"weights")
    assert metric._lpips_network() == ("network" if weights else None)
    assert len(made) == weights
    if not weights:
        assert lpips(noise(0), noise(1)) is None


def test_without_lpips(monkeypatch):
    monkeypatch.setattr(metric, "find_spec", lambda name: None)
    monkeypatch.setattr(metric, "_lpips_network", metric._lpips_network.__wrapped__)
    assert lpips(noise(0), noise(1)) is None


def bright_columns(path, is_bright) -> np.ndarray:
    """Columns, as fractions of the width, of bright pixels in the upper 85 % (no colour bar)."""
    picture = read_png(path).astype(int)
    picture = picture[: int(0.85 * len(picture))]
    return np.flatnonzero(is_bright(picture).any(axis=0)) / picture.shape[1]


def inferno(picture: np.ndarray) -> np.ndarray:
    """Mask of pixels in the upper third of the error map's colours; neither white nor black."""
    return (picture[..., 0] > 240) & (picture[..., 2] < 200)


def viridis(picture: np.ndarray) -> np.ndarray:
    """Mask of pixels in the upper tenth of the heat map's colours."""
    return (picture[..., 0] > 220) & (picture[..., 2] < 100)


def test_maps_show_errors_and_counts(tmp_path):
    """A wrong spot and a full tile are bright at their place, and nothing else is."""
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
