"""Codebooks: hardware against the golden model, bit for bit; golden against the packed model."""

import gc
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.golden.project import look_up
from splatcore.hdl.points.codebook import INDEX_BITS, Codebook, sum_of
from splatcore.hdl.points.look_up import LookUp
from splatcore.hdl.points.project import Project
from splatcore.model.generate.generate import generate
from splatcore.model.pack.pack import pack
from splatcore.sim.rtl import vectors
from splatcore.spec import memory
from splatcore.spec.colour import EXPONENT_MAX, EXPONENT_MIN, SH_EXPONENT_MAX, slopes_of
from splatcore.spec.config import DEFAULT, PAPER, Config
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.packed import PackedModel, checksum
from splatcore.spec.point import EXPONENT
from splatcore.spec.programs import COLOURS, SLOPES
from tb.helpers.point_rows import exponents

ARRAY = Config(name="ARRAY", colours="array", sh_degree=1)
PLAIN = replace(ARRAY, name="PLAIN", sh_degree=0)
MANY = replace(ARRAY, name="MANY", colour_index=((9,), (5, 4, 3, 2)), sh_index=((), (5, 4, 3)))
"""More stages than `ARRAY` has, and a different number of them in models of degree 0."""

INTERVALS = {"ARRAY": 7, "PAPER": 5, "PLAIN": 3, "MANY": 10}
COUNT = 2000
FEW = 500
PORT = 64
BEATS = memory.CODEBOOK_WORD * 8 // PORT  # ports that carry one word
EXPONENTS = (-9, -10)  # of colours and slopes, for tests of other things


class Ports(wiring.Component):
    """`LookUp` with flat ports of at most `PORT` bits."""

    def __init__(self, config: Config):
        self.part = part = LookUp(config)
        words = part.write.payload
        ports = {"valid": In(1), "address": In(len(words.address))}
        ports |= {f"word{k}": In(PORT) for k in range(BEATS)}
        ports |= {"start": In(1), "index": In(INDEX_BITS), "sh": In(1)}
        ports |= {"exponent": In(part.model.exponent.shape())}
        ports |= {f"o_{name}": Out(len(part.o[name])) for name, _ in part.o.shape()}
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = self.part
        write = part.write
        m.d.comb += [write.valid.eq(self.valid), write.payload.address.eq(self.address)]
        for k in range(BEATS):
            m.d.comb += write.payload.word[k * PORT :][:PORT].eq(getattr(self, f"word{k}"))
        m.d.comb += [part.start.eq(self.start), part.index.eq(self.index)]
        m.d.comb += [part.model.sh.eq(self.sh), part.model.exponent.eq(self.exponent)]
        m.d.comb += [getattr(self, f"o_{name}").eq(part.o[name]) for name, _ in part.o.shape()]
        return m


@dataclass(frozen=True)
class Frame:
    """A model whose Gaussians are all looked up, and the cycles between consecutive starts."""

    model: PackedModel
    distance: np.ndarray | int


def drive(ports: Ports, frames: list[Frame]) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Return the inputs by port, random while they must not matter, and each frame's starts."""
    rng = np.random.default_rng(7)
    widths = vectors.input_widths(ports)
    rows, starts, begin = {name: [] for name in widths}, [], 0
    for frame in frames:
        model, layout = frame.model, frame.model.layout
        words = model.image[layout.colours : layout.end].view("<u8").reshape(-1, BEATS)
        steps = np.broadcast_to(frame.distance, len(model) - 1)
        start = len(words) + 1 + np.concatenate([[0], np.cumsum(steps)])
        length = start[-1] + ports.part.latency + 1
        given = {
            name: rng.integers(0, (1 << width) - 1, length, np.uint64, endpoint=True)
            for name, width in widths.items()
        }
        given["valid"][:] = np.arange(length) < len(words)
        given["address"][: len(words)] = np.arange(len(words))
        for k in range(BEATS):
            given[f"word{k}"][: len(words)] = words[:, k]
        given["start"][:] = np.isin(np.arange(length), start)
        codes = enumerate(exponents(model))
        given["exponent"][start[0] :] = sum(code << k * EXPONENT.width for k, code in codes)
        given["sh"][start[0] :] = model.format.sh_degree
        beats = model.attribute_beats(model.beats)[:, -8:].copy().view("<u8")[:, 0]
        index = beats >> np.uint64(64 - INDEX_BITS)
        for later in range(3):
            given["index"][start + later] = index
        for name, array in given.items():
            rows[name].append(array)
        starts.append(begin + start)
        begin += length
    return {name: np.concatenate(arrays) for name, arrays in rows.items()}, starts


def check(ports: Ports, frames: list[Frame]) -> None:
    """Check all values of all frames, exactly `latency` cycles after their starts."""
    config = ports.part.config
    inputs, starts = drive(ports, frames)
    outputs = vectors.run(ports, inputs)
    names = COLOURS + (SLOPES if config.sh_degree else ())
    assert {f"o_{name}" for name in names} == set(outputs)
    for number, (frame, start) in enumerate(zip(frames, starts, strict=True)):
        expected = look_up(config, frame.model, np.arange(len(frame.model)))
        for name in names:
            found = outputs[f"o_{name}"][start + ports.part.latency]
            values = expected.get(name, np.zeros(len(start)))  # without harmonics G is zero
            codes = config.arithmetic.encode(values)
            np.testing.assert_array_equal(found, codes, f"frame {number}: {name}")


