"""Output of `splatcore synth --liberty --check`: proofs that netlists and RTL are equivalent."""

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.equivalence import prove
from splatcore.eda.cells.logic import DifferenceError
from splatcore.eda.cells.opensta import verilog
from splatcore.eda.gates.synth import Netlist
from splatcore.sim.common.output import console, messages, progress_bar


def print_checks(parts: dict[str, tuple[Netlist, CellNetlist]]) -> dict[str, dict]:
    """Prove parts, by name, and print a line per part.

    parts: RTL and netlist of each
    Returns the figures for a JSON file; `difference` is None where the proof succeeded.
    """
    found: dict[str, dict] = {}
    with progress_bar("proving", len(parts)) as advance:
        for done, (name, (rtl, netlist)) in enumerate(parts.items()):
            advance(done, len(parts), f"proving {name}")
            found[name] = _checked(rtl, netlist)
    for name, facts in found.items():
        if facts["difference"]:
            messages.print(f"{name}: {facts['difference']}", soft_wrap=True)
        else:
            console.print(
                f"{name}: {facts['cells']:,} cells, {facts['bits']:,} bits proven equal to the "
                f"RTL's, {facts['tried']:,} of them by all values of their inputs, "
                f"{facts['formed']:,} with sums as in synthesis; {facts['registers']:,} registers",
                soft_wrap=True, markup=False,
            )  # fmt: skip
    equal = sum(facts["difference"] is None for facts in found.values())
    console.print(f"Netlists proven equivalent to their RTL: {equal} of {len(found)}.")
    return found


def _checked(rtl: Netlist, netlist: CellNetlist) -> dict:
    facts = {"cells": len(netlist.kinds), "difference": None}
    try:
        return facts | vars(prove(rtl, verilog(netlist, "top"), netlist.library))
    except DifferenceError as error:
        return facts | {"difference": str(error)}
