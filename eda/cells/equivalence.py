"""Equivalence of a netlist of cells and its RTL, proven by yosys and ABC.

Both are cut at registers and memories: outputs of these are inputs of the logic, inputs of these
its outputs. ABC proves that RTL and netlist have the same outputs for all inputs. So if registers
and memories of both have equal contents in one cycle, they have in all later cycles, and outputs
are equal (induction over one cycle). Cells are read from the liberty file by yosys.

Two facts on the RTL alone are proven first, by induction from its initial values: registers that
synthesis left out keep theirs; addresses stay below the sizes of memories of flip-flops, since a
word beyond the end is undefined. An undefined bit may have any value, different ones in RTL and
netlist. The netlist has no initial values: that it begins in a state of the RTL is assumed.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count

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
"""As in synthesis, registers of the RTL with equal inputs and initial values become one."""

READ = (
    "read_rtlil top.il\nread_verilog -lib macros.v\nhierarchy -top top\nproc\n"
    + GATES.format(more=MERGED)
    + "write_json rtl.json\ndesign -reset\nread_liberty -ignore_miss_func cells.lib\n"
    + "read_verilog -lib macros.v\nread_verilog netlist.v\nhierarchy -top top\nproc\n"
    + GATES.format(more="opt_expr\nopt_dff -nodffe -nosdff")
    + "write_json netlist.json\n"
)
"""In the netlist, resets of cells that are tied to a constant are removed."""

ABC = """\
write_blif any.blif
read_blif circuit.blif
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
    """What was proven.

    bits: equal ones: outputs, inputs of memories, next values of registers
    registers: of the netlist
    constants: registers of the RTL that keep their initial values, left out of the netlist
    """

    bits: int
    registers: int
    constants: int


@dataclass
class Logic:
    """Logic between cuts; nets are numbers, or "0", "1".

    inputs, outputs: nets of ports and memories by name
    registers: input and output of each
    instances: cell of the netlist that has the register, by its output
    gates: operands and output of each AND; an inverter has one operand
    names: nets by name, several per net
    initial: initial values of nets
    clocks: nets
    """

    inputs: dict[str, int]
    outputs: dict[str, int | str]
    registers: dict[int, int | str]
    instances: dict[int, str]
    gates: list[tuple[list, int]]
    names: dict[str, int | str]
    initial: dict[int, str]
    clocks: set[int | str]

    @classmethod
    def of(cls, text: str) -> "Logic":
        """Read yosys's JSON; DifferenceError if a register has another clock than the port."""
        top, found = json.loads(text)["modules"]["top"], cls({}, {}, {}, {}, [], {}, {}, set())
        undefined = count(-1, -1)
        for name, port in top["ports"].items():
            to = found.inputs if port["direction"] == "input" else found.outputs
            to.update(_bits(name, _defined(port["bits"], undefined)))
        for name, cell in top["cells"].items():
            nets = {pin: _defined(bits, undefined) for pin, bits in cell["connections"].items()}
            found.add(name, cell, nets)
        for name, net in top["netnames"].items():
            if not net["hide_name"]:
                found.names.update(_bits(name.removeprefix("\\"), net["bits"]))
            values = net["attributes"].get("init", "")[::-1]
            found.initial.update(
                (bit, value) for bit, value in zip(net["bits"], values, strict=False)
                if value in "01"
            )  # fmt: skip
        if other := found.clocks - {found.inputs.get("clk")}:
            raise DifferenceError(f"{len(other)} clocks are not the port clk")
        return found

    def add(self, name: str, cell: dict, nets: dict[str, list]):
        """Add a gate, a register, or the cuts of a memory."""
        match cell["type"]:
            case "$_AND_":
                self.gates.append((nets["A"] + nets["B"], nets["Y"][0]))
            case "$_NOT_":
                self.gates.append((nets["A"], nets["Y"][0]))
            case "$_DFF_P_":
                self.registers[nets["Q"][0]] = nets["D"][0]
                self.instances[nets["Q"][0]] = re.sub(r"^\$flatten.|\.\$auto\$.*", "", name)
                self.clocks.add(nets["C"][0])
            case kind if kind.startswith(memory_name(0, 0).removesuffix("0x0")):
                for port, bits in nets.items():
                    is_input = cell["port_directions"][port] == "output"
                    to = self.inputs if is_input else self.outputs
                    to.update(_bits(f"{re.sub(r'[$][0-9]+$', '', _plain(name))}.{port}", bits))
            case kind:
                raise DifferenceError(f"{name}: no logic for {kind}")

    @cached_property
    def undefined(self) -> set[int]:
        """Nets without a driver."""
        used = {net for nets, _ in self.gates for net in nets}
        used |= {*self.outputs.values(), *self.registers.values()}
        driven = {net for _, net in self.gates} | {*self.inputs.values(), *self.registers}
        return used - driven - {"0", "1"}


def _defined(bits: list, undefined: Iterator[int]) -> list:
    """Bits with another net for each undefined one."""
    return [next(undefined) if bit in ("x", "z") else bit for bit in bits]


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
    matched = _matched(logic, cells)
    sizes = {int(size) for size in re.findall(r"^ *memory .*\bsize (\d+)", rtl.text, re.M)}
    facts = _facts(logic, logic.registers.keys() - set(matched.values()), sizes)
    names, text = _circuit(logic, facts, cells, matched)
    if left := _left(names, text):
        raise DifferenceError(
            f"{len(left)} of {len(names)} bits are not proven equal: {_few(left)}"
        )
    registers = len(set(cells.instances.values()))
    return Proof(len(names), registers, len(facts.constants))


