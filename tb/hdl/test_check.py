"""The check of a frame's registers against plain integers, on both sides of every limit."""

import numpy as np
import pytest

from splatcore.hdl.points.check import LATENCY, Check
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from splatcore.spec.registers import ALIGNED, ErrorCode, frame_registers
from splatcore.spec.work import PIXEL, STRIDE_ALIGNMENT, WORK_ALIGNMENT, scratch_bytes, work
from tb.helpers.configs import ALPHA
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow

TOP = 1 << 32
Frame = dict[str, int]


def found(config: Config, frames: list[Frame]) -> list[tuple[int, int]]:
    """Return error and detail per frame, whose registers are held for `LATENCY` cycles."""
    registers = frame_registers(config)
    record = Record("frame", {register.name: Bits(register.width) for register in registers})
    codes = {r.name: np.array([f.get(r.name, 0) for f in frames], np.uint64) for r in registers}
    given, names = np.repeat(record.pack(codes), LATENCY, axis=0), ("error", "detail")
    result = compiled(Check, config, samples=names).run({}, constants={"frame": given})
    end = len(given) + 1
    samples = [result.samples[name][LATENCY:end:LATENCY].tolist() for name in names]
    return list(zip(*samples, strict=True))


def expected(config: Config, frame: Frame) -> tuple[int, int]:
    """Return the first error and its detail, by plain integers."""
    names = [register.name for register in frame_registers(config)]
    side = 16 * config.group
    most = -(-config.width_max // side) * -(-config.height_max // side)
    groups = -(-frame["WIDTH"] // side) * -(-frame["HEIGHT"] // side)
    pixel = 4 if frame.get("FORMAT") else PIXEL
    sizes = (
        not 0 < frame["WIDTH"] <= config.side_max or groups > most,
        not 0 < frame["HEIGHT"] <= config.side_max,
        frame["STRIDE"] % STRIDE_ALIGNMENT or frame["STRIDE"] < frame["WIDTH"] * pixel,
    )
    for number, wrong in enumerate(sizes):
        if wrong:
            return ErrorCode.SIZE, number
    for name, alignment in ALIGNED.items():
        if frame[name] % alignment:
            return ErrorCode.ALIGNMENT, names.index(name)
    area = work(config, frame["LISTS_PAGES"], frame["FEATURES_MAX"])
    behind = frame["WORK_AREA"]
    ends = {
        "GROUPS": frame["GROUPS"] + behind + area.lists,
        "LISTS": frame["LISTS"] + behind + area.features - area.lists,
        "FEATURES": frame["FEATURES"] + behind + area.size - area.features,
        "SCRATCH": frame["SCRATCH"] + scratch_bytes(config),
        "PIXELS": frame["PIXELS"] + frame["HEIGHT"] * frame["STRIDE"],
    }
    for name, end in ends.items():
        if end > TOP:
            return ErrorCode.RANGE, names.index(name)
    return ErrorCode.NONE, 0


def good(config: Config) -> Frame:
    """Return a valid frame, without alpha."""
    stride = config.width_max * PIXEL // STRIDE_ALIGNMENT * STRIDE_ALIGNMENT + STRIDE_ALIGNMENT
    frame = dict.fromkeys(ALIGNED, WORK_ALIGNMENT)
    frame |= {"WIDTH": config.width_max, "HEIGHT": config.height_max, "STRIDE": stride}
    return frame | {"LISTS_PAGES": 1000, "FEATURES_MAX": 1000, "MODEL": TOP - 64}


def around(config: Config, rng: np.random.Generator) -> list[Frame]:
    """Return frames with one area that ends at the last address, or one step before or behind."""
    frame, steps = good(config), (-1, 0, 1)
    unit = WORK_ALIGNMENT
    pages = [*rng.integers(0, 1 << 20, 40).tolist(), 0, 1, 3, 4, 5, (1 << 20) - 1]
    features = [*rng.integers(0, 1 << 24, 40).tolist(), 0, 1, 127, 128, 129, (1 << 24) - 1]
    frames = []
    for name, count, values in (
        ("LISTS", "LISTS_PAGES", pages),
        ("FEATURES", "FEATURES_MAX", features),
        ("GROUPS", "LISTS_PAGES", [7] * 20),
    ):
        for value in values:
            area = work(config, value, value)
            lists, features = area.features - area.lists, area.size - area.features
            size = {"LISTS": lists, "FEATURES": features, "GROUPS": area.lists}[name]
            behind = int(rng.integers(0, (TOP - size) // unit)) * unit
            at = {name: TOP - size - behind, "WORK_AREA": behind, count: value}
            frames += [frame | at | {name: at[name] + k * unit} for k in steps]
            frames += [frame | at | {"WORK_AREA": behind + k * unit} for k in steps]
            frames += [frame | at | {count: max(value + k, 0)} for k in steps]
    scratch = TOP - scratch_bytes(config)
    frames += [frame | {"SCRATCH": scratch + k * unit} for k in steps]
    for _ in range(60):
        height, stride = (
            int(rng.integers(1, config.height_max + 1)),
            int(rng.integers(1, 2048)) * 32,
        )
        at = {"HEIGHT": height, "STRIDE": stride, "WIDTH": min(config.width_max, stride // PIXEL)}
        frames += [frame | at | {"PIXELS": TOP - height * stride + 32 * k} for k in steps]
    return frames


def edges(config: Config, rng: np.random.Generator) -> list[Frame]:
    """Return frames with one register at, or one step off, a limit of its valid values."""
    frame, frames = good(config), [good(config)]
    stride = frame["STRIDE"]
    for name, values in (
        ("WIDTH", (0, 1, config.width_max)),
        ("HEIGHT", (0, 1, config.height_max)),
        ("STRIDE", (0, stride - 32, stride + 1, stride + 16, stride + 32)),
    ):
        frames += [frame | {name: value} for value in values]
    side = 16 * config.group
    widths = {1, config.width_max, config.height_max, config.side_max}
    for width in sorted(widths | set(range(side, config.side_max, side))):
        for step in (0, 1):  # the tallest image that fits, and one a row taller
            columns = -(-(width + step) // side)
            rows = -(-config.width_max // side) * -(-config.height_max // side) // columns
            height = min(rows * side, config.side_max)
            shape = {"WIDTH": min(width + step, config.side_max), "STRIDE": 32 * (width // 8 + 1)}
            frames += [frame | shape | {"HEIGHT": height}]
            frames += [frame | shape | {"HEIGHT": min(height + 1, config.side_max)}]
    for name, alignment in ALIGNED.items():
        bits = range(alignment.bit_length())
        frames += [frame | {name: int(rng.integers(0, 100)) * 4096 + (1 << k)} for k in bits]
        frames += [frame | {name: frame[name] + 16, "WIDTH": 0}]
    return frames


def with_alpha(config: Config) -> list[Frame]:
    """Return frames with alpha: the smallest stride, and one step less."""
    widths = (1, 7, 8, 9, config.width_max)
    strides = {width: -(-4 * width // STRIDE_ALIGNMENT) * STRIDE_ALIGNMENT for width in widths}
    return [
        good(config) | {"WIDTH": width, "STRIDE": stride - less, "FORMAT": 1}
        for width, stride in strides.items()
        for less in (0, STRIDE_ALIGNMENT)
    ]


@pytest.mark.parametrize("config", [DEFAULT, TINY, ALPHA], ids=lambda config: config.name)
def test_check(config):
    rng = np.random.default_rng(0)
    more = with_alpha(config) if config.rgba else []
    frames = [
        {k: v % TOP if k in ALIGNED else v for k, v in frame.items()}
        for frame in around(config, rng) + edges(config, rng) + more
        if frame["LISTS_PAGES"] < 1 << 20 and frame["FEATURES_MAX"] < 1 << 24
    ]
    right = [expected(config, frame) for frame in frames]
    for frame, one, other in zip(frames, found(config, frames), right, strict=True):
        assert one == other, frame
    codes = [code for code, _ in right]
    errors = ErrorCode.NONE, ErrorCode.SIZE, ErrorCode.ALIGNMENT, ErrorCode.RANGE
    assert {*codes} == {*errors} and min(map(codes.count, errors)) > 5
