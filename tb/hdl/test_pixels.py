"""Writing pixels: every byte of an image once, in legal bursts; and the cycles it takes."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.raster.pixels import Pixels
from splatcore.sim.rtl.streams import Result
from splatcore.spec import axi
from splatcore.spec.binning import groups_max
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.number import Bits
from splatcore.spec.pixel import background_code
from splatcore.spec.raster import (
    BLOCKS,
    block_count,
    colours,
    nth_block,
    owned,
    pixels_record,
    position_record,
    span_blocks,
    spans_meet,
)
from splatcore.spec.record import Codes, Record
from splatcore.spec.work import PIXEL, STRIDE_ALIGNMENT, STRIDE_BITS, pixel_bytes, stride
from tb.helpers.configs import machines, other_port
from tb.helpers.memory_port import Writes
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow

SPAN_CYCLES = 2 * BLOCK  # per span of `DEFAULT`, at most
GROUP_CYCLES = 64 * 64 * PIXEL // axi.port_bytes(DEFAULT) + 1
SLACK = 12  # cycles before the first span and behind the last one

PORTS = {"port": other_port(DEFAULT), "small port": other_port(TINY)}
WITH_ALPHA = {
    f"{name} alpha": replace(config, name=f"{config.name}_ALPHA", rgba=True)
    for name, config in (machines("DEFAULT ONE FOUR_BLOCKS") | PORTS).items()
}
VERIFIED = ("ONE", "FOUR_BLOCKS", *WITH_ALPHA)
CONFIGS = machines("DEFAULT TINY ALPHA ONE FOUR_BLOCKS") | PORTS | WITH_ALPHA

SIZES = ((64, 64), (33, 17), (1, 64), (63, 1), (36, 40), (5, 3), (32, 32), (64, 61))
LARGE_SIZES = ((200, 130), (1, 1), (129, 64), (64, 260), (340, 60))


POSITIONS = ("positions", "empty")
JOB = ("width", "height", "pixels", "stride", "background")


def frame_record(config: Config) -> Record:
    """A frame's inputs of `Pixels`, and the number of its groups per stream of `POSITIONS`."""
    sizes = {"width": config.width_max, "height": config.height_max}
    sizes |= dict.fromkeys(("groups", *POSITIONS), groups_max(config))
    fields = {name: Bits(size.bit_length()) for name, size in sizes.items()}
    fields |= {"pixels": Bits(axi.BEAT_ADDRESS_BITS)}
    fields |= {"stride": Bits(STRIDE_BITS - axi.BEAT_BITS)}
    fields |= {"rgba": Bits(1)} if config.rgba else {}
    return Record("frame", fields | {"background": Record("colour", colours(config))})


