"""Gathering slots into lines: each slot is written once, in order, in bursts of whole lines."""

import numpy as np
import pytest

from splatcore.hdl.memory.write_combiner import WriteCombiner
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, LINE, port_bytes
from splatcore.spec.config import Config
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Record
from splatcore.spec.work import FEATURE, SLOT
from tb.helpers.configs import PORTS
from tb.helpers.memory_port import Writes
from tb.helpers.runs import compiled

WORD = 8  # bytes of the words that slots consist of here
COUNT = 800

SIZES = (SLOT, FEATURE)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.parametrize("size", SIZES),
    pytest.mark.parametrize("config", PORTS.values(), ids=PORTS),
]


def address_bits(size: int) -> int:
    return BEAT_ADDRESS_BITS + (BEAT // size).bit_length() - 1


def addresses(rng: np.random.Generator, size: int) -> np.ndarray:
    """Return runs of adjacent addresses from anywhere, some with holes, some backwards."""
    found, end = [], 1 << address_bits(size)
    while len(found) < COUNT:
        first, length = rng.integers(0, end), rng.integers(1, 14)
        step = rng.choice([1, 1, 1, 2, 0, -1])
        found += list((first + step * np.arange(length)) % end)
    return np.array(found[:COUNT])


def lines(slot: np.ndarray, data: np.ndarray, size: int) -> list[dict[int, int]]:
    """Return the expected lines, each slot → data."""
    found, slots = [{int(slot[0]): int(data[0])}], LINE // size
    for address, value in zip(slot[1:].tolist(), data[1:].tolist(), strict=True):
        before = max(found[-1])
        if address // slots == before // slots and address > before:
            found[-1][address] = value
        else:
            found.append({address: value})
    return found


def written(config: Config, rows: np.ndarray, size: int) -> list[dict[int, int]]:
    """Return the lines written, each slot → first word; checks that a slot's words count up."""
    writes, count = Writes.of(config, rows), LINE // port_bytes(config)
    assert (writes.length == count).all() and (writes.first % LINE == 0).all()
    slots = writes.address[:, ::size] // size
    strobe = writes.strobe.reshape(*slots.shape, size)
    assert (strobe == strobe[..., :1]).all()
    words = writes.data.view("<u8").reshape(*slots.shape, -1)
    found = [{} for _ in range(len(rows) // count)]
    for k, place in zip(*np.nonzero(strobe[..., 0]), strict=True):
        first = int(words[k, place, 0])
        found[k // count][int(slots[k, place])] = first
        assert (words[k, place] == first + np.arange(size // WORD)).all()
    return found


def run(
    config: Config, size: int, slot: np.ndarray, flush, stall: float, count: int | None,
    seed: int = 0,
):  # fmt: skip
    """Run; returns the result, the data and the lines written."""
    data = np.random.default_rng(seed).integers(0, 1 << 62, len(slot))
    words = data[:, None] + np.arange(size // WORD)
    fields = {"slot": Bits(address_bits(size)), "data": Array(Bits(8 * WORD), size // WORD)}
    rows = Record("slot", fields).pack({"slot": slot, "data": words})
    expected = None if count is None else {"writes": count * LINE // port_bytes(config)}
    result = compiled(WriteCombiner, config, size, samples=("empty", "writes__valid")).run(
        {"i": rows}, constants={"flush": flush},
        expected=expected, stall=stall, seed=seed, idle_max=5000,
    )  # fmt: skip
    assert result.finished, result.stopped
    assert not (result.samples["empty"] & result.samples["writes__valid"]).any()
    return result, data, written(config, result.outputs["writes"], size)


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
def test_lines(config, size, stall):
    slot = addresses(np.random.default_rng(int(10 * stall)), size)
    slot[-1] = slot[-2] & -(LINE // size) ^ 1 << 10  # stays inside
    gathered = len(lines(slot, slot, size)) - 1
    result, data, found = run(config, size, slot, 0, stall, gathered, seed=int(10 * stall))
    expected = lines(slot, data, size)
    assert found == expected[:-1] and result.ports["empty"] == 0
    assert 0.2 * COUNT < gathered < 0.9 * COUNT


def test_flush(config, size):
    """Whenever a flush comes, every slot is written once and in order, and none stays inside."""
    rng = np.random.default_rng(3)
    for stall in (0, 0.5):
        slot = addresses(rng, size)
        flush = np.append(rng.random(4000) < 0.1, 1).astype(np.uint64)
        result, data, found = run(config, size, slot, flush, stall, None)
        assert result.ports["empty"] == 1
        pieces = [item for line in found for item in sorted(line.items())]
        assert pieces == [*zip(slot.tolist(), data.tolist(), strict=True)]


def test_pace(config, size):
    slots = LINE // size
    cycles = run(config, size, np.arange(COUNT), 0, 0, COUNT // slots)[0].cycles
    assert cycles < (slots + 1) / slots * COUNT + 8
