"""The whole of stage 2 with zero-latency memory, and rows of its streams, for measurements and
tests."""

from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.golden.sort import Job, Round, jobs, sort
from splatcore.hdl.lib.record import layout
from splatcore.hdl.sorting.deal import Deal
from splatcore.hdl.sorting.sort import Sort
from splatcore.spec.binning import group_record
from splatcore.spec.config import Config
from splatcore.spec.group import SPLAT_BITS, entry_record, sorted_record
from splatcore.spec.record import Codes
from splatcore.spec.sort import LINE_SLOTS, half_entries, line_record

Rows = dict[str, np.ndarray]


def random_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random.integers(0, 1 << bits, count, dtype=np.uint64)


def clustered_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    """Keys with few values in the upper half of the bits and any value in the lower half."""
    low = bits // 2
    clusters = random_keys(bits - low, 1 + count // 16, random)
    return random.choice(clusters, count) << np.uint64(low) | random_keys(low, count, random)


KEYS = {
    "random": random_keys,
    "equal": lambda bits, count, random: np.full(count, random.integers(0, 1 << bits), np.uint64),
    "sorted": lambda *asked: np.sort(random_keys(*asked)),
    "reversed": lambda *asked: np.sort(random_keys(*asked))[::-1].copy(),
    "clustered": clustered_keys,
}
"""Kinds of keys: (bits, count, random generator) → keys [count] of `bits` bits."""


def entries_of(config: Config, kind: str, counts: np.ndarray, seed: int = 0) -> Codes:
    """Random entries for groups of `counts` [G] entries, with keys of a kind."""
    random, total = np.random.default_rng(seed), int(np.sum(counts))
    keys = [KEYS[kind](config.sort_key_bits, int(count), random) for count in counts]
    return {
        "key": np.concatenate([np.zeros(0, np.uint64), *keys]),
        "splat": random.integers(0, 1 << SPLAT_BITS, total, dtype=np.uint32),
        "mask": random.integers(0, 1 << config.group**2, total, dtype=np.uint32),
    }


@dataclass(frozen=True, eq=False)
class SortRows:
    """Rows for stage 2's input streams, and the expected rows of its output streams."""

    inputs: Rows
    expected: Rows

    @property
    def counts(self) -> dict[str, int]:
        return {name: len(rows) for name, rows in self.expected.items()}


def stage_rows(config: Config, counts: np.ndarray, entries: Codes) -> SortRows:
    """Rows of `SortStage` for lists of `counts` [G] entries, in order of arrival."""
    packed, ends = entry_record(config).pack(entries), np.cumsum(counts).astype(int)
    lists = np.split(np.arange(len(packed)), ends[:-1])
    found = list(jobs(config, [entries["key"][indices] for indices in lists]))
    short = [indices for indices, f in zip(lists, found, strict=True) if isinstance(f, Job)]
    long = [indices for indices, f in zip(lists, found, strict=True) for _ in rounds_of(f)]
    none = np.zeros(0, int)
    groups = group_record().pack({"page": np.arange(len(lists)), "count": np.asarray(counts)})
    return SortRows(
        {
            "groups": groups,
            "short": packed[np.concatenate([none, *short])],
            "long": packed[np.concatenate([none, *long])],
        },
        {"o": sorted_record(config).pack(sort(counts, np.ones(len(counts)), entries))},
    )


def rounds_of(found: Job | list[Round]) -> list[Round]:
    """The rounds of dealing of a list; none if it fits on chip."""
    return [] if isinstance(found, Job) else found


class SortStage(wiring.Component):
    """Dealing, scratch memory and sorting.

    Members
        groups: stream of `group_record`
        short: stream of `entry_record`, the entries of lists that fit on chip
        long: stream of `entry_record`, the entries of longer lists, once per round of dealing
        stop: the rest of the current group's output is not needed
        o: stream of `sorted_record`

    **Timing**: as its parts; memory delivers one entry per cycle without latency.
    """

    def __init__(self, config: Config):
        self.config = config
        entry = layout(entry_record(config))
        ports = {
            "groups": In(stream.Signature(layout(group_record()))),
            "short": In(stream.Signature(entry)),
            "long": In(stream.Signature(entry)),
            "stop": In(1),
            "o": Out(stream.Signature(layout(sorted_record(config)))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.deal, m.submodules.sort = deal, sort = Deal(self.config), Sort(self.config)
        connect(m, flipped(self).groups, deal.groups)
        connect(m, flipped(self).long, deal.entries)
        connect(m, deal.jobs, sort.jobs)
        connect(m, sort.o, flipped(self).o)
        m.d.comb += [deal.released.eq(sort.released), sort.stop.eq(self.stop)]
        m.d.comb += [deal.reading.ready.eq(1), deal.settled.eq(1)]
        lines = 1 << line_record(self.config)["address"].width
        line, half = layout(line_record(self.config))["slots"].shape, half_entries(self.config)
        m.submodules.scratch = scratch = Memory(shape=line, depth=lines, init=[])
        write, read = scratch.write_port(), scratch.read_port(domain="comb")
        list_, place, left = deal.lists, Signal(range(lines * LINE_SLOTS)), Signal(range(half + 1))
        dealt = Signal()
        m.d.comb += [
            deal.lines.ready.eq(1),
            write.en.eq(deal.lines.valid),
            write.addr.eq(deal.lines.payload.address),
            write.data.eq(deal.lines.payload.slots),
            read.addr.eq(place >> (LINE_SLOTS - 1).bit_length()),
            sort.entries.valid.eq(left.any() & (dealt | self.short.valid)),
            sort.entries.payload.eq(
                Mux(dealt, read.data[place % LINE_SLOTS], Cat(self.short.payload))
            ),
            self.short.ready.eq(sort.entries.ready & left.any() & ~dealt),
            list_.ready.eq(~left.any()),
        ]
        with m.If(list_.ready & list_.valid):
            m.d.sync += [left.eq(list_.payload.count), dealt.eq(list_.payload.dealt)]
            m.d.sync += place.eq(list_.payload.page * half)
        with m.Elif(sort.entries.valid & sort.entries.ready):
            m.d.sync += [left.eq(left - 1), place.eq(place + 1)]
        return m
