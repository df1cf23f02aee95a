"""The three smallest components of a unit quaternion, from which readers compute the largest."""

import numpy as np


def smallest_three(quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the place [N] of each quaternion's largest component, and the three others [N, 3].

    quaternion: [N, 4], in any order of components and of any norm, but not 0

    The others keep their order, are within ± 1/√2, and have the sign that makes the largest
    positive.
    """
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    largest = np.abs(unit).argmax(axis=1)
    sign = np.sign(unit[np.arange(len(unit)), largest])
    others = unit[np.arange(4) != largest[:, None]].reshape(-1, 3)
    return largest, others * sign[:, None]
