"""Equivalence of a netlist of cells and its RTL, proven by yosys and ABC.

Both are cut at registers and memories: outputs of these are inputs of the logic, inputs of these
its outputs. ABC proves that RTL and netlist have the same outputs for all inputs. So if registers
and memories of both have equal contents in one cycle, they have in all later cycles, and outputs
are equal (induction over one cycle). Synthesis leaves out a register that keeps its initial value;
that it is never changed is proven, too. Cells are read from the liberty file by yosys. An undefined
bit is 0.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass

from splatcore.eda.cells.liberty import Library
from splatcore.eda.gates.macros import memory_name, module
from splatcore.eda.gates.synth import Netlist, yosys

GATES = """
flatten -noscopeinfo
memory_collect
memory_map
techmap
simplemap
{more}
dfflegalize -cell $_DFF_P_ 01
aigmap
opt_clean
"""
"""ANDs, inverters and flip-flops; no register may be removed as unused or constant."""

MERGED = "opt_dff -nosdff\nopt_merge\ndffunmap\nsimplemap\nsetattr -set keep 1 t:$_DFF_*"
"""As in synthesis, registers of the RTL with equal inputs become one."""

READ = (
    "read_rtlil top.il\nread_verilog -lib macros.v\nhierarchy -top top\nproc\n"
    + GATES.format(
        more="opt_dff -nosdff\nopt_merge\ndffunmap\nsimplemap\nsetattr -set keep 1 t:$_DFF_*"
    )
    + "write_json rtl.json\ndesign -reset\nread_liberty -ignore_miss_func cells.lib\n"
    + "read_verilog -lib macros.v\nread_verilog netlist.v\nhierarchy -top top\nproc\n"
    + GATES.format(more="opt_expr\nopt_dff -nodffe -nosdff")
    + "write_json netlist.json\n"
)
"""In the netlist, resets of cells that are tied to a constant are removed."""

ABC = """\
write_blif any.blif
read_blif miter.blif
strash
ifraig
fraig -C 10000 -D 10000
write_blif left.blif
read_blif any.blif
"""
"""ABC's own output is lost, so the outputs that are not proven to be 0 are read from `left.blif`;
yosys wants back the module that it gave."""

PROVE = "read_verilog any.v\nproc\ntechmap\nabc -script prove\n"
ANY = "module any(input a, b, output y); assign y = a & b; endmodule\n"

SHOWN = 5  # names of differing bits in a message


class DifferenceError(AssertionError):
    """A netlist that differs from its RTL, or that cannot be proven equal."""


@dataclass(frozen=True)
class Proof:
    """Bits that were proven equal.

    points: all, registers and inputs of memories included
    registers: registers of the netlist
    constants: registers of the RTL that keep their initial values, left out of the netlist
    """

    points: int
    registers: int
    constants: int


@dataclass
class Logic:
    """Logic between cuts; nets are numbers, or "0", "1", "x".

    inputs, outputs: nets of ports and memories by name
    registers: input and output of each
    gates: operands and output of each AND; an inverter has one operand
    names: nets by name, several per net
    initial: initial values of nets
    """

    inputs: dict[str, int]
    outputs: dict[str, int | str]
    registers: dict[int, int | str]
    gates: list[tuple[list, int]]
    names: dict[str, int | str]
    initial: dict[int, str]

    @classmethod
    def of(cls, text: str) -> "Logic":
        """Read yosys's JSON."""
        top, found = json.loads(text)["modules"]["top"], cls({}, {}, {}, [], {}, {})
        for name, port in top["ports"].items():
            to = found.inputs if port["direction"] == "input" else found.outputs
            to.update(_bits(name, port["bits"]))
        for name, cell in top["cells"].items():
            found.add(_plain(name), cell)
        for name, net in top["netnames"].items():
            if not net["hide_name"]:
                found.names.update(_bits(name, net["bits"]))
            values = net["attributes"].get("init", "")[::-1]
            found.initial.update(
                (bit, value) for bit, value in zip(net["bits"], values, strict=False)
                if value in "01"
            )  # fmt: skip
        return found

    def add(self, name: str, cell: dict):
        """Add a gate, a register, or the cuts of a memory."""
        nets = cell["connections"]
        match cell["type"]:
            case "$_AND_":
                self.gates.append((nets["A"] + nets["B"], nets["Y"][0]))
            case "$_NOT_":
                self.gates.append((nets["A"], nets["Y"][0]))
            case "$_DFF_P_":
                self.registers[nets["Q"][0]] = nets["D"][0]
            case kind if kind.startswith(memory_name(0, 0).removesuffix("0x0")):
                for port, bits in nets.items():
                    is_input = cell["port_directions"][port] == "output"
                    to = self.inputs if is_input else self.outputs
                    to.update(_bits(f"{re.sub(r'[$][0-9]+$', '', name)}.{port}", bits))
            case kind:
                raise DifferenceError(f"{name}: no logic for {kind}")


def _bits(name: str, nets: list) -> Iterator[tuple[str, int | str]]:
    return ((f"{name}[{k}]" if len(nets) > 1 else name, net) for k, net in enumerate(nets))


def _plain(name: str) -> str:
    """A name without the numbers that make names of instances unique."""
    return re.sub(r"\$\d+(?=\.)", "", name)


