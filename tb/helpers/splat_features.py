"""Random splats for stage 3."""

import numpy as np

from splatcore.golden.exact import encode
from splatcore.spec.config import Config
from splatcore.spec.memory import OPACITY
from splatcore.spec.record import Codes


def random_features(config: Config, count: int, size: tuple[int, int], seed: int) -> Codes:
    """Splats of all shapes on and around an image: points, needles, walls, far centres."""
    rng = np.random.default_rng(seed)
    far = np.where(rng.random(count) < 0.1, rng.choice([10, 100, 1000, 1e5], count), 1.0)
    centre = rng.uniform(-0.2, 1.2, (count, 2)) * size * far[:, None]
    xx, yy = 0.3 + 4.0 ** rng.uniform(-3, 9, (2, count)) * np.maximum(far, 1)
    xy = np.sqrt((xx - 0.3) * (yy - 0.3)) * rng.choice([0, 1, -1, 0.5, 0.999], count)
    schur = xx - xy**2 / yy
    codes = rng.integers(0, 1 << rng.integers(1, OPACITY.width + 1, count))
    opacity = 2.0 ** -OPACITY.decode(codes.astype(np.uint8))
    reach = np.maximum(2 * np.log(255 * opacity), 0)
    extent = np.sqrt(reach[:, None] * np.stack([xx, yy], axis=1))
    colour = rng.choice([0, 0.3, 1, 2, 8], (count, 3)) * rng.random((count, 3))
    return encode(config, centre, 1 / schur, xy / yy, 1 / yy, opacity, colour, extent)
