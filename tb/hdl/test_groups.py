"""The table of groups: every output in order, and empty groups ahead of the others."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from amaranth.hdl import Module, Value
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In

from splatcore.hdl.raster.groups import EMPTY_WAITING, TAKERS, Groups
from splatcore.hdl.raster.job import job_layout
from splatcore.sim.rtl.streams import Result
from splatcore.spec import axi
from splatcore.spec.binning import group_record
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.group import COUNT_BITS, group_grid
from splatcore.spec.raster import position_record
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


SIZES = {
    "DEFAULT": ((1920, 1080), (1, 1), (65, 129), (500, 64), (1280, 720)),
    "TINY": ((64, 64), (32, 32), (33, 64), (64, 1), (7, 40)),
}
SIZES["port"] = SIZES["DEFAULT"]

SAMPLES = ("positions__valid", "empty__valid")


@dataclass(frozen=True, eq=False)
class Frame:
    """An image: its size, the entries [groups] of its lists, and its table's address in beats."""

    size: tuple[int, int]
    count: np.ndarray
    at: int

    @property
    def table_beats(self) -> int:
        return -(-len(self.count) // 2)


@cache
def frames(name: str) -> list[Frame]:
    """Return images of each size with splats in no group, in all, in one at an end, in some."""
    rng, found, at, config = np.random.default_rng(0), [], 6, MACHINES[name]
    for size in SIZES[name]:
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


def slots(given: list[Frame]) -> np.ndarray:
    """Return memory's contents: the tables of frames, and noise around them."""
    rng = np.random.default_rng(0)
    found = rng.integers(0, 1 << 63, (2 * BEATS,), np.uint64)
    for frame in given:
        groups = len(frame.count)
        codes = {"page": pages(frame), "count": frame.count}
        codes["reserved"] = rng.integers(0, 1 << 4, groups)
        rows = table_record().pack(codes)
        found[2 * frame.at : 2 * frame.at + groups] = rows.view("<u8")[:, 0]
    return found


class Table(wiring.Component):
    """`Groups` on a memory with the tables of a machine's frames.

    Members, in addition to those of `Groups`
        pace: stream with one item per beat read
        bursts: stream of the requests
        hold: only empty groups are taken
    """

    def __init__(self, name: str):
        self.name, self.config = name, MACHINES[name]
        self.inner = Groups(self.config)
        members = dict(self.inner.signature.members)
        del members["data"]
        ports = {"bursts": members.pop("reads"), "pace": In(stream.Signature(1)), "hold": In(1)}
        self.same = [name for name in members if name not in TAKERS]
        super().__init__(members | ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        forward(m, self, inner, self.same)
        for name in TAKERS:
            outer, own = getattr(self, name), getattr(inner, name)
            m.d.comb += [outer.payload.eq(own.payload), outer.valid.eq(own.valid & ~self.hold)]
            m.d.comb += own.ready.eq(outer.ready & ~self.hold)
        bytes_ = slots(frames(self.name)).tobytes()
        size = self.config.port // 8
        init = [int.from_bytes(bytes_[k : k + size], "little") for k in range(0, 16 * BEATS, size)]
        m.submodules.memory = memory = Memory(shape=self.config.port, depth=len(init), init=init)
        read = memory.read_port(domain="comb")

        def content(number: Value) -> Value:
            m.d.comb += read.addr.eq(number)
            return read.data

        answer_reads(m, self.config, inner, self.bursts, self.pace, IN_FLIGHT, content)
        return m


def pages(frame: Frame) -> np.ndarray:
    """Return the first pages of all groups, also of empty ones."""
    return (np.arange(len(frame.count)) * 7919 + frame.at) % (1 << 16)


def outputs(config: Config, frame: Frame) -> dict[str, np.ndarray]:
    """Return the expected rows of the output streams."""
    row, column = np.divmod(np.arange(len(frame.count)), group_grid(config, *frame.size)[1])
    some = frame.count > 0
    rows = position_record(config).pack({"column": column, "row": row})
    codes = {"page": pages(frame)[some], "count": frame.count[some]}
    found = dict.fromkeys(("positions", "pixels"), rows[some])
    return found | {"empty": rows[~some], "lists": group_record().pack(codes)}


def check_bursts(config: Config, frame: Frame, rows: np.ndarray):
    """Check that a frame's table is read whole in bursts, and per group in single beats."""
    codes, wide = axi.read_record().unpack(rows), axi.port_beats(config)
    first, length = codes["beat"].astype(int) // wide, codes["length"].astype(int)
    read = np.concatenate([np.arange(b, b + n + 1) for b, n in zip(first, length, strict=True)])
    expected, at = np.zeros(BEATS, int), frame.at // wide
    np.add.at(expected, at + np.arange(len(frame.count)) // (2 * wide), 1)
    expected[at : at + -(-frame.table_beats // wide)] += 1
    assert np.array_equal(np.bincount(read, minlength=BEATS), expected)


def arguments(config: Config, frame: Frame) -> dict:
    """The inputs of a run; enough of `pace`."""
    fields = {"width": frame.size[0], "height": frame.size[1], "area": {"groups": frame.at}}
    job = job_layout(config).const(fields).as_bits()
    pace = np.zeros((frame.table_beats + len(frame.count), 1), np.uint8)
    return {"inputs": {"pace": pace}, "constants": {"job": job, "start": np.array([1, 0])}}


def run(name: str, frame: Frame, stall: float = 0, seed: int = 0) -> Result:
    config, table = MACHINES[name], compiled(Table, name, samples=SAMPLES)
    given = arguments(config, frame)
    case = Case(given["inputs"], outputs(config, frame), given["constants"] | {"hold": 0})
    found = case.check(table, stall=stall, seed=seed)
    check_bursts(config, frame, found.outputs["bursts"])
    assert found.ports["groups"] == len(frame.count)
    return found


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
@pytest.mark.parametrize("name", MACHINES)
def test_tables(name, stall):
    """Images from one group to the machine's maximum."""
    for seed, frame in enumerate(frames(name)[int(10 * stall) % 3 :: 2]):
        run(name, frame, stall, seed)


def test_empty_groups_come_early():
    """All empty groups come while no other group is taken, however many are in between."""
    frame = next(f for f in frames("DEFAULT") if 0 < (f.count == 0).sum() < 100)
    expected, given = outputs(DEFAULT, frame)["empty"], arguments(DEFAULT, frame)
    given["constants"] |= {"hold": 1}
    found = compiled(Table, "DEFAULT", samples=SAMPLES).run(
        **given, expected={"empty": len(expected)}, idle_max=100
    )
    assert np.array_equal(found.outputs["empty"], expected) and len(expected) > EMPTY_WAITING
    assert all(not len(found.outputs[name]) for name in TAKERS)


def test_pace():
    """Groups with entries come once per cycle, empty ones every 4 cycles, plus a gap per burst."""
    for name, a_group, a_burst in (("positions", 1, 12), ("empty", 4, 24)):
        frame = next(f for f in frames("DEFAULT") if (f.count > 0).all() == (name != "empty")
                     and (f.count > 0).any() == (name != "empty"))  # fmt: skip
        given = np.flatnonzero(run("DEFAULT", frame).samples[f"{name}__valid"])
        groups, bursts = len(frame.count), -(-frame.table_beats // axi.BURST_BEATS)
        assert groups <= given[-1] - given[0] + 1 <= groups * a_group + bursts * a_burst
