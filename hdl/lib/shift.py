"""Barrel shifters with a sticky bit, counting of leading zeros, and encoding of one bit.

Each function adds what it needs to the module that it is given.
"""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.utils import bits_for


def leading_zeros(m: Module, value: Value) -> Value:
    """Number of zeros above the highest one; the width if there is none. A tree.

    Pads with ones below up to a power of two, so that the count ends there at the latest.
    """
    size = 1 << bits_for(len(value))
    _, count = _count_zeros(m, Cat(Const(-1, size - len(value)), value))
    return count[: bits_for(len(value))]


def _count_zeros(m: Module, value: Value) -> tuple[Value, Value]:
    """High if all of 2^n bits are zero; and if not, the number of leading zeros in n bits."""
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
    """value + 1 in as many bits. For gates each carry is the AND of all bits below, so that
    synthesis makes trees; of an adder of one it makes a chain, which is what an FPGA is fast at."""
    if logic == "fpga":
        return (value + 1)[: len(value)]
    return Cat(bit ^ value[:k].all() if k else ~bit for k, bit in enumerate(value))


def several(value: Value) -> Value:
    """Whether more than one bit is 1."""
    if len(value) == 1:
        return Const(0)
    low, high = value[: len(value) // 2], value[len(value) // 2 :]
    return several(low) | several(high) | (low.any() & high.any())


def encoded(one_hot: Value) -> Value:
    """The index of the one bit that is 1."""
    width = max((len(one_hot) - 1).bit_length(), 1)
    return Cat(
        Cat(one_hot[k] for k in range(len(one_hot)) if k >> bit & 1).any() for bit in range(width)
    )


def sticky(value: Value, width: int) -> Value:
    """The highest `width` bits of `value`, and below them one that is set if any other is.

    A sticky bit can stand for all that it replaces when a number is rounded, as long as at least
    one more bit stands between it and those that are kept.
    """
    rest = len(value) - width
    if rest < 0:
        return Cat(Const(0, 1 - rest), value)
    return Cat(value[:rest].any(), value[rest:])


def shift_right_sticky(m: Module, value: Value, amount: Value, width: int) -> Value:
    """The lowest `width` bits of `value` / 2^`amount`, the lowest of them sticky as in `value`.

    What is above them must be zero whenever it is shifted by `amount`: it is not built.
    """
    stages = bits_for(len(value) - 1)
    far = amount[stages:].any()  # by so much that only the sticky bit is left
    for power in reversed(range(min(stages, len(amount)))):
        distance = 1 << power
        rest = width + distance - 1  # what the stages to come can bring down
        shifted = Signal(min(len(value), rest), name=f"right_{distance}")
        kept = max(len(value) - 1 - distance, 0)
        m.d.comb += shifted.eq(Mux(amount[power] | far, sticky(value, kept), value))
        value = shifted
    return value
