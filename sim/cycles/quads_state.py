"""State of the cycle model of lanes in quads, and its constants."""

from typing import NamedTuple

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.hdl.lib.stream import Register
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.prepare import CUTS
from splatcore.hdl.raster.quads import OPERATIONS_WAITING, SHARE, quad_of
from splatcore.hdl.raster.raster import SPLATS_WAITING
from splatcore.hdl.raster.rasterizer import PAIRS_WAITING, STAGES
from splatcore.hdl.raster.setup import Setup
from splatcore.sim.cycles.visits import NOT_SEEN
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import group_grid
from splatcore.spec.quads import QUADS, ended_level, halvings_min, quad_pixels
from splatcore.spec.raster import BLOCKS, nth_block, owned

BLOCKS_A_TILE = BLOCKS**2

# Cycles from the registers of stage 3.

MARKED = Setup.LATENCY + Mark.LATENCY + 1  # from a pair's issue to its offer to the rasterizers
BEGIN = len(CUTS) + Register.HOLDS  # from the first splat to its first pair
SPLATS_INSIDE = SPLATS_WAITING + len(CUTS) - 1  # before setup
QUEUE_LATENCY = 2  # from an item entering a queue to its use
OUTPUT_LATENCY = QUEUE_LATENCY + Blend.LATENCY + 2  # from an operation to the block's output
LEVEL_LATENCY = Blend.BUSY + 2  # from an operation entering the lanes to the use of its level

NOTHING, END, OUTPUT = -1, -2, -3  # instead of a pair; instead of a pair; instead of a visit

FEEDER = np.dtype(
    [
        ("head", np.int64),  # pairs so far
        ("taken", bool),  # the pair to be dealt is taken
        ("started", bool),
        ("group", np.int64),
        ("done", np.int64),  # blocks of the present pair, one bit each
        ("next", np.int64),  # block that may be output next
        ("last", np.int64),  # cycle in which an operation last entered the lanes
        ("visits", np.int64, STAGES),  # in flight to the queues
        ("blocks", np.int64, STAGES),  # their blocks
        ("gives", np.int64, STAGES),  # they also output the block
    ]
)
"""A rasterizer."""


class Machine(NamedTuple):
    """Constants. Shapes with rasterizers R, blocks B per rasterizer and group."""

    own: np.ndarray  # [R, blocks per tile] its blocks of a tile
    order: np.ndarray  # [B] its blocks as they are output
    quads: np.ndarray  # [2, QUADS] quads of blocks → quads of lanes, by place among the sharing
    faint: np.ndarray  # [levels + 1] halvings from which on a quad at that level skips
    ended: int
    tiles: int


class Queues(NamedTuple):
    """Queues of operations, by rasterizer and quad; and of pairs, by rasterizer."""

    visit: np.ndarray  # [R, QUADS, depth] visit or `OUTPUT`
    block: np.ndarray
    came: np.ndarray  # [R, QUADS, depth] cycle
    head: np.ndarray  # [R, QUADS]
    count: np.ndarray
    pair: np.ndarray  # [R, depth] pair or `END`
    tile: np.ndarray
    pair_came: np.ndarray
    pairs: np.ndarray  # [R] pairs waiting


class State(NamedTuple):
    """State that changes in a group, and items in flight."""

    stale: np.ndarray  # [R, B] still to be output
    touched: np.ndarray  # [R, B] blended since
    level: np.ndarray  # [R, B] known level of the block
    now: np.ndarray  # [R, B, QUADS] level of a quad, known from cycle `since` on; before: `before`
    since: np.ndarray
    before: np.ndarray
    lanes: np.ndarray  # [R / 2, QUADS, BUSY − 1] rasterizer and block in flight
    pipe: np.ndarray  # [MARKED] pairs to be dealt
    pipe_tile: np.ndarray
    splats: np.ndarray  # [SPLATS_INSIDE] entries, or `END`, before the first pair is issued
    waiting: np.ndarray  # [2] place of the first one, number
    # [6]: –, the first splat's tiles that are done, its group, the group dealt, the next entry, its
    # group
    at: np.ndarray


def begun(config: Config, frame: Frame, groups: np.ndarray) -> np.ndarray:
    """Levels [groups, rasterizers, B, QUADS] as groups begin: outside the image all have ended."""
    height, width = frame.pixels.shape[:2]
    own = np.array([owned(config, number) for number in range(config.rasterizers)])
    row, column = np.divmod(groups, group_grid(config, width, height)[1])
    tile_y, tile_x = np.divmod(np.arange(config.group**2), config.group)
    first = np.array([quad_pixels(quad)[0] for quad in range(QUADS)])

    def place(group, tile, block, pixel):
        tiles = (group[:, None] * config.group + tile)[:, None, :, None, None] * TILE
        return tiles + block[:, None, :, None] * BLOCK + pixel

    y = place(row, tile_y, own // BLOCKS, first // BLOCK)
    x = place(column, tile_x, own % BLOCKS, first % BLOCK)
    levels = np.where((y < height) & (x < width), 0, ended_level(config))
    return levels.reshape(len(groups), config.rasterizers, -1, QUADS)


def machine_of(config: Config) -> Machine:
    """Return a machine's constants."""
    own = np.array([owned(config, number) for number in range(config.rasterizers)])
    tiles, ended = config.group**2, ended_level(config)
    order = np.array([nth_block(config, number) for number in range(tiles * own.shape[1])])
    quads = np.array([[quad_of(k, quad) for quad in range(QUADS)] for k in range(SHARE)])
    faint = np.array([NOT_SEEN, *(halvings_min(config, k) for k in range(1, ended)), 0])
    return Machine(own, order, quads, faint, ended, tiles)


def queues_of(machine: Machine) -> Queues:
    """Return empty queues."""
    count = len(machine.own)
    operations, waiting = (count, QUADS, OPERATIONS_WAITING), (count, PAIRS_WAITING)
    return Queues(
        *np.zeros((3, *operations), np.int64), *np.zeros((2, count, QUADS), np.int64),
        *np.zeros((3, *waiting), np.int64), np.zeros(count, np.int64),
    )  # fmt: skip


def state_of(machine: Machine) -> State:
    """Return the state before the first group."""
    shape = len(machine.own), len(machine.order)
    return State(
        *np.zeros((2, *shape), bool), np.zeros(shape, np.int64),
        *np.zeros((3, *shape, QUADS), np.int64),
        np.full((shape[0] // SHARE, QUADS, Blend.BUSY - 1), NOTHING),
        np.full(MARKED, NOTHING), np.zeros(MARKED, np.int64), np.zeros(SPLATS_INSIDE, np.int64),
        np.zeros(2, np.int64), np.zeros(6, np.int64),
    )  # fmt: skip
