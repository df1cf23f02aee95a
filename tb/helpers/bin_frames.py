"""Binning under test: frame registers as a stream, frames as rows, exact tiles."""

from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.golden.bin import Binned, Codes, Lists, bin_splats
from splatcore.golden.reference_tiles import TileLists
from splatcore.golden.reference_tiles import bin_splats as touched
from splatcore.hdl.binning.bin import COUNTED, Bin
from splatcore.hdl.lib.holds import holds
from splatcore.hdl.lib.record import layout
from splatcore.spec.binning import PAGE_BITS, burst_record, group_record
from splatcore.spec.config import Config
from splatcore.spec.convention import ALPHA_MIN, SIGMA_EXTENT, TILE
from splatcore.spec.feature import feature_record
from splatcore.spec.frame import POWER_SCALE
from splatcore.spec.group import SPLAT_BITS
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits
from splatcore.spec.point import splat_record
from splatcore.spec.record import Record
from tb.helpers.parts import forward
from tb.helpers.runs import Case, compiled, counters

SIZE_BITS = 13

SAMPLES = ("room", "finishing", "bursts__valid")

SETTLING = 2  # cycles between a frame's registers and its first splat

SIZES = {"splats": SPLAT_BITS, "width": SIZE_BITS, "height": SIZE_BITS, "pages": PAGE_BITS}
FRAME = Record("frame", {name: Bits(bits) for name, bits in SIZES.items()})
"""The registers of a frame and its number of splats."""

REPORT = Record("report", {"needed": Bits(PAGE_BITS)})  # result at the end of a frame


