"""Components as Verilog that every kind of simulator runs alike."""

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager

from amaranth.back import verilog
from amaranth.lib import wiring

MODULE = re.compile(r"^module .*?^endmodule$", re.M | re.S)
PORTS = re.compile(r"^module .*?;\n", re.S)
WAKE = re.compile(r"^  reg (\\\S+dump_module\S+ ) = 0;\n", re.M)
"""A register of Yosys that all but the shortest `always @*` blocks look at and none needs."""

SHORTEST = re.compile(r"^  always @\*\n    (.*;)$", re.M)
BLOCK = "  always @* begin\n    if ({0}) begin end\n    {1}\n  end"

CHANGE = "  reg {0};\n  initial {0} <= 1'h0;\n"
"""A change at time 0, when all blocks are waiting."""


COLLECTED_EVERY = 100_000, 50, 50  # objects, collections of the first kind, of the second


@contextmanager
def collecting_rarely() -> Iterator[None]:
    """Python looks for garbage rarely: of the millions of objects that a conversion makes nearly
    all stay, and looking at them again and again is a third of its time."""
    before = gc.get_threshold()
    gc.set_threshold(*COLLECTED_EVERY)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def converted(
    component: wiring.Component, name: str = "top", platform: object = None, emit_src: bool = False
) -> str:
    """The text of a component and all inside it, the module `name` first.

    emit_src: with attributes that name lines of Python. An `always @*` block waits for a change of
    what it reads. Where that keeps its initial value, an event-driven simulator would never run
    the block as Amaranth writes it, and what it assigns would stay unknown: so each block also
    reads a register that changes at time 0.
    """
    with collecting_rarely():
        text = verilog.convert(component, name, platform, emit_src=emit_src)
    return MODULE.sub(lambda found: _woken(found[0]), text)


def _woken(module: str) -> str:
    """A module all of whose blocks run at time 0."""
    if "always @*" not in module:
        return module
    name = "at_time_0"
    while name in module:
        name += "_"
    if wake := WAKE.search(module):
        module = WAKE.sub("", module).replace(wake[1], name)
    module = SHORTEST.sub(lambda found: BLOCK.format(name, found[1]), module)
    return PORTS.sub(lambda found: found[0] + CHANGE.format(name), module, count=1)
