"""A picture rendered by the numba kernels, with the data for its gradients; without PyTorch."""

from collections.abc import Iterable, Iterator

import numpy as np
from numba import get_num_threads

from splatcore.model.gradients import rendering_points, rendering_tiles
from splatcore.model.gradients.rendering_points import RED
from splatcore.spec.camera import Camera
from splatcore.spec.convention import SPLATCORE, TILE
from splatcore.spec.scene import Gaussians


class Drawn:
    """A picture rendered by the kernels, with the data for its gradients.

    colour: [tiles, 3, 16, 16] over black
    state: transmittances, and each pixel's last entry, [tiles, 16, 16]
    index: [M] the visible Gaussians, in depth order
    """

    def __init__(self, arrays, camera: Camera, antialiased: bool):
        """Render arrays (position, factor, opacity, sh, shift); see `differentiable.render`."""
        self.camera = camera
        self.view = rendering_points.view_numbers(camera, antialiased)
        self.splats, self.index = _project(arrays, self.view)
        size = camera.width, camera.height
        lists = rendering_tiles.tile_lists(self.splats, *size)
        limits = SPLATCORE.alpha_min, SPLATCORE.alpha_max, SPLATCORE.transmittance_min
        self.colour, *self.state = rendering_tiles.blend(self.splats, lists, *size, limits)
        self.blended = self.splats, lists, *size, limits, self.state

    def backward(self, to_colour: np.ndarray, to_rest: np.ndarray) -> np.ndarray:
        """Gradients [M, 9] by the splats, from gradients by colour and transmittance in tiles."""
        return rendering_tiles.blend_backward(*self.blended, to_colour, to_rest)


def _project(arrays, view) -> tuple[np.ndarray, np.ndarray]:
    """The visible splats [M, 12] in depth order, and the indices [M] of their Gaussians."""
    arrays = [np.ascontiguousarray(array) for array in arrays]  # numba compiles for each layout
    position = arrays[0]
    splats = np.empty((len(position), 12), position.dtype)
    depth = np.empty(len(position), np.float64)
    rendering_points.project(*arrays, view, get_num_threads(), splats, depth)
    index = np.flatnonzero(depth)
    index = index[np.argsort(depth[index], kind="stable")]
    return splats[index], index


def to_image(tiles: np.ndarray, camera: Camera) -> np.ndarray:
    """Convert [tiles, 16, 16] to [H, W]."""
    rows, columns = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = tiles.reshape(rows, columns, TILE, TILE).swapaxes(1, 2)
    return whole.reshape(rows * TILE, columns * TILE)[: camera.height, : camera.width].copy()


def to_tiles(image: np.ndarray, camera: Camera) -> np.ndarray:
    """Convert [H, W] to [tiles, 16, 16], with zeros outside the image."""
    rows, columns = -(-camera.height // TILE), -(-camera.width // TILE)
    whole = np.zeros((rows * TILE, columns * TILE), image.dtype)
    whole[: camera.height, : camera.width] = image
    tiles = whole.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
    return tiles.reshape(-1, TILE, TILE).copy()


def blending_weights(
    gaussians: Gaussians, cameras: Iterable[Camera], kind: type = np.float32
) -> Iterator[np.ndarray]:
    """Yield, for each view, the contribution [N] of each Gaussian: Σ alpha·T over the pixels.

    kind: floating type of the computation

    Computed as the gradient, by the splats' red, of the sum of all red pixel values.
    """
    arrays = (gaussians.position, gaussians.factor, gaussians.opacity, gaussians.sh[:, :1])
    with np.errstate(over="ignore"):  # Gaussians with Inf are not drawn
        arrays = [np.asarray(array, kind) for array in arrays]
    arrays.append(np.zeros((len(gaussians), 2), kind))
    for camera in cameras:
        drawn = Drawn(arrays, camera, gaussians.antialiased)
        to_colour = np.zeros_like(drawn.colour)
        to_colour[:, 0] = 1
        weight = np.zeros(len(gaussians))
        weight[drawn.index] = drawn.backward(to_colour, np.zeros_like(drawn.state[0]))[:, RED]
        yield weight