@cache
def garden(config: Config, degree: int, count: int) -> PackedModel:
    return pack(generate("garden", count), config, degree)[0]


def altered(config, degree, numbers, scales=EXPONENTS, count=COUNT) -> PackedModel:
    """Return a model with entries `numbers(entry format, shape)` and exponents `scales`.

    Its indices choose every entry of each stage, in random combinations.
    """
    model = garden(config, degree, count)
    layout, format, rng = model.layout, model.format, np.random.default_rng(8)
    image = model.image.copy()

    def put(record, start, codes):
        data = record.pack(codes)
        image[start : start + data.size] = data.reshape(-1)

    for record, start, count in (
        (memory.COLOUR_ENTRY, layout.colours, format.colour_entries),
        (memory.SH_ENTRY, layout.sh, format.sh_entries),
    ):
        (field, array), (spare, bits) = record.fields
        codes = array.encode(numbers(array.format, (count, array.length)))
        put(record, start, {field: codes, spare: rng.integers(0, 1 << bits.width, count)})
    index = {
        name: rng.permutation(np.arange(len(model)) % (1 << format.attribute_record[name].width))
        for name in format.codebook_words
    }
    put(format.attribute_record, layout.attributes, model.attributes | index)
    codes = memory.HEADER["exponent"].encode(np.array([[*scales, EXPONENT_MIN, EXPONENT_MIN]]))
    header = model.header | {"exponent": codes}
    put(memory.HEADER, layout.header, header)
    put(memory.HEADER, layout.header, header | {"checksum": np.array([checksum(image)])})
    return PackedModel(image, "altered")


def any_number(entry, shape) -> np.ndarray:
    return np.random.default_rng(9).integers(int(entry.min), int(entry.max) + 1, shape)


def extreme(entry, shape) -> np.ndarray:
    """Return values at the ends of an entry's range, next to them, and around zero."""
    ends = [entry.min, entry.min + 1, -1, 0, 1, entry.max - 1, entry.max]
    return np.random.default_rng(10).choice(ends, shape)


def highest(entry, shape) -> np.ndarray:
    return np.full(shape, entry.max)


def degrees(config: Config) -> range:
    return range(config.sh_degree + 1)


@pytest.mark.slow
@pytest.mark.parametrize("config", [ARRAY, PAPER, PLAIN, MANY], ids=lambda config: config.name)
def test_hardware_equals_golden(config):
    """Packed scenes and entries of all kinds, at all distances; each frame rewrites the memory."""
    ports = Ports(config)
    interval = ports.part.interval
    assert interval == INTERVALS[config.name]
    rng = np.random.default_rng(11)
    irregular = interval + rng.integers(0, 4, COUNT) * rng.integers(0, 4, COUNT)
    frames = []
    for degree in degrees(config):
        model = garden(config, degree, COUNT)
        for distance in (interval, 4, 5, 10, irregular[: len(model) - 1]):
            frames.append(Frame(model, np.maximum(distance, interval)))
    for numbers in (any_number, extreme, lambda entry, shape: np.full(shape, entry.min), highest):
        for degree in degrees(config):
            frames.append(Frame(altered(config, degree, numbers), interval))
    check(ports, frames)


@pytest.mark.slow
@pytest.mark.parametrize("config", [ARRAY, PAPER, PLAIN], ids=lambda config: config.name)
def test_exponents_of_all_sizes(config):
    """All exponents, from the smallest to the largest."""
    exponents = [EXPONENT_MIN, *range(EXPONENT_MIN, EXPONENT_MAX + 1), EXPONENT_MAX]
    rng = np.random.default_rng(12)
    frames = [
        Frame(altered(config, degree, extreme, (first, min(second, SH_EXPONENT_MAX)), FEW), 10)
        for first, second in zip(exponents, rng.permutation(exponents), strict=True)
        for degree in degrees(config)
    ]
    check(Ports(config), frames)


def test_sums_fit():
    """The sum's format holds the sums at both ends; half its range would not."""
    for entry in (memory.COMPONENT, memory.SLOPE):
        for stages in range(1, 5):
            total = sum_of(entry, stages)
            assert total.min <= stages * entry.min and stages * entry.max <= total.max
            assert stages * entry.min < total.min / 2


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
def test_a_small_memory_is_refused():
    with pytest.raises(ValueError, match="codebook"):
        Codebook(Config(name="SMALL", codebook=DEFAULT.codebook // 2))
    with pytest.raises(ValueError, match="slots"):
        Project(replace(DEFAULT, projection_slots=512))
    gc.collect()  # or Amaranth warns of the unused component during some other test


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("config", [ARRAY, PAPER, MANY], ids=lambda config: config.name)
def test_golden_reads_the_packed_values(config, degree):
    """Golden values equal those of `PackedModel`, which knows no memory words, rounded once."""
    for model in (garden(config, degree, FEW), altered(config, degree, any_number, count=FEW)):
        index = np.random.default_rng(13).permutation(len(model))[: len(model) // 2]
        fields = look_up(config, model, index)
        assert set(fields) == {*COLOURS, *(SLOPES if degree else ())}
        base, *first = model.factors
        expected = dict(zip(COLOURS, base[index, 0].T + COLOUR_OFFSET, strict=True))
        if degree:
            slopes = slopes_of(first[0][index]).reshape(-1, 9)
            expected |= dict(zip(SLOPES, slopes.T, strict=True))
        for name, values in expected.items():
            np.testing.assert_array_equal(fields[name], config.arithmetic.round(values), name)
