"""The scene that a packed model describes: position, scale, quaternion, opacity, harmonics."""

import numpy as np

from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene


def unpacked(model: PackedModel, rows: slice = slice(None)) -> Scene:
    """Return the scene of a packed model, or some of its Gaussians, as the machine reads it.

    L = U·S·Vᵀ gives the covariance L·Lᵀ = U·S²·Uᵀ: U holds the axes, S their standard deviations.
    Copies that pad a chunk are Gaussians of size 0 and opacity just above 1/255; the machine draws
    them, so they are kept.
    """
    from scipy.spatial.transform import Rotation

    found = model.gaussians(rows)
    axes, scale, _ = np.linalg.svd(found.factor)
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, not a reflection
    quaternion = np.zeros((len(found), 4))
    if len(found):
        quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    return Scene(
        found.position, scale, quaternion, found.opacity, found.sh, model.name,
        antialiased=found.antialiased, mark="model's header",
    )  # fmt: skip
