"""Real spherical harmonics up to degree 3 in the order and with the signs of 3DGS.

Source: Sloan, "Stupid Spherical Harmonics Tricks" (2008), appendix A2; signs as in the 3DGS
rasterizer (Condon–Shortley phase).
"""

import numpy as np

C0 = np.sqrt(1 / (4 * np.pi))
C1 = np.sqrt(3 / (4 * np.pi))
C2 = np.sqrt(np.array([15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi))
C3 = np.sqrt(np.array([35 / 8, 105, 21 / 8, 7 / 4, 21 / 8, 105 / 4, 35 / 8]) / (4 * np.pi))


def basis(direction: np.ndarray, degree: int) -> np.ndarray:
    """Basis functions [N, (degree+1)²] in unit directions [N, 3] from the camera outwards."""
    x, y, z = direction.T
    xx, yy, zz = x * x, y * y, z * z
    terms = [np.full_like(x, C0)]
    if degree >= 1:
        terms += [-C1 * y, C1 * z, -C1 * x]
    if degree >= 2:
        terms += [
            C2[0] * x * y,
            -C2[1] * y * z,
            C2[2] * (2 * zz - xx - yy),
            -C2[3] * x * z,
            C2[4] * (xx - yy),
        ]
    if degree >= 3:
        terms += [
            -C3[0] * y * (3 * xx - yy),
            C3[1] * x * y * z,
            -C3[2] * y * (4 * zz - xx - yy),
            C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            -C3[4] * x * (4 * zz - xx - yy),
            C3[5] * z * (xx - yy),
            -C3[6] * x * (xx - 3 * yy),
        ]
    return np.stack(terms, axis=1)
