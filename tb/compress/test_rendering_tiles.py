"""Kernels of the differentiable renderer: exponential, tile lists, equal bits for any threads."""

import numba
import numpy as np
import pytest
import torch

from splatcore.golden.reference import project
from splatcore.golden.reference import render as reference
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.gradients import differentiable, drawn, rendering_points, rendering_tiles
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.spec.camera import Camera
from splatcore.spec.convention import TILE
from splatcore.spec.scene import Gaussians
from tb.helpers.dense_splatting import PARAMETERS
from tb.helpers.splatting_scenes import loss, tensors


def garden() -> tuple[dict[str, np.ndarray], Camera]:
    """A scene of 45 tiles, the last ones cut off."""
    gaussians = generate("garden", 3000).gaussians()
    arrays = {name: getattr(gaussians, name) for name in PARAMETERS[:4]}
    arrays["shift"] = np.zeros((len(gaussians), 2))
    return arrays, generated_camera("garden").resized(133, 75)


def bits(kind: torch.dtype) -> list[bytes]:
    """Bytes of all results: picture, visible Gaussians, weights, gradients."""
    arrays, camera = garden()
    leaves = tensors(arrays, kind, gradient=True)
    found = render(**leaves, camera=camera)
    loss(found).backward()
    four = [leaves[key].detach().numpy() for key in PARAMETERS[:4]]
    (weights,) = blending_weights(Gaussians(*four), [camera], four[0].dtype)
    results = [found.image.detach().numpy(), found.transmittance.detach().numpy(), found.visible]
    results += [weights, *(leaf.grad.numpy() for leaf in leaves.values())]
    return [array.tobytes() for array in results]


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_same_bits_whatever_the_threads(kind, monkeypatch):
    first = bits(kind)
    assert bits(kind) == first
    threads = numba.get_num_threads()
    try:
        for count in range(1, numba.config.NUMBA_NUM_THREADS + 1):
            numba.set_num_threads(count)
            assert bits(kind) == first
    finally:
        numba.set_num_threads(threads)
    for count in (1, 2, 3, 7):  # shares of the work, on as many threads as there are
        for module in (differentiable, drawn):
            monkeypatch.setattr(module, "get_num_threads", lambda n=count: n)
        monkeypatch.setattr(rendering_tiles.numba, "get_num_threads", lambda n=count: n)
        assert bits(kind) == first


@pytest.mark.parametrize("kind, most", [(np.float64, 5e-10), (np.float32, 3e-6)])
def test_exponential(kind, most):
    terms = rendering_tiles.TERMS.astype(kind)
    forms = np.linspace(0, 2 * np.log(255), 2000).astype(kind)
    found = np.array([rendering_tiles._exponential(form, terms) for form in forms])
    assert np.abs(found / np.exp(-0.5 * forms.astype(np.float64)) - 1).max() < most
    assert rendering_tiles._exponential(kind(1e30), terms) < 1 / 255  # cut off, without overflow
    assert abs(rendering_tiles._exponential(kind(-1e-3), terms) - 1) < most


@pytest.mark.parametrize("antialiased", [False, True])
def test_splats_are_those_of_the_reference(antialiased):
    """Equal opacity, reach and box; a few more splats, whose boxes hold no pixel centre."""
    arrays, camera = garden()
    arrays["factor"] *= 0.3  # many are below a pixel
    view = rendering_points.view_numbers(camera, antialiased)
    splats, index = drawn._project([arrays[key] for key in PARAMETERS], view)
    wanted, _ = project(Gaussians(*(arrays[key] for key in PARAMETERS[:4]), antialiased), camera)
    assert 500 < len(wanted) <= len(index) < 1.1 * len(wanted)
    found = splats[np.isin(index, wanted.index)]
    assert np.allclose(found[:, rendering_points.OPACITY], wanted.opacity, rtol=1e-12)
    assert np.allclose(found[:, rendering_points.REACH], wanted.reach, rtol=1e-9, atol=1e-12)
    box = found[:, [rendering_points.WIDE, rendering_points.HIGH]]
    assert np.allclose(box, wanted.extent, rtol=1e-9, atol=1e-9)


def test_lists_hold_the_pairs_of_the_reference():
    arrays, camera = garden()
    view = rendering_points.view_numbers(camera)
    splats, index = drawn._project([arrays[key] for key in PARAMETERS], view)
    first, start, pair, owner = rendering_tiles.tile_lists(splats, camera.width, camera.height)
    wanted = reference(generate("garden", 3000).gaussians(), camera)
    assert np.array_equal(np.diff(start), wanted.tile_list.reshape(-1))
    assert len(index) == wanted.counts["visible"] and len(pair) == wanted.counts["pairs"]
    assert np.array_equal(np.sort(pair), np.arange(len(pair)))
    assert (owner == np.searchsorted(first, pair, "right") - 1).all()
    for tile in range(len(start) - 1):
        assert (np.diff(owner[start[tile] : start[tile + 1]]) > 0).all()  # by depth


@pytest.mark.parametrize("size", [(16, 16), (17, 31), (1, 40), (64, 3)])
def test_tiles_to_image_and_back(size):
    camera = garden()[1].resized(*size)
    image = np.random.default_rng(0).normal(size=(camera.height, camera.width))
    tiles = drawn.to_tiles(image, camera)
    assert np.array_equal(drawn.to_image(tiles, camera), image)
    assert np.count_nonzero(tiles) == image.size
    corners = rendering_tiles.corners(*size, np.dtype(np.float64)).astype(int)
    for tile, (left, top) in zip(tiles, corners, strict=True):
        part = image[top : top + TILE, left : left + TILE]
        assert np.array_equal(tile[: part.shape[0], : part.shape[1]], part)
