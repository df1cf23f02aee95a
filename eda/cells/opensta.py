"""Files for OpenSTA (`sta`): a netlist of cells, timing of memories, constraints, a script."""

import re
from pathlib import Path

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.static_timing import Assumed, Timing
from splatcore.eda.gates.macros import PORTS
from splatcore.eda.template import filled, write_texts


def write_opensta(
    timing: Timing, liberty: str | Path, module: str, folder: Path, shipped: str | None = None
) -> list[Path]:
    """Write the files for OpenSTA into a folder.

    liberty: the library's file
    module: name of the netlist and of its files
    shipped: the delivered constraints; they get a separate script
    Returns the paths of the files.
    """
    netlist, assumed = timing.netlist, timing.assumed
    ports = netlist.port_names("clk")
    facts = {"module": module, "liberty": Path(liberty).absolute()}
    files = {"netlist": f"{module}.v", "script": f"{module}.tcl", "constraints": f"{module}.sdc"}
    period = timing.longest.time
    texts = {
        files["netlist"]: verilog(netlist, module),
        files["script"]: filled("cells/timing.tcl", **facts, **files),
        files["constraints"]: filled(
            "cells/timing.sdc",
            assumed=assumed,
            period=period,
            inputs=ports[True],
            outputs=ports[False],
        ),
        f"{module}_memories.lib": memories(netlist, assumed),
    }
    if shipped is not None:
        files |= {"script": "shipped.tcl", "constraints": "splatcore.sdc"}
        texts |= {
            "shipped.tcl": filled("cells/timing.tcl", **facts, **files),
            "splatcore.sdc": shipped,
        }
    return write_texts(folder, texts)


def memories(netlist: CellNetlist, assumed: Assumed) -> str:
    """A liberty file of a netlist's memories."""
    pins = {}
    for _, module, ports in netlist.memories:
        named = zip(PORTS, ports, strict=True)
        pins[module] = {name: len(port.nets) for name, port in named if name != "clk"}
    widths = sorted({width for each in pins.values() for width in each.values() if width > 1})
    return filled(
        "cells/memories.lib", memories=pins, widths=widths, load=sum(assumed.load) / 2,
        access=assumed.access, setup=assumed.memory_setup, slew=assumed.fo4,
    )  # fmt: skip


def verilog(netlist: CellNetlist, module: str) -> str:
    """A netlist as one flat Verilog module; flip-flops are named after their registers."""
    nets = {0: "1'b0", 1: "1'b1"}
    lines, assigned = [f"module {module} (", f"  {', '.join(p.name for p in netlist.ports)});"], []
    for port in netlist.ports:
        wide = len(port.nets) > 1
        lines.append(
            f"  {'input' if port.is_input else 'output'} "
            f"{f'[{len(port.nets) - 1}:0] ' if wide else ''}{port.name};"
        )
        for bit, net in enumerate(port.nets):
            text = f"{port.name}[{bit}]" if wide else port.name
            if nets.setdefault(int(net), text) != text:
                assigned.append(f"  assign {text} = {nets[int(net)]};")
    used = {int(net) for net in netlist.pins.flat}
    used |= {int(net) for *_, ports in netlist.memories for port in ports for net in port.nets}
    for net in sorted(used - nets.keys()):
        nets[net] = f"n{net}"
        lines.append(f"  wire n{net};")
    lines += assigned
    taken: set[str] = set()
    for cell, cells, _ in netlist.by_kind():
        pins = (*cell.inputs, *cell.functions)
        for number in cells:
            name = _identifier(netlist.register(number)) if cell.is_flip_flop else f"u{number}"
            name = f"u{number}" if name in taken else name
            taken.add(name)
            row = zip(pins, netlist.pins[number], strict=False)
            inside = ", ".join(
                f".{pin}({nets[int(net)]})" for pin, net in row if net or pin in cell.inputs
            )
            lines.append(f"  {cell.name} {name} ({inside});")
    for path, kind, ports in netlist.memories:
        row = zip(PORTS, ports, strict=True)
        inside = ", ".join(
            f".{name}({{{', '.join(nets[int(net)] for net in port.nets[::-1])}}})"
            for name, port in row
        )
        lines.append(f"  {kind} {_identifier(path)} ({inside});")
    return "\n".join([*lines, "endmodule\n"])


def _identifier(name: str) -> str:
    """A name as a Verilog identifier, escaped if necessary."""
    return name if re.fullmatch(r"[A-Za-z_]\w*", name) else f"\\{name} "
