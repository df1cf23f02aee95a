"""Logic between registers and memories, read from yosys's JSON."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import count, islice

from splatcore.eda.cells.cell_netlist import plain
from splatcore.eda.cells.liberty import Library
from splatcore.eda.gates.macros import memory_name


class DifferenceError(AssertionError):
    """A netlist that differs from its RTL, or that cannot be proven equal."""


@dataclass
class Logic:
    """Logic between cuts; nets are numbers, or "0", "1".

    inputs, outputs: nets of ports and memories by name
    registers: input and output of each
    instances: cell of the netlist that has the register, by its output
    gates: operands and output of each AND; an inverter has one operand
    names: nets by name, several per net
    initial: initial values of nets
    clocks: the net of each register
    gated: enable and clock behind each clock gate
    """

    inputs: dict[str, int]
    outputs: dict[str, int | str]
    registers: dict[int, int | str]
    instances: dict[int, str]
    gates: list[tuple[list, int]]
    names: dict[str, int | str]
    initial: dict[int, str]
    clocks: dict[int, int | str]
    gated: dict[int, tuple[int | str, int | str]]

    @classmethod
    def of(cls, text: str, library: Library | None = None) -> "Logic":
        """Read yosys's JSON; DifferenceError if a register has another clock than the port.

        library: with the clock gates of the netlist
        """
        top, found = json.loads(text)["modules"]["top"], cls({}, {}, {}, {}, [], {}, {}, {}, {})
        kinds, undefined = library.cells if library else {}, count(-1, -1)
        for name, port in top["ports"].items():
            to = found.inputs if port["direction"] == "input" else found.outputs
            to.update(_bits(name, _defined(port["bits"], undefined)))
        for name, cell in top["cells"].items():
            nets = {pin: _defined(bits, undefined) for pin, bits in cell["connections"].items()}
            if (kind := kinds.get(cell["type"])) and kind.is_clock_gate:
                (output,) = kind.functions
                found.gated[nets[output][0]] = nets[kind.data][0], nets[kind.clock][0]
            else:
                found.add(name, cell, nets)
        found.enable(undefined)
        found.names = names_in(top)
        for net in top["netnames"].values():
            values = net["attributes"].get("init", "")[::-1]
            found.initial.update(
                (bit, value) for bit, value in zip(net["bits"], values, strict=False)
                if value in "01"
            )  # fmt: skip
        if other := {*found.clocks.values()} - {found.inputs.get("clk")}:
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
                self.clocks[nets["Q"][0]] = nets["C"][0]
            case kind if kind.startswith(memory_name(0, 0).removesuffix("0x0")):
                for port, bits in nets.items():
                    is_input = cell["port_directions"][port] == "output"
                    to = self.inputs if is_input else self.outputs
                    to.update(_bits(f"{plain(name)}.{port}", bits))
            case kind:
                raise DifferenceError(f"{name}: no logic for {kind}")

    def enable(self, numbers: Iterator[int]):
        """Registers behind a clock gate keep their values if it is not enabled.

        numbers: of new nets
        """
        for register, clock in self.clocks.items():
            while clock in self.gated:
                enable, clock = self.gated[clock]
                off, moves, stays, unmoved, unstayed, neither, then = islice(numbers, 7)
                self.gates += [
                    ([enable], off), ([enable, self.registers[register]], moves),
                    ([off, register], stays), ([moves], unmoved), ([stays], unstayed),
                    ([unmoved, unstayed], neither), ([neither], then),
                ]  # fmt: skip
                self.registers[register] = then
                self.clocks[register] = clock

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


def names_in(top: dict) -> dict[str, int | str]:
    """Nets of a module by name, without those that yosys named."""
    found: dict[str, int | str] = {}
    for name, net in top["netnames"].items():
        if not net["hide_name"]:
            found.update(_bits(name.removeprefix("\\"), net["bits"]))
    return found
