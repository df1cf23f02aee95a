"""Models of memory behind a port: answers to reads, and the bytes of writes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Module, Mux, Signal, Value
from amaranth.utils import exact_log2

from splatcore.hdl.lib.stream import Queue, passes
from splatcore.spec import axi
from splatcore.spec.config import Config


def answer_reads(
    m: Module, config: Config, part, bursts, pace, waiting: int, content: Callable[[Value], Value]
) -> None:
    """Connect a memory to `reads` and `data` of a part.

    bursts: stream that outputs each request in the cycle in which the memory accepts it
    pace: stream with one item per beat read
    waiting: requests that the memory accepts before it answers the first one
    content: value of a beat by its number, in beats of the port
    """
    reads, data = part.reads, part.data
    m.submodules.asked = asked = Queue(reads.payload.shape(), waiting)
    place, burst = Signal(axi.LENGTH_BITS), asked.o.payload
    number = (burst.beat >> exact_log2(axi.port_beats(config))) + place
    m.d.comb += [
        bursts.payload.eq(reads.payload),
        asked.i.payload.eq(reads.payload),
        bursts.valid.eq(reads.valid & asked.i.ready),
        asked.i.valid.eq(reads.valid & bursts.ready),
        reads.ready.eq(bursts.ready & asked.i.ready),
        data.payload.beat.eq(content(number)),
        data.payload.last.eq(place == burst.length),
        data.valid.eq(asked.o.valid & pace.valid),
        pace.ready.eq(asked.o.valid & data.ready),
        asked.o.ready.eq(passes(data) & data.payload.last),
    ]
    with m.If(passes(data)):
        m.d.sync += place.eq(Mux(data.payload.last, 0, place + 1))


@dataclass(frozen=True, eq=False)
class Writes:
    """Beats that a writer wrote.

    first: [N] address of the beat's burst in bytes
    place: [N] number of the beat in its burst
    length: [N] beats of the burst
    data, strobe: [N, bytes]
    """

    first: np.ndarray
    place: np.ndarray
    length: np.ndarray
    data: np.ndarray
    strobe: np.ndarray

    @classmethod
    def of(cls, config: Config, rows: np.ndarray) -> "Writes":
        """The beats of rows of `write_record`, which must be whole bursts within a page."""
        codes, size = axi.write_record(config).unpack(rows), axi.port_bytes(config)
        first = codes["beat"].astype(int) * axi.BEAT
        length, place = codes["length"].astype(int) + 1, np.zeros(len(rows), int)
        for k in range(1, len(rows)):
            place[k] = (place[k - 1] + 1) % length[k - 1]
        inner = np.flatnonzero(place)
        assert (first[inner] == first[inner - 1]).all() and (np.diff(length)[inner - 1] == 0).all()
        assert not len(rows) or place[-1] == length[-1] - 1
        first = first // size * size
        assert (first // axi.BOUNDARY == (first + length * size - 1) // axi.BOUNDARY).all()
        words = np.stack([codes[f"data{k}"] for k in range(size // 8)], 1).astype("<u8")
        strobe = codes["strobe"].astype(np.int64)[:, None] >> np.arange(size) & 1 == 1
        return cls(first, place, length, words.view(np.uint8).reshape(-1, size), strobe)

    @property
    def address(self) -> np.ndarray:
        """Addresses [N, bytes]."""
        size = self.data.shape[1]
        return (self.first + size * self.place)[:, None] + np.arange(size)

    def bytes(self) -> tuple[np.ndarray, np.ndarray]:
        """Addresses and values of all bytes written, in order."""
        return self.address[self.strobe], self.data[self.strobe]
