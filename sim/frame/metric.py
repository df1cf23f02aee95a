"""Differences between two 8-bit images: PSNR, SSIM, maximum error, FLIP and LPIPS."""

from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from splatcore.sim.common.table import shown
from splatcore.spec.error import InputError
from splatcore.spec.metric import psnr_of_square

LEVELS = 255  # largest value of an 8-bit channel; errors are fractions of it
SSIM_WINDOW = 11  # pixels along the side of the Gaussian window (σ = 1.5) of Wang et al. 2004.


@dataclass(frozen=True)
class Difference:
    """Metrics of one image against another."""

    psnr_db: float | None  # None for identical images
    ssim: float | None  # None for images with a side below SSIM_WINDOW
    max_error: float  # of one channel of one pixel, 0 … 1

    @property
    def identical(self) -> bool:
        return self.max_error == 0


@dataclass
class Picture:
    """An image as `--json` writes it (docs/json.md); None: not known to a command."""

    engine: str
    preset: str
    scene: str | None = None
    camera: str | None = None
    size: tuple[int, int] | None = None  # width, height
    antialiased: bool | None = field(default=None, kw_only=True)
    antialiased_by: str | None = field(default=None, kw_only=True)
    near: float | None = field(default=None, kw_only=True)
    notes: list[str] | None = field(default=None, kw_only=True)


@dataclass
class Compared(Picture):
    """An image with its metrics against the image named `against`.

    A machine's picture that is compared with the reference also has the metrics of the function
    `against`.
    """

    against: str | None = None
    psnr_db: float | None = None
    ssim: float | None = None
    max_error: float | None = None
    identical: bool | None = None
    psnr_db_machine: float | None = None
    psnr_db_scene: float | None = None
    ssim_machine: float | None = None
    ssim_scene: float | None = None
    max_error_machine: float | None = None
    max_error_scene: float | None = None


@dataclass
class Result(Picture):
    """A rendered image with its metrics, named as by the function `against`."""

    seconds: float | None = None
    counts: dict[str, int | float] = field(default_factory=dict)
    psnr_db_machine: float | None = None
    psnr_db_scene: float | None = None
    ssim_machine: float | None = None
    ssim_scene: float | None = None
    max_error_machine: float | None = None
    max_error_scene: float | None = None
    identical: bool | None = None
    cycles: int | None = None
    fps_at_800mhz: float | None = None
    traffic_bytes: dict[str, int] | None = None
    packing: dict[str, str | float | None] | None = None


def against(found: dict[str, Difference]) -> dict[str, float | None]:
    """Return metrics by JSON key, like `psnr_db_scene`.

    found: differences by name of the comparison:
        "machine": the machine's picture with the reference's of the same packed model
        "scene": the machine's picture with the reference's of the original scene
        "packing": the reference's picture of the packed model with that of the original scene
    """
    metrics = list(Difference.__dataclass_fields__)
    return {f"{key}_{name}": getattr(one, key) for key in metrics for name, one in found.items()}


def differences(image: np.ndarray, truths: dict[str, np.ndarray]) -> dict[str, Difference]:
    """Compare a uint8 image [H, W, 3] with several exact images; return differences by name."""
    return {name: difference(image, truth) for name, truth in truths.items()}


def decibels(row: dict, name: str) -> str:
    """Return the PSNR of a comparison in a row of `against`, as text; "–" if there was none."""
    none = "exact" if row.get(f"max_error_{name}") == 0 else "–"
    return shown(row.get(f"psnr_db_{name}"), ".2f", none=none)


def metrics_line(found: dict[str, Difference]) -> str:
    """Return differences as one line of text."""
    parts = []
    for name, one in found.items():
        psnr = "equal" if one.identical else f"{one.psnr_db:.2f} dB"
        ssim = "" if one.ssim is None else f", SSIM {one.ssim:.5f}"
        parts.append(f"{name} {psnr}{ssim}, max error {one.max_error:.4f}")
    return "; ".join(parts)


