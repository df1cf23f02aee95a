"""Equivalence of a netlist of cells and its RTL, proven by yosys and ABC.

Both are cut at registers and memories: outputs of these are inputs of the logic, inputs of these
its outputs. ABC proves that RTL and netlist have the same outputs for all inputs. So if registers
and memories of both have equal contents in one cycle, they have in all later cycles, and outputs
are equal (induction over one cycle). Cells are read from the liberty file by yosys.

Bits that ABC leaves open are decided by all values of their inputs, if these are few: products.
The rest, long sums of several operands, is proven against the RTL with sums and products built by
the passes of yosys that synthesis uses (`FORMED`); `Proof.formed` counts these bits.

Facts on the RTL alone are proven first, by induction from its initial values: registers that
synthesis merged are always equal, those that it replaced by constants have these values; addresses
stay below the sizes of memories of flip-flops, since a word beyond the end is undefined. An
undefined bit may have any value, different ones in RTL and netlist. The netlist has no initial
values: that it begins in a state of the RTL is assumed. A clock gate is an enable of its registers.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from splatcore.eda.cells.cell_netlist import plain
from splatcore.eda.cells.exhaustive import always_zero
from splatcore.eda.cells.facts import Facts, circuit
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.logic import DifferenceError, Logic
from splatcore.eda.cells.mapping import SUMS
from splatcore.eda.gates.macros import module
from splatcore.eda.gates.synth import UNMAPPED, YOSYS, Netlist, yosys
from splatcore.sim.common.cache import kept_json
from splatcore.sim.common.sources import files_key

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

TOP = "read_rtlil top.il\nread_verilog -lib macros.v\nhierarchy -top top\nproc\n"
KEPT = GATES.format(more="setattr -set keep 1 t:$_DFF*") + "write_json rtl.json\n"

READ = SYNTHESISED + (
    "design -reset\n" + TOP + KEPT
    + "design -reset\nread_liberty -ignore_miss_func cells.lib\n"
    + "read_verilog -lib macros.v\nread_verilog netlist.v\nhierarchy -top top\nproc\n"
    + GATES.format(more="opt_expr\nopt_dff -nodffe -nosdff -keepdc")
    + "write_json netlist.json\n"
)  # fmt: skip
"""Of the RTL no register is removed, merged or simplified. In the netlist, resets of cells that are
tied to a constant are removed, but no register: one that is 1 from the second cycle on is not
constant."""

FORMED = (
    TOP
    + """
flatten -noscopeinfo
setattr -set keep 1 t:$*dff*
opt_expr -keepdc
opt_clean
opt_merge
opt_expr -keepdc
wreduce -keepdc t:* t:$*dff* %d
opt_clean
"""
)
"""The RTL before sums and products are built: with operands as narrow as in synthesis."""

ABC = """\
write_blif any.blif
read_blif circuit.blif
strash
ifraig
fraig -C {conflicts} -D {conflicts}
write_blif left.blif
read_blif any.blif
"""
"""ABC's own output is lost, so the outputs that are not proven to be 0 are read from `left.blif`;
yosys wants back the module that it gave."""

CONFLICTS, FORMED_CONFLICTS = 2_000, 20_000
"""ABC leaves a bit open after so many conflicts; the second number is for the last try."""

PROVE = "read_verilog any.v\nproc\ntechmap\nabc -script prove\n"
ANY = "module any(input a, b, output y); assign y = a & b; endmodule\n"

SHOWN = 5  # names of differing bits in a message


@dataclass(frozen=True)
class Proof:
    """Figures of a proof.

    bits: equal ones: outputs, inputs of memories, next values of registers
    registers: of the netlist
    left_out: registers of the RTL that the netlist lacks: equal to constants or other registers
    tried: bits proven by all values of their inputs
    formed: bits proven with sums and products built by the passes that synthesis uses
    """

    bits: int
    registers: int
    left_out: int
    tried: int
    formed: int


def prove(rtl: Netlist, netlist: str, library: Library) -> Proof:
    """Prove that a netlist is equivalent to its RTL; proofs are cached.

    netlist: Verilog of a module `top` of the library's cells; flip-flops are named after registers
    Raises DifferenceError with the names of bits that differ or could not be proven.
    """
    made_from = [YOSYS, files_key(Path(__file__)), rtl.text, rtl.memories, netlist, library.text]
    proof = kept_json("synth", made_from, lambda: vars(_proven(rtl, netlist, library)))
    return Proof(**proof)


def _proven(rtl: Netlist, netlist: str, library: Library) -> Proof:
    boxes = "".join(module(*size, blackbox=True) for size in sorted(set(rtl.memories)))
    files = {"top.il": rtl.text, "macros.v": boxes}
    found = yosys(READ, files | {"cells.lib": library.text, "netlist.v": netlist})
    logic, cells = Logic.of(found["rtl.json"]), Logic.of(found["netlist.json"], library)
    for own, other in ((logic.inputs, cells.inputs), (logic.outputs, cells.outputs)):
        if own.keys() != other.keys():
            raise DifferenceError(f"ports differ: {_few(sorted(own.keys() ^ other.keys()))}")
    matched = _matched(logic, cells)
    facts = Facts.supposed(logic, {*matched.values()}, found["synthesised.json"])
    facts.bound(logic, {int(n) for n in re.findall(r"^ *memory .*\bsize (\d+)", rtl.text, re.M)})
    while left := _left(*circuit(logic, facts))[0]:
        facts.drop(left)
    names, text = circuit(logic, facts, cells, matched)
    left, tried = _left(names, text)
    unformed = len(left)
    for sums in SUMS if left else ():
        formed = Logic.of(yosys(_formed(sums), files)["rtl.json"])
        seen = facts.seen_in(logic, formed)
        last = circuit(formed, seen, cells, _matched(formed, cells), {*left})
        left, _ = _left(*last, FORMED_CONFLICTS)
        if not left:
            break
    if left:
        raise DifferenceError(
            f"{len(left)} of {len(names)} bits are not proven equal: {_few(left)}"
        )
    registers = len(set(cells.instances.values()))
    return Proof(len(names), registers, len(facts.same), tried, unformed)


def _formed(sums: str) -> str:
    """Script for the RTL with sums and products built in a way of `SUMS`."""
    booth = "booth\n" * ("-booth" in sums)
    maps = sums.removeprefix("-extra-map ") if "-extra-map" in sums else ""
    techmap = f"techmap -map +/techmap.v -map {maps}\n" if maps else "techmap\n"
    return FORMED + booth + "alumacc\n" + KEPT.replace("techmap\n", techmap)


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


def _left(names: list, text: str, conflicts: int = CONFLICTS) -> tuple[list, int]:
    """Names of a circuit's outputs that are not proven to be always 0, and the number of outputs
    proven by all values of their inputs.

    conflicts: after so many ABC leaves an output open
    """
    if not names:
        return [], 0
    script = ABC.format(conflicts=conflicts)
    found = yosys(PROVE, {"any.v": ANY, "prove": script, "circuit.blif": text})["left.blif"]
    tables = re.findall(r"^\.names (.*)\n((?:[^.\n].*\n)*)", found, re.M)
    zero = {nets for nets, rows in tables if not re.search(r"1$", rows, re.M)}
    left = {f"o{number}": name for number, name in enumerate(names) if f"o{number}" not in zero}
    tried = always_zero(found, left)
    return [name for output, name in left.items() if output not in tried], len(tried)
