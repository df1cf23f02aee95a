"""The machine's two AXI ports: their clients, IDs and bursts.

One AXI4 master with `Config.port` data bits, which sends INCR bursts of full beats. One AXI4-Lite
slave (`spec.registers`).

Inside the machine, addresses count beats of 128 bits, whatever the port's width. A beat of a wider
port is two machine beats, the first at an even address. A reader's AXI ID is its index in
`READERS`, a writer's ID its index in `WRITERS`. Transfers with one ID stay in order; the machine
relies on no other order.

With `Config.address_bits` of 64, each area of memory is within one window of 4 GiB. Addresses
inside the machine count within the window, whatever `address_bits` is. The window's number goes
unchanged from the area's register to the port.
"""

from splatcore.spec.config import Config
from splatcore.spec.number import Bits
from splatcore.spec.record import Record

DATA_BITS = 128
"""Bits of a beat inside the machine."""
BEAT = DATA_BITS // 8
"""Bytes of a beat inside the machine."""

BEAT_BITS = BEAT.bit_length() - 1
"""log2 of `BEAT`."""

ADDRESS_BITS = 32
"""Width of a byte address within a window; `window_bits` more select the window."""

BEAT_ADDRESS_BITS = ADDRESS_BITS - BEAT_BITS
"""Width of an address in machine beats."""

BOUNDARY = 4096
"""No AXI burst crosses a multiple of this many bytes."""

BURST_BEATS = 16
"""Longest burst of a sequential reader, in machine beats; it ends at a multiple of this."""

LINE_BEATS = 2
LINE = LINE_BEATS * BEAT
"""Bytes of a line: writes are gathered into lines."""

WRITE_BITS = 64
"""Bits of one data field of `write_record`."""

LENGTH_BITS = 8
"""Width of AXI's burst length: the number of beats minus one."""

PREPROCESSING, RENDERING = 0, 1
"""Numbers of the machine's halves, which work on two frames at once."""

READERS = dict.fromkeys(("model", "positions", "attributes"), PREPROCESSING)
READERS |= dict.fromkeys(("groups", "long_lists", "lists", "features"), RENDERING)
"""Readers of memory → their half, in the order of their AXI IDs.

model: the model's header, codebooks and chunk headers
positions: the model's positions
attributes: the model's attributes
groups: the table of groups
long_lists: lists to be dealt into buckets
lists: lists to be sorted
features: features in sorted order
"""

WRITERS = dict.fromkeys(("features", "lists", "groups"), PREPROCESSING)
WRITERS |= dict.fromkeys(("buckets", "pixels"), RENDERING)
"""Writers of memory → their half, in the order of their AXI IDs."""

READ_AREAS = dict.fromkeys(("model", "positions", "attributes"), "model")
READ_AREAS |= {"groups": "groups", "long_lists": "lists", "lists": "lists", "features": "features"}
WRITE_AREAS = {"features": "features", "lists": "lists", "groups": "groups"}
WRITE_AREAS |= {"buckets": "scratch", "pixels": "pixels"}
"""Readers and writers → their area of memory, named like the register of its address.

The reader "lists" also reads dealt lists in the area "scratch".
"""

ID_BITS = (max(len(READERS), len(WRITERS)) - 1).bit_length()
"""Width of an AXI ID."""

LITE_ADDRESS_BITS = 12
"""Width of a byte address on the AXI4-Lite port."""
LITE_DATA_BITS = 32
"""Bits of a register on the AXI4-Lite port."""

OKAY, SLAVE_ERROR = 0, 2
"""AXI responses; a response of 2 or 3 is an error."""


def window_bits(config: Config) -> int:
    """Return the width of a window's number; 0 if all memory is one window."""
    return config.address_bits - ADDRESS_BITS


def port_beats(config: Config) -> int:
    """Return the number of machine beats in a beat of the port."""
    return config.port // DATA_BITS


def port_bytes(config: Config) -> int:
    """Return the bytes of a beat of the port."""
    return config.port // 8


def read_record() -> Record:
    """A burst to be read.

    beat: address of its first machine beat
    length: port beats minus one
    """
    return Record("read", {"beat": Bits(BEAT_ADDRESS_BITS), "length": Bits(LENGTH_BITS)})


def range_record(count_bits: int) -> Record:
    """Consecutive machine beats to be read, at least one, from the start of a port beat on."""
    return Record("range", {"beat": Bits(BEAT_ADDRESS_BITS), "count": Bits(count_bits)})


def write_record(config: Config) -> Record:
    """A beat of the port to be written.

    beat: address of the burst's first machine beat, the same in all beats of the burst
    length: port beats of the burst minus one, the same in all beats of the burst
    strobe: one bit per byte
    data0 …: the data, `WRITE_BITS` in each field
    """
    fields = {"beat": Bits(BEAT_ADDRESS_BITS), "length": Bits(LENGTH_BITS)}
    fields |= {"strobe": Bits(port_bytes(config))}
    words = range(config.port // WRITE_BITS)
    return Record("write", fields | {f"data{k}": Bits(WRITE_BITS) for k in words})