def _same_size(image: np.ndarray, reference: np.ndarray, name: str):
    """Raise InputError, naming `name`, if the sizes of two images differ."""
    if image.shape != reference.shape:
        (h, w), (rh, rw) = image.shape[:2], reference.shape[:2]
        raise InputError(f"{name}: size {w}x{h} differs from the first image's {rw}x{rh}")


def difference(image: np.ndarray, reference: np.ndarray, name: str = "image") -> Difference:
    """Compare uint8 images [H, W, 3]; raise InputError, naming `name`, if their sizes differ."""
    from skimage.metrics import structural_similarity  # takes a quarter of a second

    _same_size(image, reference, name)
    ssim = None
    if min(image.shape[:2]) >= SSIM_WINDOW:
        ssim = float(
            structural_similarity(
                image, reference, channel_axis=2, data_range=LEVELS,
                gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
            )
        )  # fmt: skip
    largest = float(channel_error(image, reference).max() / LEVELS)
    return Difference(psnr(image / LEVELS, reference / LEVELS), ssim, largest)


def psnr(image: np.ndarray, reference: np.ndarray) -> float | None:
    """Return the PSNR in dB of images with values 0 … 1; None for identical images."""
    return psnr_of_square(float(np.mean((image - reference) ** 2)))


def channel_error(image: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the largest absolute difference of the channels, [H, W], 0 … 255."""
    return np.abs(image.astype(np.int16) - reference.astype(np.int16)).max(axis=2)


def flip(image: np.ndarray, reference: np.ndarray, name: str = "image") -> float:
    """Return NVIDIA's LDR-FLIP of uint8 images [H, W, 3], the mean over pixels: 0 (equal) … 1.

    Andersson et al. 2020, at 67 pixels per degree as they propose. Raises InputError if the sizes
    differ, or without the package `flip-evaluator`.
    """
    return float(flip_map(image, reference, name).mean(dtype=np.float64))


def flip_map(image: np.ndarray, reference: np.ndarray, name: str = "image") -> np.ndarray:
    """Return the FLIP of each pixel, [H, W] 0 … 1."""
    _same_size(image, reference, name)
    try:
        from flip_evaluator import evaluate
    except ImportError:
        raise InputError("FLIP: needs flip-evaluator: pip install 'splatcore[compress]'") from None
    test, truth = (pixels.astype(np.float32) / LEVELS for pixels in (image, reference))
    return evaluate(truth, test, "LDR", applyMagma=False, computeMeanError=False)[0][..., 0]


def lpips(image: np.ndarray, reference: np.ndarray, name: str = "image") -> float | None:
    """Return LPIPS (Zhang et al. 2018, AlexNet) of uint8 images [H, W, 3]; 0 for equal images.

    Returns None unless the package `lpips` and the weights of its network are installed; nothing
    is downloaded. Raises InputError if the sizes differ.
    """
    _same_size(image, reference, name)
    network = _lpips_network()
    if network is None:
        return None
    import torch

    def planes(pixels: np.ndarray):
        """Convert to [1, 3, H, W] in −1 … 1, the format of the network's training."""
        return torch.from_numpy(pixels.astype(np.float32) * 2 / LEVELS - 1).permute(2, 0, 1)[None]

    with torch.no_grad():
        return float(network(planes(image), planes(reference)))


@cache
def _lpips_network():
    """Return the network, or None if it or its weights are missing."""
    if not all(map(find_spec, ("torch", "torchvision", "lpips"))):
        return None
    import torch
    from torchvision.models import AlexNet_Weights

    weights = Path(AlexNet_Weights.IMAGENET1K_V1.url).name
    if not (Path(torch.hub.get_dir()) / "checkpoints" / weights).is_file():
        return None
    from lpips import LPIPS

    return LPIPS(net="alex", verbose=False)
