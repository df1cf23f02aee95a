"""The machine's two AXI ports: who reads and writes memory, and how much at a time.

One AXI4 master of `Config.port` bits (INCR bursts of full beats; a splat's features are read as a
part of a beat where the port is wider than they are) and one AXI4-Lite slave (`spec.registers`).
Addresses inside the machine count beats of 128 bits whatever the port's width; a beat of a wider
port is two of them, the first at an even address. A reader has the ID of its place in `READERS`, a
writer of its place in `WRITERS`; what has one ID stays in order, and nothing relies on more.

With `Config.address_bits` of 64 each area of memory lies in a window of 4 GiB. Addresses inside the
machine are those within a window, whatever `address_bits` is; the window's number goes beside them
from the area's register to the port, and nothing is ever added to it.
"""

from splatcore.spec.config import Config
from splatcore.spec.number import Bits
from splatcore.spec.record import Record

DATA_BITS = 128
BEAT = DATA_BITS // 8
"""Bytes of a beat inside the machine."""

BEAT_BITS = BEAT.bit_length() - 1

ADDRESS_BITS = 32
"""Width of a byte address within a window; the window's number is above it (`window_bits`)."""

BEAT_ADDRESS_BITS = ADDRESS_BITS - BEAT_BITS

BOUNDARY = 4096
"""Bytes: no AXI burst crosses a multiple of this."""

BURST_BEATS = 16
"""Longest burst of a sequential reader, in the machine's beats; it ends at a multiple of so
many."""

LINE_BEATS = 2
LINE = LINE_BEATS * BEAT
"""Bytes of a line: what is gathered before it is written."""

WRITE_BITS = 64
"""Bits of a field of `write_record`'s data."""

LENGTH_BITS = 8
"""Width of AXI's length, the beats of a burst less one."""

PREPROCESSING, RENDERING = 0, 1
"""The machine's halves."""

READERS = dict.fromkeys(("model", "positions", "attributes"), PREPROCESSING)
READERS |= dict.fromkeys(("groups", "long_lists", "lists", "features"), RENDERING)
"""Who reads → for which half: a model's header, codebooks and chunk headers, its positions and its
attributes; the groups' table, lists to be dealt, lists to be sorted, features in sorted order."""

WRITERS = dict.fromkeys(("features", "lists", "groups"), PREPROCESSING)
WRITERS |= dict.fromkeys(("buckets", "pixels"), RENDERING)
"""Who writes → for which half."""

READ_AREAS = dict.fromkeys(("model", "positions", "attributes"), "model")
READ_AREAS |= {"groups": "groups", "long_lists": "lists", "lists": "lists", "features": "features"}
WRITE_AREAS = {"features": "features", "lists": "lists", "groups": "groups"}
WRITE_AREAS |= {"buckets": "scratch", "pixels": "pixels"}
"""Who reads and writes → the area, by the name of its address's register. The reader "lists" reads
dealt ones in "scratch" besides."""

ID_BITS = (max(len(READERS), len(WRITERS)) - 1).bit_length()

LITE_ADDRESS_BITS = 12
LITE_DATA_BITS = 32

OKAY, SLAVE_ERROR = 0, 2
"""Responses; what is over 1 is an error."""


def window_bits(config: Config) -> int:
    """Width of a window's number, 0 where all memory is one window."""
    return config.address_bits - ADDRESS_BITS


def port_beats(config: Config) -> int:
    """Beats of the machine in one of the port's."""
    return config.port // DATA_BITS


def port_bytes(config: Config) -> int:
    """Bytes of a beat of the port."""
    return config.port // 8


def read_bytes(config: Config, reader: str) -> int:
    """Bytes of a beat that comes back to a reader: features are read as parts of a beat."""
    return BEAT if reader == "features" else port_bytes(config)


def read_record() -> Record:
    """A burst to be read. beat: where it begins; length: the port's beats less one. narrow: it is a
    single beat of the machine, in the part of the port's beat that its address says."""
    fields = {"beat": Bits(BEAT_ADDRESS_BITS), "length": Bits(LENGTH_BITS), "narrow": Bits(1)}
    return Record("read", fields)


def range_record(count_bits: int) -> Record:
    """Consecutive beats of the machine to be read, at least one; the first is the port's, too."""
    return Record("range", {"beat": Bits(BEAT_ADDRESS_BITS), "count": Bits(count_bits)})


def write_record(config: Config) -> Record:
    """A beat of the port to be written. beat: where the burst begins, the same for all its beats,
    as is length (its beats less one)."""
    fields = {"beat": Bits(BEAT_ADDRESS_BITS), "length": Bits(LENGTH_BITS)}
    fields |= {"strobe": Bits(port_bytes(config))}
    words = range(config.port // WRITE_BITS)
    return Record("write", fields | {f"data{k}": Bits(WRITE_BITS) for k in words})
