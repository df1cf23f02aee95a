"""Simulation of netlists of cells: Verilog models of the cells, from the liberty file's functions.

Gates are assignments, which take Verilator half the time and memory of instances. Memories are the
modules that the RTL has, without macros. Nothing has a delay.
"""

import re

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.liberty import Cell, expression
from splatcore.eda.cells.opensta import verilog
from splatcore.eda.gates.macros import memory_size, module


def simulated(netlist: CellNetlist) -> str:
    """Verilog of a netlist as module `top`, with its flip-flops, clock gates and memories."""
    kinds = [cell for cell, _, _ in netlist.by_kind()]
    gates = {cell.name: _outputs(cell) for cell in kinds if not cell.state}
    models = "\n".join(cell_model(cell) for cell in kinds if cell.state)
    sizes = sorted({memory_size(kind) for _, kind, _ in netlist.memories})
    return "\n".join([verilog(netlist, "top", gates), models, *(module(*size) for size in sizes)])


def cell_model(cell: Cell) -> str:
    """Verilog of a gate, flip-flop or clock gate; ValueError for another kind of cell."""
    pins = ", ".join(
        f"{way} {pin}"
        for way, its in (("input", cell.inputs), ("output", cell.functions))
        for pin in its
    )
    lines = [f"module {cell.name} ({pins});"]
    if cell.is_clock_gate:
        (output,) = cell.functions
        latch = f"  always @* if (~{cell.clock}) IQ = {cell.data};"
        return "\n".join([
            *lines, "  reg IQ;", latch, f"  assign {output} = {cell.clock} & IQ;", "endmodule\n"
        ])  # fmt: skip
    if cell.state:
        lines += _flip_flop(cell)
    lines += [f"  assign {pin} = {text};" for pin, text in _outputs(cell).items()]
    return "\n".join([*lines, "endmodule\n"])


def _outputs(cell: Cell) -> dict[str, str]:
    """Verilog expression of each output; ValueError for one of other names than the inputs'."""
    found, names = {}, {*cell.inputs, "IQ", "IQN", "0", "1"}
    for pin, function in cell.functions.items():
        text = expression(function)
        if cell.state:
            text = "IQ" if function.strip("() ") == cell.state["variable"] else "IQN"
        if not text or set(re.findall(r"\w+", text)) - names:
            raise ValueError(f"{cell.name}: no model for pin {pin}, {function!r}")
        found[pin] = re.sub(r"\b([01])\b", r"1'b\1", text)
    return found


def _flip_flop(cell: Cell) -> list[str]:
    """The state of a flip-flop, which may be cleared and preset at any time; clearing wins."""
    if not cell.is_flip_flop:
        raise ValueError(f"{cell.name}: no model for a cell with {', '.join(cell.state)}")
    lines, edges, before = ["  reg IQ;", "  wire IQN = ~IQ;"], [f"posedge {cell.clock}"], ""
    for name, value in (("clear", 0), ("preset", 1)):
        if name in cell.state:
            lines.append(f"  wire {name} = {expression(cell.state[name])};")
            edges.append(f"posedge {name}")
            before += f"if ({name}) IQ <= 1'b{value}; else "
    lines.append(f"  always @({' or '.join(edges)}) {before}IQ <= {cell.data};")
    return lines
