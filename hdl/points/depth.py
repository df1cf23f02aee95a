"""Depths and rays in the finer numbers of `spec.depth`, and rounded to `Config.arithmetic`."""

from amaranth.hdl import Cat, Const, Value

from splatcore.spec.config import Config
from splatcore.spec.depth import low_bits


def widened(config: Config, code: Value) -> Value:
    """A code of `Config.arithmetic` as one of `spec.depth.finer`."""
    return Cat(Const(0, low_bits(config)), code)


def narrowed(config: Config, code: Value) -> Value:
    """A code of `spec.depth.finer` rounded to one of `Config.arithmetic`.

    To nearest, ties away from zero; z_low is the code's lowest bits.
    """
    bits = low_bits(config)
    if not bits:
        return code
    size, up = code[bits:-1], code[bits - 1]
    return Cat((size + (up & ~size.all()))[: len(size)], code[-1])
