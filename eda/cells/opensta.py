"""Files for OpenSTA (`sta`): a netlist of cells, timing of memories, constraints, a script."""

import re
from collections.abc import Mapping
from pathlib import Path

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.static_timing import Assumed, Timing
from splatcore.eda.deliver.names import identifier
from splatcore.eda.gates.macros import PORTS
from splatcore.eda.template import filled, write_texts

PIN = re.compile(r"(?<!')\b[A-Za-z_]\w*")  # in an expression with constants like 1'b0


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


def verilog(
    netlist: CellNetlist, module: str, gates: Mapping[str, Mapping[str, str]] | None = None
) -> str:
    """A netlist as one flat Verilog module, with the ports of the component's Verilog.

    Flip-flops are named after their registers; one with a port's name ends in _reg.

    gates: kinds of cells that become assignments instead of instances: expression of each output
    """
    taken = {port.name for port in netlist.ports}

    def free(*names: str) -> str:
        """The first of these names that is not used yet, as an identifier."""
        name = next(name for name in names if name not in taken)
        taken.add(name)
        return identifier(name)

    nets, declared, assigned = _ports(netlist)
    used = {int(net) for net in netlist.pins.flat}
    used |= {int(net) for *_, ports in netlist.memories for port in ports for net in port.nets}
    for net in sorted(used - nets.keys()):
        nets[net] = free(f"n{net}", f"n{net}_")
        declared.append(f"  wire {nets[net]};")
    placed = []
    for path, kind, ports in netlist.memories:
        row = zip(PORTS, ports, strict=True)
        inside = ", ".join(
            f".{name}({{{', '.join(nets[int(net)] for net in port.nets[::-1])}}})"
            for name, port in row
        )
        placed.append(f"  {kind} {free(path, f'{path}_memory')} ({inside});")
    for cell, cells, _ in netlist.by_kind():
        pins = (*cell.inputs, *cell.functions)
        for number in cells:
            names = [f"u{number}", f"u{number}_"]
            if cell.is_flip_flop:
                register = netlist.register(number).replace(" ", "_")  # a net without a name
                names = [register, f"{register}_reg", *names]
            row = zip(pins, netlist.pins[number], strict=False)
            at = {pin: nets[int(net)] for pin, net in row if net or pin in cell.inputs}
            if outputs := (gates or {}).get(cell.name):
                placed += _assignments(outputs, at)
            else:
                inside = ", ".join(f".{pin}({net})" for pin, net in at.items())
                placed.append(f"  {cell.name} {free(*names)} ({inside});")
    names = ", ".join(identifier(port.name) for port in netlist.ports)
    head = f"module {module} (\n  {names});"
    return "\n".join([head, *declared, *assigned, *placed, "endmodule\n"])


def _assignments(outputs: Mapping[str, str], nets: Mapping[str, str]) -> list[str]:
    """Assignments to a gate's connected outputs. nets: by pin."""
    return [
        f"  assign {nets[output]} = {PIN.sub(lambda pin: nets[pin[0]], text)};"
        for output, text in outputs.items()
        if output in nets
    ]


def _ports(netlist: CellNetlist) -> tuple[dict[int, str], list[str], list[str]]:
    """Names of the nets at ports, declarations of ports, assignments to outputs.

    An output gets an assignment if its net is a constant or an earlier port.
    """
    nets, declared, assigned = {0: "1'b0", 1: "1'b1"}, [], []
    for port in sorted(netlist.ports, key=lambda port: not port.is_input):
        name, wide = identifier(port.name), len(port.nets) > 1
        declared.append(
            f"  {'input' if port.is_input else 'output'} "
            f"{f'[{len(port.nets) - 1}:0] ' if wide else ''}{name};"
        )
        for bit, net in enumerate(port.nets):
            text = f"{name}[{bit}]" if wide else name
            if nets.setdefault(int(net), text) != text:
                assigned.append(f"  assign {text} = {nets[int(net)]};")
    return nets, declared, assigned
