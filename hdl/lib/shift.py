"""Barrel shifters with a sticky bit, count of leading zeros, one-hot encoding.

The functions that take a module add logic to it.
"""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.utils import bits_for


def leading_zeros(m: Module, value: Value) -> Value:
    """Number of zeros above the highest one; the width of `value` if that is 0. A tree.

    The value is padded below with ones up to a power of two, which bounds the count.
    """
    size = 1 << bits_for(len(value))
    _, count = _count_zeros(m, Cat(Const(-1, size - len(value)), value))
    return count[: bits_for(len(value))]


def _count_zeros(m: Module, value: Value) -> tuple[Value, Value]:
    """For 2^n bits: whether all are zero, and if not, the number of leading zeros in n bits."""
    if len(value) == 2:
        return ~value.any(), ~value[1]
    middle = len(value) // 2
    low_empty, low = _count_zeros(m, value[:middle])
    high_empty, high = _count_zeros(m, value[middle:])
    empty = Signal(name=f"empty_{len(value)}")
    count = Signal(len(high) + 1, name=f"zeros_{len(value)}")
    m.d.comb += empty.eq(high_empty & low_empty)
    m.d.comb += count.eq(Cat(Mux(high_empty, low, high), high_empty))
    return empty, count


def lowest(value: Value) -> Value:
    """The lowest set bit alone."""
    return value & (~value + 1)[: len(value)]


def plus_one(value: Value, logic: str) -> Value:
    """value + 1 in the same width.

    For gates each carry is the AND of all bits below, which synthesis turns into trees; an adder
    would become a carry chain, which is fast on an FPGA.
    """
    if logic == "fpga":
        return (value + 1)[: len(value)]
    return Cat(bit ^ value[:k].all() if k else ~bit for k, bit in enumerate(value))


def several(value: Value) -> Value:
    """High if more than one bit is 1."""
    if len(value) == 1:
        return Const(0)
    low, high = value[: len(value) // 2], value[len(value) // 2 :]
    return several(low) | several(high) | (low.any() & high.any())


def encoded(one_hot: Value) -> Value:
    """Index of the set bit of a one-hot value."""
    width = max((len(one_hot) - 1).bit_length(), 1)
    return Cat(
        Cat(one_hot[k] for k in range(len(one_hot)) if k >> bit & 1).any() for bit in range(width)
    )


def sticky(value: Value, width: int) -> Value:
    """The highest `width` bits of `value`, and below them one bit that is the OR of all others.

    When a number is rounded, a sticky bit can stand for all bits that it replaces, provided that at
    least one more bit is between it and the bits that are kept.
    """
    rest = len(value) - width
    if rest < 0:
        return Cat(Const(0, 1 - rest), value)
    return Cat(value[:rest].any(), value[rest:])


def shift_right_sticky(m: Module, value: Value, amount: Value, width: int) -> Value:
    """The lowest `width` bits of `value` / 2^`amount`; the lowest of them is sticky as in `value`.

    The bits above must be zero for every `amount` that occurs: no logic is built for them.
    """
    stages = bits_for(len(value) - 1)
    far = amount[stages:].any()  # only the sticky bit is left
    for power in reversed(range(min(stages, len(amount)))):
        distance = 1 << power
        rest = width + distance - 1  # bits that later stages can shift down
        shifted = Signal(min(len(value), rest), name=f"right_{distance}")
        kept = max(len(value) - 1 - distance, 0)
        m.d.comb += shifted.eq(Mux(amount[power] | far, sticky(value, kept), value))
        value = shifted
    return value
