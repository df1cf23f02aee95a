"""Placing and routing of a netlist of cells by graywolf and qrouter, with qflow's converters."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.route.lef import Lef
from splatcore.eda.template import filled
from splatcore.spec.cache import kept_folder
from splatcore.spec.error import InputError

SCRIPTS = Path("/usr/lib/qflow/scripts")
ROUTER = Path("/usr/lib/qrouter/qrouternullg")
"""qflow's converters, and qrouter without a window, where Debian installs them."""

PACKAGES = {"graywolf": "graywolf", "sta": "opensta", SCRIPTS: "qflow", ROUTER: "qrouter"}

CELLS_MAX = 6600
"""graywolf runs out of its tables with more cells (it ended at 6,690)."""


def missing() -> list[str]:
    """Debian packages of tools that are not installed."""
    return [
        package for tool, package in PACKAGES.items()
        if not (tool.exists() if isinstance(tool, Path) else shutil.which(tool))
    ]  # fmt: skip


@dataclass(frozen=True)
class Circuit:
    """The nets of a netlist that are placed and routed.

    The clock and constants are left out: a clock tree and tie cells would have their own wires.
    Memories are outside: their pins are pads, like ports.
    """

    netlist: CellNetlist

    @cached_property
    def without(self) -> set[int]:
        """Constants, and the clock."""
        return {0, 1} | {int(p.nets[0]) for p in self.netlist.ports if p.name == "clk"}

    @cached_property
    def pads(self) -> dict[bool, list[tuple[int, bool]]]:
        """Bits of ports and memories, inputs (True) and outputs: net, whether it is a memory's."""
        found = {True: [], False: []}
        outside = [(port, port.is_input, False) for port in self.netlist.ports]
        outside += [
            (port, not port.is_input, True) for *_, ports in self.netlist.memories for port in ports
        ]
        for port, is_input, memory in outside:
            nets = (int(net) for net in port.nets)
            found[is_input] += [(net, memory) for net in nets if net not in self.without]
        return found

    @cached_property
    def cells(self) -> list[tuple[str, str, dict[str, int]]]:
        """Name, kind and nets by pin of each cell; names as `blif2cel.tcl` makes them."""
        return [
            (f"{cell.name}_{k + 1}", cell.name, {pin: int(nets[pin][k]) for pin in nets})
            for cell, cells, nets in self.netlist.by_kind()
            for k in range(len(cells))
        ]

    @cached_property
    def names(self) -> dict[bool, list[str]]:
        """Names of the pads that cells are connected to, inputs (True) and outputs."""
        used = {net for *_, pins in self.cells for net in pins.values()}
        names, seen = {}, set()
        for is_input in (True, False):
            nets = dict.fromkeys(net for net, _ in self.pads[is_input])
            names[is_input] = [f"n{net}" for net in nets if net in used - seen]
            seen |= nets.keys()
        return names

    def blif(self) -> str:
        """The circuit as a BLIF file."""
        lines = [".model part"]
        lines += [f".inputs {name}" for name in self.names[True]]
        lines += [f".outputs {name}" for name in self.names[False]]
        for _, kind, pins in self.cells:
            used = (f"{pin}=n{net}" for pin, net in pins.items() if net not in self.without)
            lines.append(f".gate {kind} {' '.join(used)}")
        return "\n".join([*lines, ".end", ""])


def placed_and_routed(circuit: Circuit, lef: Lef) -> Path:
    """Place and route; results are cached.

    Returns the folder with routed.def, routed.rc and the logs.
    Raises InputError if a tool is missing, or the circuit is too large or cannot be routed.
    """
    if packages := missing():
        raise InputError(f"--route needs apt-get install {' '.join(packages)}")
    if (count := len(circuit.cells)) > CELLS_MAX:
        raise InputError(f"--route: {count:,} cells; graywolf places at most {CELLS_MAX:,}")
    wide = [layer.horizontal for layer in lef.layers].index
    across, up = lef.layers[wide(False)].pitch, lef.layers[wide(True)].pitch
    facts = {"layers": lef.layers, "units": lef.units, "across": across, "up": up}
    texts = {
        "part.blif": circuit.blif(),
        "part.par": filled("route/part.par", **facts),
        "lefs.cfg": "".join(f"read_lef {path}\n" for path in lef.paths),
    }
    route = filled("route/route.tcl", layers=len(lef.layers))
    info = filled("route/part.info", **facts)
    made_from = [texts, route, [path.read_text() for path in lef.paths]]

    def make(folder: Path):
        for name, text in (texts | {"part.info": info}).items():
            (folder / name).write_text(text)
        files = [word for path in lef.paths for word in ("--lef", path)]
        blif = SCRIPTS / "blif2cel.tcl", *files, "--blif", "part.blif", "--cel", "part.cel"
        _run(folder, "part.cel", "tclsh", *blif)
        _run(folder, "part.pl1", "graywolf", "-n", "part")
        layers = str(len(lef.layers))
        _run(folder, "part.def", "tclsh", SCRIPTS / "place2def.tcl", "part", lef.filler, layers)
        blocked = (folder / "part.obs").read_text()
        (folder / "route.cfg").write_text(texts["lefs.cfg"] + route.replace("BLOCKED\n", blocked))
        _run(folder, "routed.rc", ROUTER, "-noc", "-s", "route.cfg")

    return kept_folder("route", made_from, make)


def _run(folder: Path, result: str, *words: object):
    """Run a tool in a folder; its output goes to a log named after its result."""
    with open(folder / f"{result}.log", "w") as log:
        subprocess.run(
            [str(word) for word in words], cwd=folder, stdin=subprocess.DEVNULL, stdout=log,
            stderr=subprocess.STDOUT, check=False,
        )  # fmt: skip
    path = folder / result
    if not path.exists() or not path.stat().st_size:
        last = re.sub(r"\s+", " ", (folder / f"{result}.log").read_text()[-200:]).strip()
        raise InputError(f"--route: {Path(words[0]).name} wrote no {result}: {last}")