class Frames(wiring.Component):
    """`Pixels`, frame after frame.

    Members, in addition to its streams
        frames: stream of `frame_record`
        hold: no block reaches `Pixels`
        through: a frame is written
    """

    def __init__(self, config: Config):
        self.pixels, self.record = Pixels(config), layout(frame_record(config))
        members = self.pixels.signature.members
        ports = {name: members[name] for name in (*POSITIONS, "i", "writes", "through")}
        super().__init__(ports | {"frames": In(stream.Signature(self.record)), "hold": In(1)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pixels = pixels = self.pixels
        connect(m, pixels.writes, flipped(self.writes))
        frame, active = Signal(self.record), Signal()
        m.d.comb += [self.frames.ready.eq(~active & ~pixels.start), self.through.eq(pixels.through)]
        m.d.sync += pixels.start.eq(self.frames.valid & self.frames.ready)
        with m.If(self.frames.valid & self.frames.ready):
            m.d.sync += frame.eq(self.frames.payload)
        names = (*JOB, "rgba") if "rgba" in self.record.members else JOB
        m.d.comb += [pixels.job[name].eq(frame[name]) for name in names]
        m.d.comb += pixels.groups.eq(frame.groups)
        with m.If(pixels.start | pixels.through):
            m.d.sync += active.eq(pixels.start)
        for name in POSITIONS:
            inner = getattr(pixels, name)
            self._gate(m, getattr(self, name), inner, active & frame[name].any())
            with m.If(inner.valid & inner.ready):
                m.d.sync += frame[name].eq(frame[name] - 1)
        for i, inner in zip(self.i, pixels.i, strict=True):
            offered = Signal()  # an offer, once made, is not held back
            m.d.sync += offered.eq(inner.valid & ~inner.ready)
            self._gate(m, i, inner, ~self.hold | offered)
        return m

    def _gate(self, m: Module, outer, inner, open_):
        m.d.comb += [
            inner.payload.eq(outer.payload),
            inner.valid.eq(outer.valid & open_),
            outer.ready.eq(inner.ready & open_),
        ]


@dataclass(frozen=True, eq=False)
class Image:
    """A frame to write."""

    pixels: np.ndarray  # [H, W, 3] uint8; [H, W, 4] with alpha
    empty: np.ndarray  # [groups] bool
    at: int  # address, in beats
    stride: int  # distance of rows, in beats
    background: tuple[int, ...]  # colour codes


def image(config: Config, size, empty: np.ndarray, seed: int = 0, rgba: bool = False) -> Image:
    """Return random pixels, background in empty groups, at a random address and stride."""
    rng, (width, height) = np.random.default_rng(seed), size
    top = max(format.width for format in colours(config).values())
    colour = tuple(int(c) for c in rng.integers(0, 1 if rgba else 1 << top, 3))
    pixels = rng.integers(0, 256, (height, width, pixel_bytes(rgba)), dtype=np.uint8)
    side, columns = group_pixels(config), group_grid(config, *size)[1]
    for group in np.flatnonzero(empty):
        row, column = divmod(int(group), columns)
        area = slice(row * side, (row + 1) * side), slice(column * side, (column + 1) * side)
        pixels[area] = 0
        pixels[area][..., :3] = [min(background_code(config, c), 255) for c in colour]
    unit = STRIDE_ALIGNMENT // axi.BEAT
    beats = stride(width, rgba) // axi.BEAT + int(rng.integers(0, 9)) * unit
    return Image(pixels, empty, int(rng.integers(1 << 20)) * unit, beats, colour)


def places(config: Config, size, empty: np.ndarray) -> Codes:
    """Return the positions of the groups marked in `empty`."""
    chosen = np.flatnonzero(empty)
    columns = group_grid(config, *size)[1]
    return {"column": chosen % columns, "row": chosen // columns}


def finished(config: Config, image: Image, rasterizer: int) -> Codes:
    """Return a rasterizer's blocks of the image, group after group, with those outside it."""
    height, width, channels = image.pixels.shape
    side, stored = group_pixels(config), pixel_bytes(config.rgba)
    padded = np.random.default_rng(rasterizer).integers(
        0, 256, (height + side, width + side, stored)
    )
    padded[:height, :width, :channels] = image.pixels
    found, own = places(config, (width, height), ~image.empty), owned(config, rasterizer)
    pixels = []
    for group_row, group_column in zip(found["row"], found["column"], strict=True):
        for number in range(block_count(config)):
            tile, block = divmod(nth_block(config, number), len(own))
            y = group_row * side + tile // config.group * TILE + own[block] // BLOCKS * BLOCK
            x = group_column * side + tile % config.group * TILE + own[block] % BLOCKS * BLOCK
            pixels.append(padded[y : y + BLOCK, x : x + BLOCK])
    return {"pixels": np.array(pixels, np.uint8).reshape(-1, BLOCK**2, stored)}


def run(config: Config, images: list[Image], **options) -> Result:
    """Write the images one after the other, and check each byte by byte."""
    sizes = [image.pixels.shape[1::-1] for image in images]
    record, position = frame_record(config), position_record(config)
    frames = {
        "width": [width for width, _ in sizes],
        "height": [height for _, height in sizes],
        "groups": [len(image.empty) for image in images],
        "positions": [np.sum(~image.empty) for image in images],
        "empty": [np.sum(image.empty) for image in images],
        "pixels": [image.at for image in images],
        "stride": [image.stride for image in images],
    }
    if config.rgba:
        frames["rgba"] = [image.pixels.shape[2] > PIXEL for image in images]
    frames = {name: np.array(values) for name, values in frames.items()}
    colour = np.array([image.background for image in images]).T
    frames["background"] = dict(zip(colours(config), colour, strict=True))

    def rows(record: Record, codes) -> np.ndarray:
        return np.concatenate([record.pack(codes(k)) for k in range(len(images))])

    inputs = {"frames": record.pack(frames)}
    inputs["positions"] = rows(position, lambda k: places(config, sizes[k], ~images[k].empty))
    inputs["empty"] = rows(position, lambda k: places(config, sizes[k], images[k].empty))
    for r in range(config.rasterizers):
        given = partial(finished, config, rasterizer=r)
        inputs[f"i__{r}"] = rows(pixels_record(config), lambda k, given=given: given(images[k]))
    written = [beats_of(config, image) for image in images]
    options.setdefault("constants", {"hold": 0})
    found = compiled(Frames, config, samples=("through",)).run(
        inputs, expected={"writes": sum(written)}, **options
    )
    assert found.finished, found.stopped
    assert found.samples["through"].sum() == len(images)
    parts = np.split(found.outputs["writes"], np.cumsum(written)[:-1])
    for part, image in zip(parts, images, strict=True):
        check(config, part, image)
    return found


def beats_of(config: Config, image: Image) -> int:
    """Return the beats written per image: a span of a row takes every beat that it touches; a beat
    shared by two spans counts twice, unless they fill their beats together."""
    height, width, pixel = image.pixels.shape
    meet = spans_meet(config) and pixel == PIXEL
    step = span_blocks(config) * BLOCK * (1 + meet)
    begins = np.arange(0, width, step)
    ends, beat = np.minimum(begins + step, width), axi.port_bytes(config)
    return height * int((-(-ends * pixel // beat) - begins * pixel // beat).sum())


def check(config: Config, rows: np.ndarray, image: Image):
    """Check that bursts are whole and within a page, and write each byte of the image once."""
    height, width, pixel = image.pixels.shape
    address, value = Writes.of(config, rows).bytes()
    y, x = np.divmod(address - image.at * axi.BEAT, image.stride * axi.BEAT)
    assert len(np.unique(address)) == len(address) == height * width * pixel
    assert ((y >= 0) & (y < height) & (x < width * pixel)).all()
    found = np.zeros((height, width * pixel), np.uint8)
    found[y, x] = value
    assert np.array_equal(found.reshape(image.pixels.shape), image.pixels)


def emptiness(groups: int, seed: int) -> list[np.ndarray]:
    """Return masks of groups without splats: all, none, the first, the last, some."""
    number = np.arange(groups)
    some = np.random.default_rng(seed).random(groups) < 0.5
    return [number >= 0, number < 0, number == 0, number == groups - 1, some]


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
@pytest.mark.parametrize(
    "name",
    [
        "DEFAULT",
        "TINY",
        "ALPHA",
        "port",
        "small port",
        *(pytest.param(name, marks=pytest.mark.verify) for name in VERIFIED),
    ],
)
def test_images(name, stall):
    """Images that end within groups, tiles and blocks, one after the other in one run; every other
    one with alpha, if the machine has it."""
    config = CONFIGS[name]
    sizes = SIZES if config.width_max <= 64 else LARGE_SIZES
    make = partial(image, config)
    images = []
    for k, size in enumerate(sizes):
        choices = emptiness(int(np.prod(group_grid(config, *size))), k)
        images += [
            make(size, empty, 10 * k + j, config.rgba and (k + j) % 2 == 0)
            for j, empty in enumerate(choices)
        ]
    run(config, images, stall=stall, seed=int(10 * stall))


def cycles(empty: list[int], **options) -> Result:
    """Run an image of 2 × 2 whole groups, some of which are empty."""
    side = group_pixels(DEFAULT)
    given = image(DEFAULT, (2 * side, 2 * side), np.array(empty, bool))
    return run(DEFAULT, [replace(given, at=0)], **options)


@pytest.mark.parametrize("empty", [[0, 0, 0, 0], [1, 1, 1, 1], [0, 1, 1, 0]])
def test_pace(empty):
    """One beat is written per cycle."""
    assert 4 * (GROUP_CYCLES - 1) < cycles(empty).cycles <= 4 * GROUP_CYCLES + SLACK


def test_idle_time():
    """Spans of empty groups are written while no blocks of other groups come."""
    held = np.zeros(3 * GROUP_CYCLES, np.uint64)
    first = GROUP_CYCLES * 13 // 10
    for begin, end in ((0, 130), (143, 156), (169, 247)):  # percent of a group's cycles
        held[GROUP_CYCLES * begin // 100 : GROUP_CYCLES * end // 100] = 1
    found = cycles([1, 1, 0, 1], constants={"hold": held})
    assert found.cycles <= 4 * GROUP_CYCLES + SLACK + 3 * 8
    assert found.cycles < held.sum() + GROUP_CYCLES + 3 * GROUP_CYCLES - first
    late = cycles([0, 1, 0, 0], constants={"hold": np.append(np.ones(5000, np.uint64), 0)})
    assert late.cycles <= 5000 + 3 * GROUP_CYCLES + SLACK


def test_blocks_come_first():
    """No span of an empty group is begun while blocks are waiting."""
    held = 100
    rows = cycles([1, 0, 1, 0], constants={"hold": np.arange(held + 1) < held}).outputs["writes"]
    codes, side = axi.write_record(DEFAULT).unpack(rows), group_pixels(DEFAULT)
    own = image(DEFAULT, (2 * side, 2 * side), np.array([1, 0, 1, 0], bool))
    empty = codes["beat"].astype(int) % own.stride < side * PIXEL // axi.BEAT
    before = empty[: np.flatnonzero(~empty)[-1]]
    assert 0 < before.sum() <= (held // SPAN_CYCLES + 1) * SPAN_CYCLES
    assert not before[np.flatnonzero(~empty)[0] :].any()
