"""The machine's two AXI ports: who reads and writes memory, and how much at a time.

One AXI4 master of `DATA_BITS` (INCR bursts, full beats) and one AXI4-Lite slave (`spec.registers`).
Addresses inside the machine count beats. A reader has the ID of its place in `READERS`, a writer of
its place in `WRITERS`; what has one ID stays in order, and nothing relies on more.
"""

from splatcore.spec.number import Bits
from splatcore.spec.record import Record

DATA_BITS = 128
BEAT = DATA_BITS // 8
"""Bytes of a beat."""

BEAT_BITS = BEAT.bit_length() - 1

ADDRESS_BITS = 32
"""Width of a byte address."""

BEAT_ADDRESS_BITS = ADDRESS_BITS - BEAT_BITS

BOUNDARY = 4096
"""Bytes: no AXI burst crosses a multiple of this."""

BURST_BEATS = 16
"""Longest burst of a sequential reader; it ends at a multiple of this many beats."""

LINE_BEATS = 2
LINE = LINE_BEATS * BEAT
"""Bytes of a line: what is gathered before it is written."""

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

ID_BITS = (max(len(READERS), len(WRITERS)) - 1).bit_length()

LITE_ADDRESS_BITS = 12
LITE_DATA_BITS = 32

OKAY, SLAVE_ERROR = 0, 2
"""Responses; what is over 1 is an error."""


def read_record() -> Record:
    """A burst to be read. length: its beats less one."""
    return Record("read", {"beat": Bits(BEAT_ADDRESS_BITS), "length": Bits(LENGTH_BITS)})


def range_record(count_bits: int) -> Record:
    """Consecutive beats to be read, at least one."""
    return Record("range", {"beat": Bits(BEAT_ADDRESS_BITS), "count": Bits(count_bits)})


def write_record() -> Record:
    """A beat to be written. beat: where the burst begins, the same for all its beats, as is length
    (its beats less one)."""
    data = {"strobe": Bits(BEAT), "low": Bits(64), "high": Bits(64)}
    return Record("write", dict(read_record().fields) | data)