class BinFrames(wiring.Component):
    """`Bin` with logic that raises `finish` after a frame's last splat and begins the next frame.

    Members, in addition to those of `Bin`
        frames: stream of `FRAME`
        reports: stream of `REPORT`
        room: whether the queue of splats has room
        finishing: `Bin.finish`
    """

    def __init__(self, config: Config):
        self.inner = Bin(config)
        inner = self.inner.signature.members
        names = ("i", "features", "bursts", "groups", "counters")
        ports = {name: inner[name] for name in names}
        ports |= {
            "frames": In(stream.Signature(layout(FRAME))),
            "reports": Out(stream.Signature(layout(REPORT))),
            "room": Out(1),
            "finishing": Out(1),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        taken, released = Signal(SPLAT_BITS), Signal()
        settled = Signal(SETTLING)
        frame, more = self.frames.payload, Signal()
        forward(m, self, inner, ("features", "bursts", "groups", "counters"))
        for name in ("width", "height", "pages"):
            m.d.comb += getattr(inner, name).eq(frame[name])
        m.d.comb += [
            more.eq(settled[-1] & (taken != frame.splats)),
            inner.i.payload.eq(self.i.payload),
            inner.i.valid.eq(self.i.valid & more),
            self.i.ready.eq(inner.i.ready & more),
            self.room.eq(inner.outline.room),
            self.finishing.eq(inner.finish),
            inner.finish.eq(settled[-1] & ~more & ~released),
            self.reports.valid.eq(inner.done & ~released),
            self.reports.payload.needed.eq(inner.needed),
            self.frames.ready.eq(released & ~inner.done),
        ]
        waits = Cat(getattr(inner, name).valid for name in ("features", "bursts", "groups")).any()
        holds(m, "given", ~(inner.done & waits), "done before all outputs were taken")
        m.d.sync += settled.eq(Mux(self.frames.ready, 0, (settled << 1) | self.frames.valid))
        with m.If(inner.i.valid & inner.i.ready):
            m.d.sync += taken.eq(taken + 1)
        with m.If(self.reports.valid & self.reports.ready):
            m.d.sync += released.eq(1)
        with m.If(self.frames.ready):
            m.d.sync += [released.eq(0), taken.eq(0)]
        return m


@dataclass(frozen=True, eq=False)
class Frame:
    """Splats (codes [N] of `splat_record`), the image's size in pixels, and list pages."""

    splats: Codes
    width: int
    height: int
    pages: int = (1 << PAGE_BITS) - 1

    def __len__(self) -> int:
        return len(self.splats["u"])


def rows_in(config: Config, frames: list[Frame]) -> dict[str, np.ndarray]:
    """Rows of both input streams."""
    sizes = [(len(frame), frame.width, frame.height, frame.pages) for frame in frames]
    columns = np.array(sizes, np.uint64).T
    return {
        "i": np.concatenate([splat_record(config).pack(frame.splats) for frame in frames]),
        "frames": FRAME.pack(dict(zip(SIZES, columns, strict=True))),
    }


def rows_out(config: Config, results: list[Binned]) -> dict[str, np.ndarray]:
    """Rows of all output streams."""
    found = {"features": [], "bursts": [], "groups": [], "reports": []}
    for result in results:
        lists = result.lists
        found["features"].append(feature_record(config).pack(result.features))
        bursts = {"address": lists.address.astype(np.uint64), "slots": lists.slots}
        found["bursts"].append(burst_record(config).pack(bursts))
        groups = {"page": lists.page.astype(np.uint64), "count": lists.count.astype(np.uint64)}
        found["groups"].append(group_record().pack(groups))
        needed = np.array([lists.needed], np.uint64)
        found["reports"].append(REPORT.pack({"needed": needed}))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def bin_frame(config: Config, frame: Frame) -> Binned:
    """Bin a frame by the golden model."""
    return bin_splats(config, frame.splats, frame.width, frame.height, frame.pages)


def bin_case(config: Config, frames: list[Frame], results: list[Binned] | None = None) -> Case:
    """Frames one after the other. results: of the golden model, if known."""
    results = results or [bin_frame(config, frame) for frame in frames]
    return Case(rows_in(config, frames), rows_out(config, results))


def check(config: Config, frames: list[Frame], stall: float, seed: int = 0) -> tuple:
    """Compare all streams bit by bit, and the counters. Returns the run and the golden results."""
    results = [bin_frame(config, frame) for frame in frames]
    case, part = bin_case(config, frames, results), compiled(BinFrames, config, samples=SAMPLES)
    run = case.check(part, stall=stall, seed=seed)
    counted = counters(COUNTED, run.ports["counters"])
    blocked = counted.pop("blocked")
    assert not blocked if stall == 0 else blocked < run.cycles
    assert counted == {
        "splats": sum(map(len, frames)),
        "kept": sum(len(result.kept) for result in results),
        "rows": sum(result.rows for result in results),
        "entries": sum(len(result.group) for result in results),
        "bursts": len(case.expected["bursts"]),
    }
    return run, results


def read_lists(config: Config, lists: Lists) -> list[np.ndarray]:
    """Entries of each group, read from memory by following its pages."""
    per_page = config.page // config.burst
    memory = np.zeros((max(lists.needed, 1) * per_page, config.burst), np.uint64)
    assert len(np.unique(lists.address)) == len(lists.address)
    memory[lists.address] = lists.slots
    memory = memory.reshape(-1, config.page)
    read = []
    for page, count in zip(lists.page, lists.count, strict=True):
        slots = []
        while count > 0:
            slots.append(memory[page][: min(count, config.page - 1)])
            page, count = int(memory[page][-1]), count - (config.page - 1)
        read.append(np.concatenate([np.zeros(0, np.uint64), *slots]))
    return read


@dataclass(frozen=True, eq=False)
class Outlines:
    """Shapes of splats [N]: ellipses, or squares if they have a radius.

    centre: [N, 2], pixels
    conic, reach: [N, 3] A, B, C and [N] of Q = A·x² + 2·B·x·y + C·y² ≤ reach around the centre
    radius: [N] half sides of squares, pixels
    """

    centre: np.ndarray
    conic: np.ndarray
    reach: np.ndarray
    radius: np.ndarray | None = None

    @classmethod
    def of(cls, config: Config, splats: Codes) -> "Outlines":
        """Outlines of splats, from their codes, in float64."""
        pixel = 2.0**config.screen_exponent
        value = {name: config.arithmetic.decode(code) for name, code in splats.items()}
        across = value["power_across"] / POWER_SCALE / pixel**2
        along, shear = value["power_along"] / POWER_SCALE / pixel**2, value["shear"]
        conic = np.stack([across, -shear * across, along + shear * shear * across], axis=1)
        centre = np.stack([value["u"], value["v"]], axis=1) * pixel
        reach = -2 * np.log(ALPHA_MIN) - 2 * np.log(2) * OPACITY.step * value["attenuation"]
        a, b, c = conic.T
        covariance = np.stack([c, -b, a], axis=1) / (a * c - b * b)[:, None]
        return cls(
            centre, conic, reach, radii(covariance) if config.tile_test == "3sigma" else None
        )

    def touched(self, width: int, height: int) -> TileLists:
        """The tiles with a pixel's centre inside, of an image of this size."""
        last = np.array([width - 1, height - 1])
        if self.radius is None:
            a, b, c = self.conic.T
            reach = np.maximum(self.reach, 0)[:, None]
            half = np.sqrt(reach * np.stack([c, a], 1) / (a * c - b * b)[:, None])
            low = np.clip((self.centre - half) // TILE - 1, 0, last // TILE + 1)
            high = np.clip((self.centre + half) // TILE + 1, -1, last // TILE)
        else:
            first = np.ceil(np.maximum(self.centre - self.radius[:, None], 0))
            end = np.floor(np.minimum(self.centre + self.radius[:, None], last))
            low, high = first // TILE, np.where(first > end, -1, end // TILE)
        boxes = np.stack([low, high], axis=2).reshape(-1, 4).astype(np.int64)
        return touched(self, boxes, width, height, exact=self.radius is None)


def radii(covariance: np.ndarray) -> np.ndarray:
    """Half sides [N] of the original renderer's squares, for covariances [N, 3] xx, xy, yy."""
    xx, xy, yy = covariance.T
    return SIGMA_EXTENT * np.sqrt((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))


def found_tiles(config: Config, frame: Frame, found: Binned) -> tuple[np.ndarray, ...]:
    """Splat number in the frame, tile row and column of each pair found by binning, [N] each."""
    side, columns = config.group, -(-frame.width // (TILE * config.group))
    mask = found.entries["mask"].astype(np.int64)
    entry, place = np.nonzero(mask[:, None] >> np.arange(side * side) & 1)
    row, column = np.divmod(found.group[entry], columns)
    splat = found.kept[found.entries["splat"][entry].astype(np.int64)]
    return splat, row * side + place // side, column * side + place % side


def compare_tiles(
    config: Config, frame: Frame, found: Binned, outlines: Outlines | None = None,
    splats: np.ndarray | None = None,
) -> tuple[int, int]:  # fmt: skip
    """Compare the pairs found by binning with the exact ones.

    outlines: of `splats`
    splats: [N] numbers in the frame; default: all
    Returns the number of touching pairs, and how many of them binning has missed.
    """
    outlines = outlines or Outlines.of(config, frame.splats)
    splats = np.arange(len(frame)) if splats is None else splats
    exact, width = outlines.touched(frame.width, frame.height), frame.width
    columns = -(-width // TILE)
    tile = np.repeat(np.arange(len(exact.start) - 1), np.diff(exact.start))
    splat, row, column = found_tiles(config, frame, found)
    assert (column < columns).all()
    tiles = len(exact.start) - 1
    known = np.isin(splats[exact.splat] * tiles + tile, splat * tiles + row * columns + column)
    return len(tile), int((~known).sum())


def pairs(found: Binned) -> int:
    """Number of pairs of splats and tiles found by binning."""
    return int(np.bitwise_count(found.entries["mask"]).sum())