def prove(rtl: Netlist, netlist: str, library: Library) -> Proof:
    """Prove that a netlist is equivalent to its RTL.

    netlist: Verilog of a module `top` of the library's cells; flip-flops are named after registers
    Raises DifferenceError with the names of bits that differ or could not be proven.
    """
    boxes = "".join(module(*size, blackbox=True) for size in sorted(set(rtl.memories)))
    files = {"top.il": rtl.text, "macros.v": boxes, "cells.lib": library.text}
    found = yosys(READ, files | {"netlist.v": netlist})
    logic, cells = Logic.of(found["rtl.json"]), Logic.of(found["netlist.json"])
    for own, other in ((logic.inputs, cells.inputs), (logic.outputs, cells.outputs)):
        if own.keys() != other.keys():
            raise DifferenceError(f"ports differ: {_few(sorted(own.keys() ^ other.keys()))}")
    matched = _registers(logic, cells, library)
    rest = logic.registers.keys() - {q for q, _ in matched.values()}
    constants = {q: logic.initial[q] for q in sorted(rest) if q in logic.initial}
    while True:
        names, text = _miter(logic, cells, matched, constants)
        left = _left(names, text)
        if not (changed := constants.keys() & left):
            break
        constants = {q: value for q, value in constants.items() if q not in changed}
    if left:
        raise DifferenceError(f"{len(left)} of {len(names)} bits differ: {_few(left)}")
    return Proof(len(names), len(matched), len(constants))


def _few(names: list) -> str:
    return ", ".join(map(str, names[:SHOWN])) + (", …" if len(names) > SHOWN else "")


def _registers(logic: Logic, cells: Logic, library: Library) -> dict[str, tuple[int, int]]:
    """Outputs of each register of the netlist in RTL and netlist, by its name."""
    states = "|".join({cell.state.get("variable", "-") for cell in library.cells.values()})
    own = {_plain(name): net for name, net in logic.names.items() if net in logic.registers}
    names, unknown = {}, set(cells.registers)
    for text, net in cells.names.items():
        name = _plain(re.sub(rf"\.({states})$", "", text))
        name = name if name in own else name.removesuffix("_reg")
        if net in unknown and name in own:
            names[name] = (own[name], net)
            unknown.remove(net)
    if unknown:
        some = [name for name, net in cells.names.items() if net in unknown]
        raise DifferenceError(f"{len(unknown)} registers are not in the RTL: {_few(some)}")
    return names


def _miter(
    logic: Logic, cells: Logic, matched: dict[str, tuple[int, int]], constants: dict[int, str]
) -> tuple[list, str]:
    """A circuit whose outputs are 1 where RTL and netlist differ, in BLIF, and the outputs' names.

    constants: registers of the RTL with their supposed values; the output of each is called by
        its net
    """
    lines, outputs = [], {}

    def table(nets: list[str], output: str, *rows: str):
        lines.append(" ".join([".names", *nets, output]))
        lines.extend(f"{row} 1".strip() for row in rows)

    for side, its in (("r", logic), ("c", cells)):
        for value in "0x1":
            table([], side + value, *[""] * (value == "1"))
        for operands, output in its.gates:
            nets = [f"{side}{operand}" for operand in operands]
            table(nets, f"{side}{output}", "11" if len(nets) == 2 else "0")
    both = [(net, cells.inputs[name]) for name, net in logic.inputs.items()]
    free = {*logic.inputs.values(), *logic.registers} - constants.keys()
    number = {net: number for number, net in enumerate(sorted(free))}
    for net in free:
        table([f"i{number[net]}"], f"r{net}", "1")
    for net, other in [*both, *matched.values()]:
        table([f"i{number[net]}"], f"c{other}", "1")
    for net, value in constants.items():
        table([], f"r{net}", *[""] * (value == "1"))
        outputs[net] = (f"r{logic.registers[net]}", f"c{value}")
    for name, net in logic.outputs.items():
        outputs[name] = (f"r{net}", f"c{cells.outputs[name]}")
    for name, (net, other) in matched.items():
        outputs[f"{name}'"] = (f"r{logic.registers[net]}", f"c{cells.registers[other]}")
    for number, nets in enumerate(outputs.values()):
        table(list(nets), f"o{number}", "10", "01")
    for kind, letter, count in (
        ("outputs", "o", len(outputs)), ("inputs", "i", len(free))
    ):  # fmt: skip
        lines.insert(0, " ".join([f".{kind}", *(f"{letter}{k}" for k in range(count))]))
    return list(outputs), "\n".join([".model miter", *lines, ".end\n"])


def _left(names: list, text: str) -> list:
    """Names of a circuit's outputs that are not proven to be always 0."""
    found = yosys(PROVE, {"any.v": ANY, "prove": ABC, "miter.blif": text})["left.blif"]
    tables = re.findall(r"^\.names (.*)\n((?:[^.\n].*\n)*)", found, re.M)
    zero = {nets for nets, rows in tables if not re.search(r"1$", rows, re.M)}
    if not names:
        raise DifferenceError("nothing to compare")
    return [name for number, name in enumerate(names) if f"o{number}" not in zero]
