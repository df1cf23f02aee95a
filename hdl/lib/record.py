"""Amaranth layouts of the records of `spec.record`, and layouts that several parts share."""

from amaranth.hdl import Shape, unsigned
from amaranth.lib import data, stream

from splatcore.spec.axi import BEAT_ADDRESS_BITS
from splatcore.spec.config import Config
from splatcore.spec.record import Array, Format, Record
from splatcore.spec.registers import CODE_BITS, DETAIL_BITS, frame_registers

AREA = data.StructLayout(dict.fromkeys(("groups", "lists", "features"), BEAT_ADDRESS_BITS))
"""Addresses of the parts of a work area, in beats."""

ERROR = data.StructLayout({"valid": 1, "code": CODE_BITS, "detail": DETAIL_BITS})
"""An error, valid in the cycle in which it is detected."""


def layout(record: Record) -> data.StructLayout:
    """Return the layout with the record's fields at the record's offsets.

    Nested records and arrays become layouts; a number of any format becomes its code, an unsigned
    bit vector.
    """
    return data.StructLayout({field: _shape(format) for field, format in record.fields})


def stream_of(record: Record) -> stream.Signature:
    """Signature of a stream of records."""
    return stream.Signature(layout(record))


def _shape(format: Format) -> data.Layout | Shape:
    """Layout or shape of one format."""
    if isinstance(format, Record):
        return layout(format)
    if isinstance(format, Array):
        return data.ArrayLayout(_shape(format.format), format.length)
    return unsigned(format.width)


def same_fields(target: data.View, source: data.View) -> list:
    """Assign each field of `target` from the field of `source` with the same name."""
    return [target[name].eq(source[name]) for name in target.shape().members]


def frame_layout(config: Config) -> data.StructLayout:
    """Layout of the frame registers."""
    registers = frame_registers(config)
    return data.StructLayout({register.name.lower(): register.width for register in registers})
