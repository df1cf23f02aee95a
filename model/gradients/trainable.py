"""A scene as tensors to optimise: the numbers that 3DGS stores, before its activations.

The names are the ones gsplat's densification expects: means, scales (logarithms), quats,
opacities (logits), sh0 [N, 1, 3] and shN [N, (degree+1)² − 1, 3].
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from splatcore.model.formats.file import reading
from splatcore.model.formats.ply import OPACITY_MARGIN, log_scales
from splatcore.spec.scene import Scene

RATES = {
    "means": 1.6e-4,  # times the scene's extent
    "scales": 5e-3,
    "quats": 1e-3,
    "opacities": 5e-2,
    "sh0": 2.5e-3,
    "shN": 2.5e-3 / 20,
}
"""Learning rates of 3DGS (Kerbl et al. 2023, `arguments/__init__.py`)."""

REFINING = {
    "means": 5e-2,  # times the Gaussians' size (`size_of`)
    "scales": 2e-2,
    "quats": 4e-3,
    "opacities": 6e-2,
    "sh0": 1e-2,
    "shN": 1e-2,
}
"""Learning rates of a trained scene that has lost Gaussians or harmonics: shapes and colours must
change much, positions little, and less if Gaussians are smaller
(docs/notes/2026-11-compression.md)."""

EPSILON = 1e-15  # Adam's, as in 3DGS

Tensors = dict[str, torch.Tensor]
Optimizers = dict[str, torch.optim.Adam]


def write_state(path: Path, state: dict):
    """Write a state of training to a file, entirely or not at all."""
    part = path.with_suffix(".part")
    with reading(path, "cannot be written"):
        torch.save(state, part)
        part.replace(path)


def device() -> torch.device:
    """The device to compute on: CUDA if PyTorch has it, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def tensors_of(scene: Scene) -> Tensors:
    """The tensors of a scene of finite numbers: float32 leaves.

    Scales are kept above 0 and opacities between 0 and 1, so that logarithms and logits are finite.
    """
    opacity = np.clip(scene.opacity, OPACITY_MARGIN, 1 - 1e-6)
    arrays = {
        "means": scene.position,
        "scales": log_scales(scene),
        "quats": scene.quaternion,
        "opacities": np.log(opacity) - np.log1p(-opacity),
        "sh0": scene.sh[:, :1],
        "shN": scene.sh[:, 1:],
    }
    leaf = {"dtype": torch.float32, "device": device(), "requires_grad": True}
    return {name: torch.tensor(array, **leaf) for name, array in arrays.items()}


def scene_of(tensors: Tensors, of: Scene | None = None) -> Scene:
    """The scene of tensors, float64, with name and mark of the scene `of` if given."""
    array = {name: tensor.detach().double().cpu().numpy() for name, tensor in tensors.items()}
    scene = Scene(
        array["means"], np.exp(array["scales"]), array["quats"],
        1 / (1 + np.exp(-array["opacities"])),
        np.concatenate([array["sh0"], array["shN"]], axis=1),
    )  # fmt: skip
    if of is None:
        return scene
    return replace(scene, name=of.name, antialiased=of.antialiased, mark=of.mark)


def factor_of(tensors: Tensors) -> torch.Tensor:
    """Factors R·S [N, 3, 3] of the covariances."""
    return rotation(tensors["quats"]) * torch.exp(tensors["scales"])[:, None]


def rotation(quats: torch.Tensor) -> torch.Tensor:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] (w, x, y, z) of any length except 0."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).unbind(1)
    return torch.stack([
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ], dim=1).reshape(-1, 3, 3)  # fmt: skip


def rendered(tensors: Tensors) -> tuple[torch.Tensor, ...]:
    """Arguments of `differentiable.render`: position, factor, opacity, harmonics."""
    sh = torch.cat([tensors["sh0"], tensors["shN"]], dim=1)
    return tensors["means"], factor_of(tensors), torch.sigmoid(tensors["opacities"]), sh


def optimizers(
    tensors: Tensors, unit: float, rates: dict[str, float] = RATES, share: float = 1.0
) -> Optimizers:
    """One Adam optimizer per tensor.

    unit: scene units, scales the learning rate of the positions
    rates: learning rates by name
    share: factor of all learning rates
    """
    rates = {name: share * rates[name] * (unit if name == "means" else 1) for name in tensors}
    return {
        name: torch.optim.Adam([tensor], lr=rates[name], eps=EPSILON, fused=True)
        for name, tensor in tensors.items()
        if tensor.numel()
    }


def refining(tensors: Tensors, share: float, more: dict[str, float] | None = None) -> Optimizers:
    """`optimizers` with a share of the rates REFINING; `more`: rates of further tensors."""
    return optimizers(tensors, size_of(tensors), REFINING | (more or {}), share)


def size_of(tensors: Tensors) -> float:
    """Typical size of the Gaussians: median of their middle scales, scene units."""
    return float(tensors["scales"].detach().median(dim=1).values.median().exp())


def extent_of(cameras: list) -> float:
    """Extent of the cameras, scene units: 1.1 times the largest distance from their mean.

    As in 3DGS (`getNerfppNorm`); 1 for a single camera.
    """
    centres = np.array([camera.position for camera in cameras])
    distance = np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()
    return 1.1 * float(distance) if distance > 0 else 1.0
