"""Gathering slots to lines."""

import numpy as np
import pytest

from splatcore.hdl.memory.write_combiner import SLOTS, WriteCombiner
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, LINE, LINE_BEATS, port_bytes, write_record
from splatcore.spec.config import Config
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from splatcore.spec.work import SLOT
from tb.helpers.ports import PORTS
from tb.helpers.runs import compiled

ADDRESS_BITS = BEAT_ADDRESS_BITS + 1
RECORD = Record("slot", {"slot": Bits(ADDRESS_BITS), "data": Bits(64)})
COUNT = 800

pytestmark = pytest.mark.slow


def addresses(rng: np.random.Generator) -> np.ndarray:
    """Runs of neighbours from anywhere, some with holes, some backwards."""
    found = []
    while len(found) < COUNT:
        first, length = rng.integers(0, 1 << ADDRESS_BITS), rng.integers(1, 14)
        step = rng.choice([1, 1, 1, 2, 0, -1])
        found += list((first + step * np.arange(length)) % (1 << ADDRESS_BITS))
    return np.array(found[:COUNT])


def lines(slot: np.ndarray, data: np.ndarray) -> list[dict[int, int]]:
    """Lines gathered, slot → data."""
    found = [{int(slot[0]): int(data[0])}]
    for address, value in zip(slot[1:].tolist(), data[1:].tolist(), strict=True):
        before = max(found[-1])
        if address // SLOTS == before // SLOTS and address > before:
            found[-1][address] = value
        else:
            found.append({address: value})
    return found


def written(config: Config, rows: np.ndarray) -> list[dict[int, int]]:
    """Lines written by bursts, slot → data."""
    codes, count = write_record(config).unpack(rows), LINE // port_bytes(config)
    assert (codes["length"] == count - 1).all() and len(rows) % count == 0
    beat = codes["beat"].astype(np.int64).reshape(-1, count)
    assert (beat == beat[:, :1]).all() and (beat % LINE_BEATS == 0).all()
    slots = port_bytes(config) // SLOT  # of a beat
    first = (beat * (BEAT // SLOT) + slots * np.arange(count)).reshape(-1)
    found = [{} for _ in range(len(rows) // count)]
    for place in range(slots):
        strobe = codes["strobe"] >> 8 * place & 0xFF
        assert np.isin(strobe, (0, 0xFF)).all()
        for k in np.flatnonzero(strobe):
            found[k // count][int(first[k] + place)] = int(codes[f"data{place}"][k])
    return found


def run(config: Config, slot: np.ndarray, flush, stall: float, count: int | None, seed: int = 0):
    """A run and what it has written."""
    data = np.random.default_rng(seed).integers(0, 1 << 63, len(slot))
    expected = None if count is None else {"writes": count * LINE // port_bytes(config)}
    result = compiled(WriteCombiner, config, samples=("empty", "writes__valid")).run(
        {"i": RECORD.pack({"slot": slot, "data": data})}, constants={"flush": flush},
        expected=expected, stall=stall, seed=seed, idle_max=5000,
    )  # fmt: skip
    assert result.finished, result.stopped
    assert not (result.samples["empty"] & result.samples["writes__valid"]).any()
    return result, data, written(config, result.outputs["writes"])


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
def test_lines(config, stall):
    slot = addresses(np.random.default_rng(int(10 * stall)))
    slot[-1] = slot[-2] & -SLOTS ^ 1 << 10  # stays inside
    gathered = len(lines(slot, slot)) - 1
    result, data, found = run(config, slot, 0, stall, gathered, seed=int(10 * stall))
    expected = lines(slot, data)
    assert found == expected[:-1] and result.ports["empty"] == 0
    assert 0.2 * COUNT < gathered < 0.9 * COUNT


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
def test_flush(config):
    """Whenever it comes, every slot is written once and in order, and none stays inside."""
    rng = np.random.default_rng(3)
    for stall in (0, 0.5):
        slot = addresses(rng)
        flush = np.append(rng.random(4000) < 0.1, 1).astype(np.uint64)
        result, data, found = run(config, slot, flush, stall, None)
        assert result.ports["empty"] == 1
        pieces = [item for line in found for item in sorted(line.items())]
        assert pieces == [*zip(slot.tolist(), data.tolist(), strict=True)]


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
def test_pace(config):
    cycles = run(config, np.arange(COUNT), 0, 0, COUNT // SLOTS)[0].cycles
    assert cycles < 1.25 * COUNT + 8
