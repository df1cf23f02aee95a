"""Facts that hold in all states of the RTL, and circuits that prove them, or that a netlist equals
the RTL, in BLIF."""

import json
import re
from dataclasses import dataclass

from splatcore.eda.cells.logic import Logic, names_in


@dataclass
class Facts:
    """Facts that hold in each cycle of the RTL, supposed at first; `circuit` has the proof.

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

    def seen_in(self, logic: Logic, other: Logic) -> "Facts":
        """The same facts on the registers of these names in other logic."""
        to = {net: other.names[name] for name, net in logic.names.items() if name in other.names}
        same = {to[net]: to.get(equal, equal) for net, equal in self.same.items()}
        return Facts(same, {tuple(to[n] for n in word): list(b) for word, b in self.below.items()})

    def drop(self, left: list):
        """Remove facts that could not be proven."""
        for fact in left:
            if fact in self.same:
                del self.same[fact]
            else:
                self.below[fact].pop(0)
                if not self.below[fact]:
                    del self.below[fact]


def circuit(
    logic: Logic,
    facts: Facts,
    cells: Logic | None = None,
    matched: dict[int, int] | None = None,
    only: set | None = None,
) -> tuple[list, str]:
    """A circuit in BLIF and the names of its outputs, which are 1 where facts of the RTL do not
    hold in the next cycle, or where a netlist differs from it.

    The output of a register that equals another is called by its net, a word's by its nets. No
    input of the circuit gives a word that is not below its bound.

    logic: of the RTL
    cells: of the netlist
    matched: the RTL's register of each register of the netlist
    only: names of the outputs; all if None
    """
    blif = Blif([], [], [])
    words = {net for word in facts.below for net in word}
    free = [*logic.inputs.values(), *(logic.registers.keys() - facts.same.keys() - words)]
    inputs = [f"r{net}" for net in free] + [f"f{net}" for net in sorted(words)]
    for side, its in (("r", logic), ("c", cells))[: 2 if cells else 1]:
        inputs += [f"{side}{net}" for net in its.undefined]
        blif.logic(side, its)
    blif.facts(logic, facts)
    if cells:
        blif.compared(logic, cells, matched)
    if only is not None:
        kept = [k for k, name in enumerate(blif.names) if name in only]
        blif.names, blif.pairs = ([each[k] for k in kept] for each in (blif.names, blif.pairs))
    for number, pair in enumerate(blif.pairs):
        blif.table(pair, f"o{number}", "10", "01")
    head = [".model circuit", " ".join([".inputs", *inputs])]
    head.append(" ".join([".outputs", *(f"o{k}" for k in range(len(blif.names)))]))
    return blif.names, "\n".join([*head, *blif.lines, ".end\n"])


@dataclass
class Blif:
    """Tables of a circuit, and pairs of nets that must be equal, with their names.

    Nets of the RTL begin with r, those of the netlist with c.
    """

    lines: list[str]
    names: list
    pairs: list[list[str]]

    def table(self, nets: list[str], output: str, *rows: str):
        """Add a table. rows: patterns of the nets for which the output is 1."""
        self.lines.append(" ".join([".names", *nets, output]))
        self.lines.extend(f"{row} 1".strip() for row in rows)

    def beyond(self, nets: list[str], bound: int, output: str):
        """Add a comparison of a word: whether it is at its bound or above."""
        rows = (f"{value:0{len(nets)}b}"[::-1] for value in range(bound, 1 << len(nets)))
        self.table(nets, output, *rows)

    def logic(self, side: str, logic: Logic):
        """Add the gates of one side."""
        for value in "01":
            self.table([], side + value, *[""] * (value == "1"))
        for operands, output in logic.gates:
            nets = [f"{side}{operand}" for operand in operands]
            self.table(nets, f"{side}{output}", "11" if len(nets) == 2 else "0")

    def facts(self, logic: Logic, facts: Facts):
        """Add facts on this cycle, and their pairs for the next one."""
        for net, same in facts.same.items():
            self.table([f"r{same}"], f"r{net}", "1")
            self.names.append(net)
            self.pairs.append([f"r{logic.registers[net]}", f"r{logic.registers.get(same, same)}"])
        for word, (bound, *_) in facts.below.items():
            self.beyond([f"f{net}" for net in word], bound, f"b{word[0]}")
            for net in word:
                self.table([f"f{net}", f"b{word[0]}"], f"r{net}", "10")
            self.beyond([f"r{logic.registers[net]}" for net in word], bound, f"d{word[0]}")
            self.names.append(word)
            self.pairs.append([f"d{word[0]}", "r0"])

    def compared(self, logic: Logic, cells: Logic, matched: dict[int, int]):
        """Add pairs of RTL and netlist; inputs and registers of both are equal."""
        both = [(net, cells.inputs[name]) for name, net in logic.inputs.items()]
        for net, other in [*both, *((own, net) for net, own in matched.items())]:
            self.table([f"r{net}"], f"c{other}", "1")
        for name, net in logic.outputs.items():
            self.names.append(name)
            self.pairs.append([f"r{net}", f"c{cells.outputs[name]}"])
        for net, own in matched.items():
            self.names.append(f"{cells.instances[net]}'")
            self.pairs.append([f"r{logic.registers[own]}", f"c{cells.registers[net]}"])
