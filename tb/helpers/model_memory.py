"""The model reader on a memory with any content: its requests and outputs, bit by bit."""

from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Assert, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, connect, flipped

from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.points.model_reader import READING, ModelReader
from splatcore.sim.rtl.streams import Result
from splatcore.spec import axi, memory
from splatcore.spec.config import Config
from splatcore.spec.point import FETCH, WANTED
from splatcore.spec.record import Codes, Record
from tb.helpers.parts import forward
from tb.helpers.point_rows import write_rows
from tb.helpers.runs import Case, compiled

Ranges = list[tuple[int, int]]
"""First beats and counts of beats."""

OWED_BITS = 24
WORDS_MAX = 1024


class Reading(wiring.Component):
    """`ModelReader` that runs when it has loaded; requests for chunks and Gaussians wait for that.

    Members: those of the reader, except that `base` replaces `model_at`, `bursts` replaces `reads`,
    and `beats` replaces `data` and never comes before its request. Position beats must always be
    accepted, as the reader requests no more than it has room for.
    """

    def __init__(self, config: Config):
        self.reader = ModelReader(config)
        members = dict(self.reader.signature.members)
        for name in ("model_at", "run", "reads", "data"):
            del members[name]
        self.same = [name for name in members if name not in ("fetch", "wanted", "write")]
        beats = In(stream.Signature(config.port)).array(len(READING))
        bursts = self.reader.signature.members["reads"]
        ports = {"base": In(axi.BEAT_ADDRESS_BITS), "bursts": bursts, "beats": beats}
        super().__init__(members | ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.reader = reader = self.reader
        forward(m, self, reader, self.same)
        words = Queue(reader.write.payload.shape(), WORDS_MAX, memory=True)  # never full
        m.submodules.words = words
        connect(m, reader.write, words.i)
        connect(m, words.o, flipped(self.write))
        ran = Signal()
        m.d.comb += [reader.model_at.eq(self.base), reader.run.eq(reader.loaded & ~ran)]
        m.d.sync += ran.eq(reader.loaded)
        for name in ("fetch", "wanted"):
            outer, inner = getattr(self, name), getattr(reader, name)
            m.d.comb += [inner.payload.eq(outer.payload), inner.valid.eq(outer.valid & ran)]
            m.d.comb += outer.ready.eq(inner.ready & ran)
        for k, name in enumerate(READING):
            asked, burst = reader.reads[k], self.bursts[k]
            given, back = self.beats[k], reader.data[k]
            owed = Signal(OWED_BITS)
            m.d.comb += [
                burst.payload.eq(asked.payload),
                burst.valid.eq(asked.valid),
                asked.ready.eq(burst.ready),
                back.payload.beat.eq(given.payload),
                back.valid.eq(given.valid & owed.any()),
                given.ready.eq(back.ready & owed.any()),
            ]
            more = (asked.payload.length + 1) * (asked.valid & asked.ready)
            m.d.sync += owed.eq(owed + more - (given.valid & given.ready))
            if name == "positions":
                m.d.comb += Assert(back.ready)
        return m


@dataclass(frozen=True)
class Image:
    """Memory with a model's bytes at beat `base`, and noise around them."""

    data: np.ndarray
    base: int

    def beats(self, numbers: np.ndarray) -> np.ndarray:
        """Beats [N, 16] uint8 by their addresses."""
        noise = np.stack([numbers * 0x1E3779B97F4A7C15, ~numbers], axis=1).astype("<u8")
        found = noise.view(np.uint8).reshape(-1, axi.BEAT).copy()
        own = numbers - self.base
        inside = (own >= 0) & (own < len(self.data) // axi.BEAT)
        found[inside] = self.data.reshape(-1, axi.BEAT)[own[inside]]
        return found

    @property
    def header(self) -> Codes:
        codes = memory.HEADER.unpack(self.data[: memory.HEADER.size].reshape(1, -1))
        return {name: array[0] for name, array in codes.items()}


def places(ranges: Ranges) -> np.ndarray:
    """Addresses of all beats of ranges."""
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(b, b + n) for b, n in ranges)])


def divided(ranges: Ranges, unit: int) -> Ranges:
    """Cut ranges at multiples of `unit` beats."""
    found = []
    for first, count in ranges:
        while count:
            part = min(count, unit - first % unit)
            found.append((first, part))
            first, count = first + part, count - part
    return found


