"""Mapping of a netlist to a library's cells, by yosys and its ABC."""

import json
from dataclasses import dataclass

from splatcore.sim.eda.liberty import Library
from splatcore.sim.eda.synth import UNMAPPED, Netlist

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

FANOUT_MAX = 8

PASS = """\
st
if -g -C 24 -K 6
st
dch -f
map -B 0.9
"""
"""Balances logic (`if -g`) before it is mapped."""

SIZES = f"""\
topo
buffer -p -N {FANOUT_MAX}
upsize -D 1
dnsize -D 1
"""
"""`buffer -p -N` makes trees behind what has a larger fan-out, registers (-p) included; `buffer -c`
buffers every gate of a critical path instead. The time asked for, 1 ps, is never reached: all that
makes paths shorter is done."""

PASSES = 2
"""The second one begins with the gates that the first one found."""


def recipe(passes: int) -> str:
    """What ABC does, with so many passes of balancing and mapping."""
    return "\nstrash\nifraig\n" + passes * PASS + SIZES


SUMS = ("", "-booth", "-extra-map +/choices/kogge-stone.v")
"""How sums and products are made, as options of yosys's `synth`: carries by Brent and Kung's tree
and products from a row for each bit; products from Booth's rows, half as many; carries by Kogge and
Stone's tree, which has a smaller fan-out and more gates. Which is fastest depends on what is around
them."""

CONSTRAINTS = """\
set_driving_cell {driver}
set_load {load:.3f} [all_outputs]
"""
"""A register drives about as well as a buffer of the second size; each output drives a register."""


@dataclass(frozen=True)
class Mapped:
    """A netlist of library cells, memories and black boxes; bits are numbers, or "0", "1", "x".

    cells: kind, name, a bit for each of the kind's pins, inputs first. blocks: module, name, bits
    by port. ports: name, direction, bits, in order. names: of bits, as the source has them.
    """

    cells: list[tuple[str, str, list]]
    blocks: list[tuple[str, str, list[list]]]
    ports: list[tuple[str, str, list]]
    names: dict[str, str]


def mapped(netlist: Netlist, library: Library, sums: str = "", passes: int = PASSES) -> Mapped:
    """A netlist in cells of a library, sums made in a way of `SUMS`; synthesised unless known."""
    left_out = " ".join(f"-dont_use {name}" for name in library.left_out())
    load = 1000 * sum(library.flip_flop.inputs[library.flip_flop.data]) / 2
    constraints = CONSTRAINTS.format(driver=library.driver.name, load=load)
    files = {"cells.lib": library.text, "recipe": recipe(passes), "constraints": constraints}
    pins = {cell.name: (*cell.inputs, *cell.functions) for cell in library.cells.values()}
    script = MAP.format(left_out=left_out, sums=sums)
    return Mapped(**netlist.run(script, lambda found: _summary(found, pins), files))


def _summary(files: dict[str, str], pins: dict[str, tuple[str, ...]]) -> dict:
    """The netlist that yosys has written, as `Mapped` has it."""
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
