"""Time of a part's longest path by OpenSTA, with the resistances and capacitances of its wires."""

import re
import subprocess
import tempfile
from pathlib import Path

from splatcore.eda.cells.static_timing import Assumed
from splatcore.eda.route.lef import Lef
from splatcore.eda.route.place_route import Circuit
from splatcore.eda.route.routed import Routed, segments
from splatcore.eda.template import filled

PERIOD = 100.0  # ns, longer than any path


def longest_path(
    circuit: Circuit, assumed: Assumed, liberty: str, spef: str = "", files: Path | None = None
) -> float:
    """ns of the longest path, setup included, without wires or with those of an SPEF file.

    liberty: text of the library
    files: folder in which OpenSTA's files stay; by default none do
    """
    with tempfile.TemporaryDirectory(prefix="splatcore") as scratch:
        folder = files or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        texts = {
            "part.v": verilog(circuit), "part.tcl": script(circuit, assumed, bool(spef)),
            "part.spef": spef, "cells.lib": re.sub(r"default_wire_load\w* *:[^;]*;", "", liberty),
        }  # fmt: skip
        for name, text in texts.items():
            (folder / name).write_text(text)
        done = subprocess.run(
            ["sta", "-no_splash", "-exit", "part.tcl"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    printed = done.stdout + done.stderr
    slack = re.search(r"(-?[\d.]+) +slack", printed)
    wrong = re.search(r"^(Error|Warning).*", printed, re.M)
    if slack is None or wrong:
        raise RuntimeError(f"sta: {wrong[0] if wrong else printed[-300:]}")
    return PERIOD - float(slack[1])


def verilog(circuit: Circuit) -> str:
    """The circuit as Verilog, with the names that the router has for cells and nets."""
    inputs, outputs = (circuit.names[is_input] for is_input in (True, False))
    clock = sorted(circuit.without - {0, 1})
    names = {0: "1'b0", 1: "1'b1"} | {net: "clk" for net in clock}
    lines = [f"module part ({', '.join([*(['clk'] if clock else []), *inputs, *outputs])});"]
    lines += ["  input clk;"] if clock else []
    lines += [f"  input {name};" for name in inputs] + [f"  output {name};" for name in outputs]
    used = {net for *_, pins in circuit.cells for net in pins.values()} - circuit.without
    lines += [f"  wire n{net};" for net in sorted(used) if f"n{net}" not in {*inputs, *outputs}]
    outputs_of = {cell.name: cell.functions for cell in circuit.netlist.cell_kinds}
    for name, kind, pins in circuit.cells:
        inside = ", ".join(
            f".{pin}({names.get(net, f'n{net}')})"
            for pin, net in pins.items()
            if net or pin not in outputs_of[kind]  # an output without a net is net 0
        )
        lines.append(f"  {kind} {name} ({inside});")
    return "\n".join([*lines, "endmodule", ""])


def script(circuit: Circuit, assumed: Assumed, wires: bool) -> str:
    """OpenSTA's script: the same assumptions for ports and memories as in our static timing."""
    placed = {is_input: {*circuit.names[is_input]} for is_input in (True, False)}
    memories = {f"n{net}" for each in circuit.pads.values() for net, memory in each if memory}
    ends: dict[str, int] = {}
    for net, _ in circuit.pads[False]:
        if f"n{net}" in placed[True] | placed[False]:
            ends[f"n{net}"] = ends.get(f"n{net}", 0) + 1
    return filled(
        "route/timed.tcl", period=PERIOD, assumed=assumed, wires=wires, ends=ends,
        inputs=circuit.names[True], outputs=circuit.names[False], memories=memories,
        clock=len(circuit.without) > 2,
    )  # fmt: skip


SPEF_HEAD = """\
*SPEF "IEEE 1481-1998"
*DESIGN "part"
*DATE ""
*VENDOR ""
*PROGRAM "splatcore"
*VERSION "1"
*DESIGN_FLOW "PIN_CAP NONE"
*DIVIDER /
*DELIMITER :
*BUS_DELIMITER [ ]
*T_UNIT 1 NS
*C_UNIT 1 PF
*R_UNIT 1 OHM
*L_UNIT 1 HENRY
"""


def spef(routed: Routed, lef: Lef) -> str:
    """The router's RC trees as SPEF; each net's capacitance is that of its length by LEF's rule
    (the router counts one edge of a wire only)."""
    lines, total = [SPEF_HEAD], routed.capacitances(lef)
    for name, (driver, _, tree) in routed.trees.items():
        parts = list(segments(tree))
        by_router = sum(capacitance for *_, capacitance, _ in parts)
        scale = total[name] / by_router if by_router else 0.0
        named = {driver, *(pin for *_, pin in parts)}
        lost = [pin for pin in routed.pins[name] if pin not in named]
        ends = {0: driver}
        for _, number, _, _, pin in parts:
            if pin == "ERROR":
                pin = lost.pop() if lost else None
            if pin:
                ends[number] = pin
        nodes = {number: _pin(pin) for number, pin in ends.items()}
        lines.append(f"\n*D_NET {name} {total[name]:.6g}\n*CONN")
        for pin in dict.fromkeys(ends.values()):
            port = pin.startswith("PIN/")
            direction = "O" if (pin == driver) != port else "I"
            lines.append(f"{'*P' if port else '*I'} {_pin(pin)} {direction}")
        lines.append("*CAP")
        for _, number, _, capacitance, _ in parts:
            node = nodes.get(number, f"{name}:{number}")
            lines.append(f"{number} {node} {scale * capacitance:.6g}")
        lines.append("*RES")
        for parent, number, ohm, *_ in parts:
            both = (nodes.get(each, f"{name}:{each}") for each in (parent, number))
            lines.append(f"{number} {' '.join(both)} {ohm or 1e-3:.6g}")
        lines.append("*END")
    return "\n".join([*lines, ""])


def _pin(pin: str) -> str:
    """A pin of the router, instance/pin or PIN/net, in SPEF's way."""
    return pin.removeprefix("PIN/").replace("/", ":")