def model_ranges(config: Config, image: Image) -> dict[str, Ranges]:
    """Beats of a valid model that the first reader reads: header, codebooks, chunk headers."""
    header, unit = image.header, memory.ALIGNMENT // axi.BEAT
    chunks = memory.chunk_count(int(header["count"]))
    found = {"header": [(image.base, memory.HEADER.size // axi.BEAT)], "codebooks": []}
    if header["colour_index"].any():
        format = memory.model_format(config, int(header["sh_degree"]))
        words = -(-format.codebook_bytes // memory.ALIGNMENT) * unit
        found["codebooks"] = [(image.base + int(header["colours"]) * unit, words)]
    begin = image.base + memory.HEADER.size // axi.BEAT
    stride = memory.CHUNK_HEADER.size << (header["version"] == memory.VERSIONS[-1])
    found["chunks"] = [(begin, chunks * stride // axi.BEAT)] * (chunks > 0)
    return found


def fetch_ranges(config: Config, image: Image, chunks: Ranges) -> Ranges:
    """Beats of the positions of chunks (number, count)."""
    unit = memory.ALIGNMENT // axi.BEAT
    begin = image.base + int(image.header["positions"]) * unit
    width = 48 if config.position == "absolute" else 27 if image.header["small"] else 45
    stride = 2 * width
    return [(begin + n * stride, -(-count * width // axi.DATA_BITS)) for n, count in chunks]


def of_port(config: Config, ranges: Ranges) -> Ranges:
    """Port beats of ranges that begin at a port beat."""
    wide = axi.port_beats(config)
    assert all(first % wide == 0 for first, _ in ranges)
    return [(first // wide, -(-count // wide)) for first, count in ranges]


def burst_rows(config: Config, ranges: Ranges) -> np.ndarray:
    record = axi.read_record()
    first, count = np.array(ranges, np.int64).reshape(-1, 2).T
    first = first.astype(np.uint64) * axi.port_beats(config)
    length = (count - 1).astype(np.uint64)
    return record.pack({"beat": first, "length": length})


def pair_rows(record: Record, pairs: Ranges) -> np.ndarray:
    """Rows of a record of two fields."""
    columns = np.array(pairs, np.uint64).reshape(-1, 2).T
    return record.pack(dict(zip(dict(record.fields), columns, strict=True)))


def check_reading(
    config: Config,
    image: Image,
    fits: bool = True,
    fetch: Ranges = (),
    wanted: Ranges = (),
    **options,
) -> Result:
    """Load a model and read it: exactly the requested beats, once each, in valid AXI bursts.

    fits: whether the machine can render it; else only the header is read
    fetch: numbers of chunks and counts of Gaussians
    wanted: first beats and counts of attributes (none for ports with larger beats, which two
        requests may share: `tb.hdl.test_memory`)
    """
    wide = axi.port_beats(config)
    parts = model_ranges(config, image) if fits else {}
    begin = image.base + int(image.header["attributes"]) * (memory.ALIGNMENT // axi.BEAT)
    header = [(image.base, memory.HEADER.size // axi.BEAT)]
    attributes = [(begin + beat, count) for beat, count in wanted]
    positions = fetch_ranges(config, image, list(fetch))
    ranges = [[r for part in parts.values() for r in part] or header, positions, attributes]
    units = (axi.BURST_BEATS // wide, axi.BURST_BEATS // wide, axi.BOUNDARY // axi.BEAT)
    given = [image.beats(places(part)) for part in ranges]
    headers = image.beats(places(parts.get("chunks", [])))
    expected = {
        "headers": headers.reshape(-1, memory.CHUNK_HEADER.size),
        "write": write_rows(config, image.beats(places(parts.get("codebooks", [])))),
        "positions": given[1],
        "attributes": given[2],
    }
    inputs = {"fetch": pair_rows(FETCH, list(fetch)), "wanted": pair_rows(WANTED, list(wanted))}
    for k, unit in enumerate(units):
        asked = of_port(config, ranges[k])
        beats = [(first * wide, count * wide) for first, count in asked]
        expected[f"bursts__{k}"] = burst_rows(config, divided(asked, unit))
        inputs[f"beats__{k}"] = image.beats(places(beats)).reshape(-1, axi.port_bytes(config))
    constants = {"start": np.array([1, 0]), "base": image.base}
    constants |= {"jump": 0, "target": 0} if config.levels else {}
    case = Case(inputs, expected, constants)
    return case.check(compiled(Reading, config), "model.", **options)