def _few(names: list) -> str:
    return ", ".join(map(str, names[:SHOWN])) + (", …" if len(names) > SHOWN else "")


def _matched(logic: Logic, cells: Logic) -> dict[int, int]:
    """The RTL's register of each register of the netlist, by name; a flip-flop with an inverted
    output is read as two registers."""
    own = {_plain(name): net for name, net in logic.names.items() if net in logic.registers}
    names = {net: _plain(name) for net, name in cells.instances.items()}
    names = {n: name if name in own else name.removesuffix("_reg") for n, name in names.items()}
    if unknown := sorted(set(names.values()) - own.keys()):
        raise DifferenceError(f"{len(unknown)} registers are not in the RTL: {_few(unknown)}")
    return {net: own[name] for net, name in names.items()}


@dataclass
class Facts:
    """What holds in each cycle of the RTL.

    constants: registers with their values
    below: words, as nets from the lowest bit on, with the bounds that may hold, the lowest first
    """

    constants: dict[int, str]
    below: dict[tuple[int, ...], list[int]]

    def drop(self, left: list):
        """Remove facts that could not be proven."""
        for fact in left:
            if fact in self.constants:
                del self.constants[fact]
            else:
                self.below[fact].pop(0)
                if not self.below[fact]:
                    del self.below[fact]


def _facts(logic: Logic, rest: set[int], sizes: set[int]) -> Facts:
    """Prove facts: if all hold in one cycle, they do in the next one.

    rest: registers that the netlist lacks
    sizes: words of memories of flip-flops
    """
    known = logic.registers.keys() & logic.initial.keys()
    facts, words = Facts({net: logic.initial[net] for net in sorted(rest & known)}, {}), {}
    for name, net in logic.names.items() if logic.undefined else ():
        words.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(net)
    free = known - rest
    for word in map(tuple, words.values()):
        first = "".join(logic.initial.get(net, "") for net in reversed(word))
        bounds = [size for size in sorted(sizes) if 1 << len(word) - 1 < size < 1 << len(word)]
        if free >= {*word} and (bounds := [size for size in bounds if int(first, 2) < size]):
            facts.below[word], free = bounds, free - {*word}
    while left := _left(*_circuit(logic, facts)):
        facts.drop(left)
    return facts


def _circuit(
    logic: Logic, facts: Facts, cells: Logic | None = None, matched: dict[int, int] | None = None
) -> tuple[list, str]:
    """A circuit in BLIF and the names of its outputs, which are 1 where facts of the RTL do not
    hold in the next cycle, or where a netlist differs from it.

    A constant's output is called by its net, a word's by its nets. No input of the circuit gives a
    word that is not below its bound.
    """
    lines, names, pairs = [], [], []

    def table(nets: list[str], output: str, *rows: str):
        lines.append(" ".join([".names", *nets, output]))
        lines.extend(f"{row} 1".strip() for row in rows)

    def beyond(nets: list[str], bound: int, output: str):
        rows = (f"{value:0{len(nets)}b}"[::-1] for value in range(bound, 1 << len(nets)))
        table(nets, output, *rows)

    words = {net for word in facts.below for net in word}
    free = [*logic.inputs.values(), *(logic.registers.keys() - facts.constants.keys() - words)]
    inputs = [f"r{net}" for net in free] + [f"f{net}" for net in sorted(words)]
    for side, its in (("r", logic), ("c", cells))[: 2 if cells else 1]:
        inputs += [f"{side}{net}" for net in its.undefined]
        for value in "01":
            table([], side + value, *[""] * (value == "1"))
        for operands, output in its.gates:
            nets = [f"{side}{operand}" for operand in operands]
            table(nets, f"{side}{output}", "11" if len(nets) == 2 else "0")
    for net, value in facts.constants.items():
        table([], f"r{net}", *[""] * (value == "1"))
        names.append(net)
        pairs.append([f"r{logic.registers[net]}", f"r{value}"])
    for word, (bound, *_) in facts.below.items():
        beyond([f"f{net}" for net in word], bound, f"b{word[0]}")
        for net in word:
            table([f"f{net}", f"b{word[0]}"], f"r{net}", "10")
        beyond([f"r{logic.registers[net]}" for net in word], bound, f"d{word[0]}")
        names.append(word)
        pairs.append([f"d{word[0]}", "r0"])
    if cells:
        both = [(net, cells.inputs[name]) for name, net in logic.inputs.items()]
        for net, other in [*both, *((own, net) for net, own in matched.items())]:
            table([f"r{net}"], f"c{other}", "1")
        for name, net in logic.outputs.items():
            names.append(name)
            pairs.append([f"r{net}", f"c{cells.outputs[name]}"])
        for net, own in matched.items():
            names.append(f"{cells.instances[net]}'")
            pairs.append([f"r{logic.registers[own]}", f"c{cells.registers[net]}"])
    for number, pair in enumerate(pairs):
        table(pair, f"o{number}", "10", "01")
    head = [".model circuit", " ".join([".inputs", *inputs])]
    head.append(" ".join([".outputs", *(f"o{k}" for k in range(len(names)))]))
    return names, "\n".join([*head, *lines, ".end\n"])


def _left(names: list, text: str) -> list:
    """Names of a circuit's outputs that are not proven to be always 0."""
    if not names:
        return []
    found = yosys(PROVE, {"any.v": ANY, "prove": ABC, "circuit.blif": text})["left.blif"]
    tables = re.findall(r"^\.names (.*)\n((?:[^.\n].*\n)*)", found, re.M)
    zero = {nets for nets, rows in tables if not re.search(r"1$", rows, re.M)}
    return [name for number, name in enumerate(names) if f"o{number}" not in zero]
