"""Finished blocks leave in a fixed order, whatever the order in which they come."""

import numpy as np
import pytest

from splatcore.hdl.raster.finished import Finished
from splatcore.hdl.raster.finished_quads import FinishedQuads
from splatcore.spec.config import DEFAULT
from splatcore.spec.quads import QUADS, quad_pixels
from splatcore.spec.raster import block_count, nth_block, pixels_record
from tb.helpers.configs import MACHINES, machines, other_port
from tb.helpers.runs import compiled

GROUPS = 4
CONFIGS = machines("DEFAULT TINY FOUR_BLOCKS SIXTEEN") | {"port": other_port(DEFAULT)}


@pytest.mark.parametrize("stall", [0, 0.5])
@pytest.mark.parametrize("name", CONFIGS)
def test_order(name, stall):
    """All blocks of several groups, each group after the previous one has left."""
    config, rng = CONFIGS[name], np.random.default_rng(1)
    blocks, record = block_count(config), pixels_record(config)
    pixels = rng.integers(0, 256, (GROUPS, blocks, 16, 3), np.uint8)
    pause = 20 * blocks + 100
    valid, block = np.zeros((2, GROUPS, blocks + pause), np.uint64)
    rows = np.zeros((GROUPS, blocks + pause, 48), np.uint8)
    for group in range(GROUPS):
        come = rng.permutation(blocks)
        valid[group, :blocks], block[group, :blocks] = 1, come
        rows[group, :blocks] = pixels[group, come].reshape(blocks, 48)
    order = [nth_block(config, number) for number in range(blocks)]
    assert sorted(order) == list(range(blocks))
    found = compiled(Finished, config).run(
        {},
        constants={"valid": valid.ravel(), "block": block.ravel(), "pixels": rows.reshape(-1, 48)},
        expected={"o": GROUPS * blocks}, stall=stall, idle_max=2 * pause,
    )  # fmt: skip
    assert found.finished, found.stopped
    codes = record.unpack(found.outputs["o"])["pixels"].reshape(GROUPS, blocks, 16, 3)
    assert (codes == pixels[:, order]).all()


@pytest.mark.parametrize("stall", [0, 0.5])
def test_quads(stall):
    """A block leaves when its last quad has come; each quad in its own order, group after group."""
    config, rng = MACHINES["QUADS"], np.random.default_rng(2)
    blocks, record = block_count(config), pixels_record(config)
    pixels = rng.integers(0, 256, (GROUPS, blocks, 16, 4), np.uint8)
    pause = 20 * blocks + 100
    constants = {}
    for quad in range(QUADS):
        valid, block = np.zeros((2, GROUPS, 2 * blocks + pause), np.uint64)
        rows = np.zeros((*valid.shape, 16), np.uint8)
        for group in range(GROUPS):
            come, at = rng.permutation(blocks), np.sort(rng.permutation(2 * blocks)[:blocks])
            valid[group, at], block[group, at] = 1, come
            rows[group, at] = pixels[group, come][:, quad_pixels(quad)].reshape(blocks, 16)
        constants |= {f"valid__{quad}": valid.ravel(), f"block__{quad}": block.ravel()}
        constants[f"pixels__{quad}"] = rows.reshape(-1, 16)
    found = compiled(FinishedQuads, config).run(
        {}, constants=constants, expected={"o": GROUPS * blocks}, stall=stall, idle_max=2 * pause
    )
    assert found.finished, found.stopped
    codes = record.unpack(found.outputs["o"])["pixels"].reshape(GROUPS, blocks, 16, 4)
    order = [nth_block(config, number) for number in range(blocks)]
    assert (codes == pixels[:, order]).all()
