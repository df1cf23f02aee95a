"""Errors of independent front ends in Verilog: slang, yosys with slang, Icarus, Verilator."""

import re
import shlex
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

from pyslang import TextDiagnosticClient, ast
from pyslang.driver import Driver

from splatcore.eda.cells.liberty import Library
from splatcore.eda.gates.macros import module, sizes_in
from splatcore.eda.gates.synth import yosys
from splatcore.sim.rtl.verilator import environment

ULX3S_CELLS = Path(__file__).parents[1] / "eda" / "ulx3s_cells.v"
"""Ports of the cells that a board's Verilog instantiates."""

STANDARDS = ("2005", "2012")  # of Verilog and SystemVerilog; Icarus's names


def elaborated(top: str, *paths: Path) -> tuple[Driver, ast.Compilation]:
    """A design read by slang, and its driver. top: the top module."""
    driver = Driver()
    driver.addStandardArgs()
    words = ["slang", "--error-limit=0", "--top", top, *map(str, paths)]
    assert driver.parseCommandLine(shlex.join(words)) and driver.processOptions()
    driver.parseAllSources()
    return driver, driver.createCompilation()


def slang(top: str, *paths: Path) -> list[str]:
    """Errors of slang: syntax, elaboration, drivers."""
    driver, compilation = elaborated(top, *paths)
    engine, printed = driver.diagEngine, TextDiagnosticClient()
    engine.clearClients()
    engine.addClient(printed)
    for found in compilation.getAllDiagnostics():
        engine.issue(found)
    if not engine.numErrors:
        for found in driver.runAnalysis(compilation).getDiagnostics():
            engine.issue(found)
    return re.findall(r"^.*: (?:fatal )?error: .*$", printed.getString(), re.M)


def ports(top: str, *paths: Path) -> dict[str, tuple[str, int]]:
    """Direction and width of each port of a module, as slang reads them."""
    _, compilation = elaborated(top, *paths)
    (found,) = compilation.getRoot().topInstances
    return {port.name: (port.direction.name, port.type.bitWidth) for port in found.body.portList}


def read_slang(top: str, *paths: Path) -> list[str]:
    """Errors of yosys's `read_slang`, which takes what can be synthesised."""
    texts = {f"{number}.v": path.read_text() for number, path in enumerate(paths)}
    try:
        yosys(f"read_slang -j 1 --top {top} {' '.join(texts)}\n", texts)
    except RuntimeError as error:
        return [str(error)]
    return []


def icarus(top: str, *paths: Path) -> list[str]:
    """Errors of Icarus, as Verilog and as SystemVerilog; empty if it is not installed."""
    found = []
    for standard in STANDARDS if shutil.which("iverilog") else ():
        words = ["iverilog", f"-g{standard}", "-t", "null", "-s", top, *paths]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        found += (done.stdout + done.stderr).splitlines() if done.returncode else []
    return found


def verilator(top: str, *paths: Path) -> list[str]:
    """Errors of Verilator."""
    done = subprocess.run(
        ["verilator", "--lint-only", "--timing", "-Wno-lint", "-Wno-fatal", "--top-module", top,
         *paths], env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stderr.splitlines() if done.returncode else []


ALL = (slang, icarus, read_slang, verilator)


def errors(top: str, *paths: Path, by: Iterable = (slang, icarus)) -> list[str]:
    """Errors of several front ends. by: of `ALL`."""
    return [f"{each.__name__}: {line}" for each in by for line in each(top, *paths)]


def cells_of(library: Library) -> Iterator[str]:
    """Modules with the ports of a library's cells."""
    for cell in library.cells.values():
        pins = [f"input {pin}" for pin in cell.inputs] + [f"output {pin}" for pin in cell.functions]
        yield f"module {cell.name} ({', '.join(pins)});\nendmodule\n"


def write_boxes(netlist: Path, library: Library) -> Path:
    """Write modules for the cells and memories of a netlist next to it. Returns the file's path."""
    sizes = sizes_in(netlist.read_text())
    path = netlist.with_suffix(".boxes.v")
    path.write_text("".join([*cells_of(library), *(module(*size) for size in sizes)]))
    return path
