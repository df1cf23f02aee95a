"""Faults of a netlist: latches, combinational loops, wires of several drivers or of none."""

import re
from pathlib import Path

from splatcore.sim.eda.synth import yosys

READ = """
read_verilog {files}
hierarchy -check -top {top}
proc
flatten
"""

CHECK = """
delete t:$scopeinfo
tee -o check.txt check
tee -o latches.txt select -list t:$dlatch t:$adlatch t:$dlatchsr t:$sr
"""
"""Of a flat netlist, as loops may lead through several modules."""


def faults_found(files: dict[str, str]) -> list[str]:
    """Faults that `CHECK` has found, a line each."""
    latches = [f"latch {name}" for name in files["latches.txt"].split()]
    return latches + re.findall(r"^Warning: (.*)", files["check.txt"], re.M)


def faults(top: str, *paths: Path) -> list[str]:
    """Faults of Verilog files."""
    files = {path.name: path.read_text() for path in paths}
    return faults_found(yosys(READ.format(files=" ".join(files), top=top) + CHECK, files))
