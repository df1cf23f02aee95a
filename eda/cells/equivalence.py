"""Equivalence of a netlist of cells and its RTL, proven by yosys and ABC.

Both are cut at registers and memories: outputs of these are inputs of the logic, inputs of these
its outputs. ABC proves that RTL and netlist have the same outputs for all inputs. So if registers
and memories of both have equal contents in one cycle, they have in all later cycles, and outputs
are equal (induction over one cycle). Cells are read from the liberty file by yosys.

Facts on the RTL alone are proven first, by induction from its initial values: registers that
synthesis merged are always equal, those that it replaced by constants have these values; addresses
stay below the sizes of memories of flip-flops, since a word beyond the end is undefined. An
undefined bit may have any value, different ones in RTL and netlist. The netlist has no initial
values: that it begins in a state of the RTL is assumed.
"""

import json
import re
from dataclasses import dataclass

from splatcore.eda.cells.cell_netlist import plain
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.logic import DifferenceError, Logic, names_in
from splatcore.eda.gates.macros import module
from splatcore.eda.gates.synth import UNMAPPED, Netlist, yosys

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
"""ANDs, inverters and flip-flops."""

SYNTHESISED = UNMAPPED.replace("expose -evert\n", "") + "write_json synthesised.json\n"
"""Which registers synthesis merges or replaces by constants shows in the names of its nets."""

READ = SYNTHESISED + (
    "design -reset\nread_rtlil top.il\nread_verilog -lib macros.v\nhierarchy -top top\nproc\n"
    + GATES.format(more="setattr -set keep 1 t:$_DFF*")
    + "write_json rtl.json\ndesign -reset\nread_liberty -ignore_miss_func cells.lib\n"
    + "read_verilog -lib macros.v\nread_verilog netlist.v\nhierarchy -top top\nproc\n"
    + GATES.format(more="opt_expr\nopt_dff -nodffe -nosdff")
    + "write_json netlist.json\n"
)
"""Of the RTL no register is removed, merged or simplified. In the netlist, resets of cells that are
tied to a constant are removed."""

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


@dataclass(frozen=True)
class Proof:
    """Figures of a proof.

    bits: equal ones: outputs, inputs of memories, next values of registers
    registers: of the netlist
    left_out: registers of the RTL that the netlist lacks: equal to constants or other registers
    """

    bits: int
    registers: int
    left_out: int


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
    facts = Facts.supposed(logic, {*matched.values()}, found["synthesised.json"])
    facts.bound(logic, {int(n) for n in re.findall(r"^ *memory .*\bsize (\d+)", rtl.text, re.M)})
    while left := _left(*_circuit(logic, facts)):
        facts.drop(left)
    names, text = _circuit(logic, facts, cells, matched)
    if left := _left(names, text):
        raise DifferenceError(
            f"{len(left)} of {len(names)} bits are not proven equal: {_few(left)}"
        )
    registers = len(set(cells.instances.values()))
    return Proof(len(names), registers, len(facts.same))


def _few(names: list) -> str:
    return ", ".join(map(str, names[:SHOWN])) + (", …" if len(names) > SHOWN else "")


def _matched(logic: Logic, cells: Logic) -> dict[int, int]:
    """The RTL's register of each register of the netlist, by name; a flip-flop with an inverted
    output is read as two registers."""
    own = {name: net for name, net in logic.names.items() if net in logic.registers}
    own = {plain(name): net for name, net in own.items()} | own
    names = {
        net: next((n for n in (name, plain(name)) if n in own), name.removesuffix("_reg"))
        for net, name in cells.instances.items()
    }
    if unknown := sorted(set(names.values()) - own.keys()):
        raise DifferenceError(f"{len(unknown)} registers are not in the RTL: {_few(unknown)}")
    return {net: own[name] for net, name in names.items()}


@dataclass
class Facts:
    """Facts that hold in each cycle of the RTL, supposed at first; `_circuit` has the proof.

    same: registers that the netlist lacks, and what they equal: "0", "1" or another register
    below: words, as nets from the lowest bit on, with the bounds that may hold, the lowest first
    """

    same: dict[int, int | str]
    below: dict[tuple[int, ...], list[int]]

    @classmethod
    def supposed(cls, logic: Logic, there: set[int], synthesised: str) -> "Facts":
        """Registers that synthesis merged or replaced by constants.

        there: registers that the netlist has
        synthesised: yosys's JSON, with names for what is left
        """
        bits, kept = names_in(json.loads(synthesised)["modules"]["top"]), {"0": "0", "1": "1"}
        named = [(net, bits[name]) for name, net in logic.names.items() if name in bits]
        kept |= {bit: net for net, bit in named if net in there}
        start = logic.initial | {"0": "0", "1": "1"}
        return cls({
            net: kept[bit] for net, bit in named
            if net in logic.registers.keys() - there and bit in kept
            and net in start and start[net] == start.get(kept[bit])
        }, {})  # fmt: skip

    def bound(self, logic: Logic, sizes: set[int]):
        """Suppose that registers as wide as an address stay below the size of a memory.

        sizes: words of memories of flip-flops
        """
        words: dict[str, list] = {}
        for name, net in logic.names.items() if logic.undefined else ():
            words.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(net)
        free = (logic.registers.keys() & logic.initial.keys()) - self.same.keys()
        for word in map(tuple, words.values()):
            bounds = [size for size in sorted(sizes) if 1 << len(word) - 1 < size < 1 << len(word)]
            if bounds and free >= {*word}:
                first = int("".join(logic.initial[net] for net in reversed(word)), 2)
                if bounds := [size for size in bounds if first < size]:
                    self.below[word], free = bounds, free - {*word}

    def drop(self, left: list):
        """Remove facts that could not be proven."""
        for fact in left:
            if fact in self.same:
                del self.same[fact]
            else:
                self.below[fact].pop(0)
                if not self.below[fact]:
                    del self.below[fact]


def _circuit(
    logic: Logic, facts: Facts, cells: Logic | None = None, matched: dict[int, int] | None = None
) -> tuple[list, str]:
    """A circuit in BLIF and the names of its outputs, which are 1 where facts of the RTL do not
    hold in the next cycle, or where a netlist differs from it.

    The output of a register that equals another is called by its net, a word's by its nets. No
    input of the circuit gives a word that is not below its bound.
    """
    lines, names, pairs = [], [], []

    def table(nets: list[str], output: str, *rows: str):
        lines.append(" ".join([".names", *nets, output]))
        lines.extend(f"{row} 1".strip() for row in rows)

    def beyond(nets: list[str], bound: int, output: str):
        rows = (f"{value:0{len(nets)}b}"[::-1] for value in range(bound, 1 << len(nets)))
        table(nets, output, *rows)

    words = {net for word in facts.below for net in word}
    free = [*logic.inputs.values(), *(logic.registers.keys() - facts.same.keys() - words)]
    inputs = [f"r{net}" for net in free] + [f"f{net}" for net in sorted(words)]
    for side, its in (("r", logic), ("c", cells))[: 2 if cells else 1]:
        inputs += [f"{side}{net}" for net in its.undefined]
        for value in "01":
            table([], side + value, *[""] * (value == "1"))
        for operands, output in its.gates:
            nets = [f"{side}{operand}" for operand in operands]
            table(nets, f"{side}{output}", "11" if len(nets) == 2 else "0")
    for net, same in facts.same.items():
        table([f"r{same}"], f"r{net}", "1")
        names.append(net)
        pairs.append([f"r{logic.registers[net]}", f"r{logic.registers.get(same, same)}"])
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
