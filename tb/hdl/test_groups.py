"""The table of groups: every output in order, and empty groups ahead of the others."""

from dataclasses import dataclass

import numpy as np
import pytest
from amaranth.hdl import Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In

from splatcore.hdl.lib.record import layout
from splatcore.hdl.raster.groups import EMPTY_WAITING, TAKERS, Groups
from splatcore.sim.rtl.streams import Result, Simulation
from splatcore.spec import axi
from splatcore.spec.binning import group_record
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.group import COUNT_BITS, group_grid
from splatcore.spec.number import Bits
from splatcore.spec.raster import position_record
from splatcore.spec.record import Record
from splatcore.spec.work import table_record
from tb.helpers.configs import other_port
from tb.helpers.memory_port import answer_reads
from tb.helpers.parts import forward
from tb.helpers.runs import Case, compiled

pytestmark = pytest.mark.slow

BEATS = 1 << 12  # of the memory
IN_FLIGHT = 4  # bursts that it accepts before it answers the first one
MACHINES = {"DEFAULT": DEFAULT, "TINY": TINY, "port": other_port(DEFAULT)}
OUTPUTS = (*TAKERS, "empty")


def stored_record(config: Config) -> Record:
    """A beat of the port as stored in memory, and its number."""
    words = {f"data{k}": Bits(64) for k in range(config.port // 64)}
    return Record("stored", {"number": Bits(axi.BEAT_ADDRESS_BITS)} | words)


def frame_record(config: Config) -> Record:
    """A frame's inputs of `Groups`."""
    sizes = {"width": config.width_max, "height": config.height_max}
    fields = {name: Bits(size.bit_length()) for name, size in sizes.items()}
    fields |= {"groups_at": Bits(axi.BEAT_ADDRESS_BITS)}
    return Record("frame", fields)


class Table(wiring.Component):
    """`Groups` on a memory, frame after frame: the next one starts when it is no longer busy.

    Members, in addition to the output streams of `Groups`
        stored: stream of the memory's contents
        frames: stream of `frame_record`
        pace: stream with one item per beat read
        bursts: stream of the requests
        hold: only empty groups are taken
        groups: number of groups of the frame
    """

    def __init__(self, config: Config):
        self.inner, self.record = Groups(config), layout(frame_record(config))
        self.config = config
        members = self.inner.signature.members
        ports = {name: members[name] for name in (*OUTPUTS, "groups")} | {
            "bursts": members["reads"],
            "stored": In(stream.Signature(layout(stored_record(config)))),
            "frames": In(stream.Signature(self.record)),
            "pace": In(stream.Signature(1)),
            "hold": In(1),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        forward(m, self, inner, ("empty", "groups"))
        for name in TAKERS:
            outer, own = getattr(self, name), getattr(inner, name)
            m.d.comb += [outer.payload.eq(own.payload), outer.valid.eq(own.valid & ~self.hold)]
            m.d.comb += own.ready.eq(outer.ready & ~self.hold)
        frame, was_busy, free = Signal(self.record), Signal(), Signal(init=1)
        m.d.comb += [self.frames.ready.eq(free & ~inner.start)]
        m.d.sync += [inner.start.eq(self.frames.valid & self.frames.ready)]
        m.d.sync += was_busy.eq(inner.busy)
        with m.If(self.frames.valid & self.frames.ready):
            m.d.sync += [frame.eq(self.frames.payload), free.eq(0)]
        with m.Elif(was_busy & ~inner.busy):
            m.d.sync += free.eq(1)
        m.d.comb += [inner.job[name].eq(frame[name]) for name in ("width", "height")]
        m.d.comb += inner.job.area.groups.eq(frame.groups_at)
        m.submodules.memory = memory = Memory(shape=self.config.port, depth=BEATS, init=[])
        write, read = memory.write_port(), memory.read_port(domain="comb")
        stored = self.stored.payload
        m.d.comb += [
            self.stored.ready.eq(1),
            write.en.eq(self.stored.valid),
            write.addr.eq(stored.number),
            write.data.eq(stored.as_value()[-self.config.port :]),
        ]

        def content(number: Value) -> Value:
            m.d.comb += read.addr.eq(number)
            return read.data

        answer_reads(m, self.config, inner, self.bursts, self.pace, IN_FLIGHT, content)
        return m


@dataclass(frozen=True, eq=False)
class Frame:
    """An image: its size, the entries [groups] of its lists, and its table's address in beats."""

    size: tuple[int, int]
    count: np.ndarray
    at: int

    @property
    def table_beats(self) -> int:
        return -(-len(self.count) // 2)


def table(config: Config) -> Simulation:
    return compiled(Table, config, samples=("positions__valid", "empty__valid"))


def frames(config: Config, sizes, seed: int = 0) -> list[Frame]:
    """Return images of each size with splats in no group, in all, in one at an end, in some."""
    rng, found, at = np.random.default_rng(seed), [], 6
    for size in sizes:
        groups = int(np.prod(group_grid(config, *size)))
        number = np.arange(groups)
        runs = np.repeat(rng.random(groups) < 0.5, rng.integers(1, 60, groups))[:groups]
        few = rng.random(groups) < 0.1
        for some in (number < 0, number >= 0, number == 0, number == groups - 1, runs, few, ~few):
            count = np.where(some, rng.integers(1, 1 << COUNT_BITS, groups), 0)
            found.append(Frame(size, count, at))
            at += found[-1].table_beats + int(rng.integers(0, 9))
            at += at % 2  # alignment of the widest port
    assert at < BEATS
    return found


def inputs(config: Config, given: list[Frame], seed: int) -> dict[str, np.ndarray]:
    """Return the rows of the input streams: tables with noise around them; enough of `pace`."""
    rng = np.random.default_rng(seed)
    slots = rng.integers(0, 1 << 63, (2 * BEATS,), np.uint64)
    for frame in given:
        groups = len(frame.count)
        codes = {
            "page": pages(frame),
            "count": frame.count,
            "reserved": rng.integers(0, 1 << 4, groups),
        }
        rows = table_record().pack(codes)
        slots[2 * frame.at : 2 * frame.at + groups] = rows.view("<u8")[:, 0]
    words = config.port // 64
    stored = {"number": np.arange(2 * BEATS // words)}
    stored |= {f"data{k}": slots[k::words] for k in range(words)}
    codes = {
        "width": np.array([frame.size[0] for frame in given]),
        "height": np.array([frame.size[1] for frame in given]),
        "groups_at": np.array([frame.at for frame in given]),
    }
    pace = sum(frame.table_beats + len(frame.count) for frame in given)
    return {
        "stored": stored_record(config).pack(stored),
        "frames": frame_record(config).pack(codes),
        "pace": np.zeros((pace, 1), np.uint8),
    }


def pages(frame: Frame) -> np.ndarray:
    """Return the first pages of all groups, also of empty ones."""
    return (np.arange(len(frame.count)) * 7919 + frame.at) % (1 << 16)


def outputs(config: Config, given: list[Frame]) -> dict[str, np.ndarray]:
    """Return the expected rows of the output streams."""
    found = {name: [] for name in OUTPUTS}
    for frame in given:
        number = np.arange(len(frame.count))
        row, column = np.divmod(number, group_grid(config, *frame.size)[1])
        some = frame.count > 0
        position = {"column": column, "row": row}
        rows = position_record(config).pack(position)
        for name in ("positions", "pixels"):
            found[name].append(rows[some])
        found["empty"].append(rows[~some])
        codes = {"page": pages(frame)[some], "count": frame.count[some]}
        found["lists"].append(group_record().pack(codes))
    return {name: np.concatenate(rows) for name, rows in found.items()}


def check_bursts(config: Config, given: list[Frame], rows: np.ndarray):
    """Check that each frame's table is read whole in bursts, and per group in single beats."""
    codes, wide = axi.read_record().unpack(rows), axi.port_beats(config)
    first, length = codes["beat"].astype(int) // wide, codes["length"].astype(int)
    read = np.concatenate([np.arange(b, b + n + 1) for b, n in zip(first, length, strict=True)])
    expected = np.zeros(BEATS, int)
    for frame in given:
        number = np.arange(len(frame.count))
        at = frame.at // wide
        np.add.at(expected, at + number // (2 * wide), 1)
        expected[at : at + -(-frame.table_beats // wide)] += 1
    assert np.array_equal(np.bincount(read, minlength=BEATS), expected)


def run(config: Config, given: list[Frame], stall: float = 0, seed: int = 0) -> Result:
    rows = inputs(config, given, seed)
    case = Case(rows, outputs(config, given), {"hold": 0}, first=["stored"])
    found = case.check(table(config), stall=stall, seed=seed)
    check_bursts(config, given, found.outputs["bursts"])
    assert found.ports["groups"] == len(given[-1].count)
    return found


SIZES = {
    "DEFAULT": ((1920, 1080), (1, 1), (65, 129), (500, 64), (1280, 720)),
    "TINY": ((64, 64), (32, 32), (33, 64), (64, 1), (7, 40)),
}
SIZES["port"] = SIZES["DEFAULT"]


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
@pytest.mark.parametrize("name", MACHINES)
def test_tables(name, stall):
    """Frame after frame, with images from one group to the machine's maximum."""
    config = MACHINES[name]
    given = frames(config, SIZES[name], int(10 * stall))
    run(config, given, stall, int(10 * stall))


def test_empty_groups_come_early():
    """All empty groups come while no other group is taken, however many are in between."""
    frame = next(f for f in frames(DEFAULT, SIZES["DEFAULT"][:1]) if 0 < (f.count == 0).sum() < 100)
    expected = outputs(DEFAULT, [frame])["empty"]
    found = table(DEFAULT).run(
        inputs(DEFAULT, [frame], 0), constants={"hold": 1}, first=["stored"],
        expected={"empty": len(expected)}, idle_max=100,
    )  # fmt: skip
    assert np.array_equal(found.outputs["empty"], expected) and len(expected) > EMPTY_WAITING
    assert all(not len(found.outputs[name]) for name in TAKERS)


def test_pace():
    """Groups with entries come once per cycle, empty ones every 4 cycles, plus a gap per burst."""
    size, groups = (1920, 1024), 30 * 16
    bursts = -(-groups // 2 // axi.BURST_BEATS)
    for name, entries, a_group, a_burst in (("positions", 1, 1, 12), ("empty", 0, 4, 24)):
        found = run(DEFAULT, [Frame(size, np.full(groups, entries), 16)])
        given = np.flatnonzero(found.samples[f"{name}__valid"])
        assert groups <= given[-1] - given[0] + 1 <= groups * a_group + bursts * a_burst
