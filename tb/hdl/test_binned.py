"""Writing the work area: every byte at its address, and `empty` only while no write waits."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.hdl.binning.binned import WRITING, Binned
from splatcore.hdl.lib.record import AREA
from splatcore.spec.axi import BEAT
from splatcore.spec.binning import burst_record, group_record, groups_max
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.feature import feature_record
from splatcore.spec.record import Record
from splatcore.spec.work import FEATURE, SLOT
from tb.helpers.configs import other_port
from tb.helpers.memory_port import Writes
from tb.helpers.runs import compiled

PARTS = replace(other_port(TINY), name="PARTS", burst=2)
"""A machine whose bursts of entries are parts of the port's beats."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.parametrize("config", [DEFAULT, TINY, PARTS], ids=lambda config: config.name),
]

SPLATS, BURSTS, GROUPS = 301, 150, 45  # lines that are not full at the end
PLACES = {"features": 0x1000, "lists": 0x40000, "groups": 0x8000}  # beats
END = 4000  # the cycle of `finish`; nothing more comes then

SAMPLES = ("empty", *(f"writes__{n}__valid" for n in range(len(WRITING))))


def noise(rng: np.random.Generator, record: Record, count: int) -> np.ndarray:
    """Return random rows of a record, uint8 [count, size]."""
    rows = rng.integers(0, 256, (count, record.size), np.uint8)
    rows[:, -1] &= 255 >> 8 * record.size - record.width
    return rows


def placed(beat: int, rows: np.ndarray, size: int) -> dict[int, int]:
    """Return bytes by address: rows from `beat` on, each padded with zeros to `size` bytes."""
    padded = np.pad(rows, ((0, 0), (0, size - rows.shape[1])))
    return {BEAT * beat + n: int(value) for n, value in enumerate(padded.ravel())}


@pytest.mark.parametrize("stall", [0, 0.5, 0.9])
def test_work_area(config, stall):
    """Every byte of features, pages and the table of groups, with room for all features but one."""
    rng = np.random.default_rng(int(10 * stall))
    features = noise(rng, feature_record(config), SPLATS)
    groups = noise(rng, group_record(), min(GROUPS, groups_max(config)))
    record = burst_record(config)
    codes = record.unpack(noise(rng, record, BURSTS)) | {"address": rng.permutation(BURSTS)}
    result = compiled(Binned, config, samples=SAMPLES).run(
        {"features": features, "bursts": record.pack(codes), "groups": groups},
        constants={
            "area": AREA.const(PLACES).as_bits(), "clear": 0,
            "features_max": SPLATS - 1,
            "finish": np.append(np.zeros(END, np.uint64), np.uint64(1)),
        },
        stall=stall, seed=int(10 * stall), idle_max=END,
    )  # fmt: skip
    assert result.finished, result.stopped
    empty, *waiting = (result.samples[name].astype(bool) for name in SAMPLES)
    assert not empty[:END].all() and empty[-1] and result.ports["exceeded"] == 1
    for name in ("features", "groups"):
        assert not (empty & waiting[WRITING.index(name)]).any(), name
    pages = codes["slots"][np.argsort(codes["address"])].reshape(-1, 1).astype("<u8").view(np.uint8)
    expected = {
        "features": placed(PLACES["features"], features[:-1], FEATURE),
        "lists": placed(PLACES["lists"], pages[:, :SLOT], SLOT),
        "groups": placed(PLACES["groups"], groups, SLOT),
    }
    for n, name in enumerate(WRITING):
        address, value = Writes.of(config, result.outputs[f"writes__{n}"]).bytes()
        assert dict(zip(address.tolist(), value.tolist(), strict=True)) == expected[name], name
