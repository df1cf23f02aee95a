"""Expands half a beat of attributes to a whole beat (`spec.small`)."""

from amaranth.hdl import Cat, Const, Mux, Value

from splatcore.spec.config import Config
from splatcore.spec.memory import (
    BELOW,
    FACTOR,
    MAGNITUDE,
    ON_DIAGONAL,
    OPACITY,
    SMALL_OPACITY,
    model_format,
)


def expanded(half: Value) -> Value:
    """Expand half a beat to a whole beat of attributes.

    An element of L is its magnitude below the leading one; the place of that is added to the
    exponent.

    **Timing**: no registers: a multiplexer of four and a sum of five bits.
    """
    stored = model_format(Config(), 0, small=True).stored_record

    def field(name: str) -> Value:
        return half[stored.offset(name) :][: stored[name].width]

    lower = [_element(field(name), field("exponent")) for name in (*ON_DIAGONAL, *BELOW)]
    opacity = Cat(Const(0, OPACITY.fraction - SMALL_OPACITY.fraction), field("opacity"))
    return Cat(*lower, opacity, half[stored.offset("colour0") :])


def _element(code: Value, exponent: Value) -> Value:
    """An element of L as a float, with the sign on top if it has one."""
    magnitude, sign = code[: MAGNITUDE.width], code[MAGNITUDE.width :]
    number = Const(0, FACTOR.exponent + FACTOR.fraction)
    for place in range(MAGNITUDE.width):  # of the leading one
        fraction = magnitude[:place].shift_left(FACTOR.fraction - place)
        biased = (exponent + place + 1)[: FACTOR.exponent]
        number = Mux(magnitude[place], Cat(fraction, biased), number)
    return Cat(number, sign)
