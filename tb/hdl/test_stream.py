"""Stream primitives: latency, throughput, capacity and level in cycles, under stalls."""

import gc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from splatcore.hdl.lib.stream import MEMORY_DEPTH_MIN, Fork, Pipe, Queue
from tb.helpers.runs import compiled
from tb.stages.primitives import ITEMS, PROMISES, Primitives, Promise, items

HELD = 40  # cycles for which outputs are stalled

LEVELS = tuple(f"{name}__level" for name in PROMISES if name[:5] in ("queue", "memor"))


@cache
def run(held: int, stall: float = 0) -> dict[str, np.ndarray]:
    """Run all parts; the samples of their transfers and levels."""
    part = compiled(Primitives, samples=("comes", "goes", *LEVELS))
    constants = {"hold": np.repeat([1, 0], [held, 1])}
    return items().check(part, stall=stall, constants=constants).samples


def transfers(name: str, held: int, stall: float = 0) -> tuple[np.ndarray, np.ndarray]:
    """One bit per cycle: an item enters, an item leaves."""
    place = list(PROMISES).index(name)
    return tuple(run(held, stall)[way].astype(int) >> place & 1 for way in ("comes", "goes"))


def check(name: str, promise: Promise):
    """Without stalls an item comes out every `pace` cycles, `latency` cycles after its input. With
    a stalled output exactly `capacity` items fit; afterwards all leave without a gap."""
    steps = np.arange(ITEMS) * promise.pace
    comes, goes = (np.flatnonzero(bits) for bits in transfers(name, 0))
    np.testing.assert_array_equal(comes, comes[0] + steps)
    np.testing.assert_array_equal(goes, comes[0] + promise.latency + steps)
    comes, goes = transfers(name, HELD)
    assert comes[:HELD].sum() == promise.capacity
    np.testing.assert_array_equal(np.flatnonzero(goes), HELD + steps)


@pytest.mark.slow
@pytest.mark.parametrize("stall", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("level", LEVELS)
def test_level(level, stall):
    """In every cycle it is the number of items inside."""
    comes, goes = transfers(level.removesuffix("__level"), 0, stall)
    np.testing.assert_array_equal(run(0, stall)[level][1:], np.cumsum(comes - goes)[:-1])


@pytest.mark.slow
@pytest.mark.parametrize("name", PROMISES)
def test_promises(name):
    check(name, PROMISES[name])


@pytest.mark.slow
@pytest.mark.parametrize("promise", ["latency", "pace", "capacity"])
@pytest.mark.parametrize("name", ["pipe_4", "slot", "queue_5", "memory_3"])
def test_broken_promise_is_found(name, promise):
    wrong = {promise: getattr(PROMISES[name], promise) - 1}
    with pytest.raises(AssertionError):
        check(name, replace(PROMISES[name], **wrong))


@pytest.mark.slow
def test_a_wrong_bit_is_named():
    case = items()
    case.expected["queue_5__o"] = case.expected["queue_5__o"].copy()
    case.expected["queue_5__o"][ITEMS // 2, 0] ^= 1
    part = compiled(Primitives, samples=("comes", "goes", *LEVELS))
    with pytest.raises(AssertionError, match=f"queue_5__o: 1 differ, first {ITEMS // 2}"):
        case.check(part)


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
@pytest.mark.parametrize(
    "make",
    [
        lambda: Queue(8, 1),
        lambda: Queue(8, MEMORY_DEPTH_MIN - 1, memory=True),
        lambda: Fork(8, 0),
        lambda: Pipe(0),
    ],
)
def test_impossible_sizes(make):
    with pytest.raises(ValueError, match="below"):
        make()
    gc.collect()  # or Amaranth warns of the unused component during some other test
