"""Mapping of a netlist to a library's cells by yosys and ABC."""

import json
from dataclasses import dataclass

from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.wire_load import with_wire_loads
from splatcore.eda.gates.synth import UNMAPPED, Netlist, with_clock_gates

MAP = (
    UNMAPPED.replace("expose -evert\n", "").replace("synth ", "synth {sums} ")
    + """
dfflibmap -liberty cells.lib {left_out}
opt_clean
abc -liberty cells.lib {left_out} -constr constraints -script recipe
opt_clean
write_json mapped.json
"""
)

PASS = """\
st
if -g -C 24 -K 6
st
dch -f
map -B 0.9
"""
"""Balances logic (`if -g`), then maps it."""

SIZES = """\
topo
buffer -p -N {fanout}
upsize -c -D 1
dnsize -c -D 1
"""
"""`buffer -p -N` adds buffer trees to nets with a larger fan-out, registers (-p) included (`buffer
-c` would buffer every gate of a critical path). Sizes are chosen with wires (-c). The target of
1 ps is never reached, so that sizing does all it can to shorten paths."""

EFFORTS = (2, 8), (2, 4), (3, 4)
"""Passes of balancing and mapping, and largest fan-out; in this order until a part is fast enough.
Each pass begins with the gates of the previous one."""


def recipe(passes: int, fanout: int) -> str:
    """Script for ABC. passes, fanout: as in `EFFORTS`"""
    return "\nstrash\nifraig\n" + passes * PASS + SIZES.format(fanout=fanout)


SUMS = ("", "-booth", "-extra-map +/choices/kogge-stone.v")
"""Ways to build sums and products, as options of yosys's `synth`: Brent-Kung carry trees and one
row per bit of a product; Booth's products, with half as many rows; Kogge-Stone carry trees, with
smaller fan-out and more gates. The fastest way depends on the surrounding logic."""

CONSTRAINTS = """\
set_driving_cell {driver}
set_load {load:.3f} [all_outputs]
"""
"""Inputs are driven by a buffer of the second size, similar to a register; outputs drive one."""


@dataclass(frozen=True)
class Mapped:
    """A netlist of library cells, memories and black boxes; bits are numbers, or "0", "1", "x".

    cells: kind, name, one bit per pin of the kind, inputs first
    blocks: module, name, bits by port
    ports: name, direction, bits
    names: of bits, from the source
    """

    cells: list[tuple[str, str, list]]
    blocks: list[tuple[str, str, list[list]]]
    ports: list[tuple[str, str, list]]
    names: dict[str, str]


def mapped(
    netlist: Netlist, library: Library, sums: str = "", effort: tuple[int, int] = EFFORTS[0]
) -> Mapped:
    """Map a netlist to a library's cells; results are cached.

    sums: one of `SUMS`
    effort: one of `EFFORTS`
    """
    left_out = " ".join(f"-dont_use {name}" for name in library.left_out())
    load = 1000 * sum(library.flip_flop.inputs[library.flip_flop.data]) / 2
    constraints = CONSTRAINTS.format(driver=library.driver.name, load=load)
    files = {"cells.lib": with_wire_loads(library), "recipe": recipe(*effort)}
    files["constraints"] = constraints
    pins = {cell.name: (*cell.inputs, *cell.functions) for cell in library.cells.values()}
    script = MAP.format(left_out=left_out, sums=sums)
    if gate := library.clock_gate:
        (output,) = gate.functions
        script = with_clock_gates(script, f"{gate.name} {gate.data}:{gate.clock}:{output}")
    return Mapped(**netlist.run(script, lambda found: _summary(found, pins), files))


def _summary(files: dict[str, str], pins: dict[str, tuple[str, ...]]) -> dict:
    """Convert yosys's JSON netlist to the fields of `Mapped`."""
    modules = json.loads(files["mapped.json"])["modules"]
    top = modules["top"]
    names: dict[int, str] = {}
    for name, net in top["netnames"].items():
        name = name.removeprefix("\\")
        for k, bit in enumerate(() if net["hide_name"] else net["bits"]):
            known = names.get(bit)
            if known is None or len(name) < len(known):
                names[bit] = f"{name}[{k}]" if len(net["bits"]) > 1 else name
    cells, blocks = [], []
    for name, cell in top["cells"].items():
        kind, nets = cell["type"], cell["connections"]
        if kind in pins:
            cells.append((kind, name, [nets.get(pin, ["x"])[0] for pin in pins[kind]]))
        else:
            ports = modules[kind]["ports"]
            blocks.append((kind, name, [nets.get(port, []) for port in ports]))
    ports = [(name, port["direction"], port["bits"]) for name, port in top["ports"].items()]
    return {"cells": cells, "blocks": blocks, "ports": ports, "names": names}
