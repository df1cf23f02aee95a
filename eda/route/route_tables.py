"""Output of `splatcore synth --route`: routed wires of parts, their timing, pictures."""

from pathlib import Path

import numpy as np

from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.silicon import Silicon, silicon
from splatcore.eda.route.fit import by_fanout, fitted
from splatcore.eda.route.layout import write_layout
from splatcore.eda.route.lef import Lef, read_lef
from splatcore.eda.route.place_route import Circuit, placed_and_routed
from splatcore.eda.route.routed import Routed
from splatcore.eda.route.timed import longest_path, spef
from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.common.output import console, make_folder, progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

PARTS = STAGES | CONTROL | PRIMITIVES

COLUMNS = (
    Column("stage"),
    Column("cells", digits=0),
    Column("um", digits=0, get=lambda row: f"{row['um'][0]:.0f} × {row['um'][1]:.0f}"),
    Column("nets", digits=0),
    Column("failed", digits=0),
    Column("mm of wires", digits=1, get="wire_mm"),
    Column("fF per sink", digits=2, get="ff_per_sink"),
    Column("FO4, no wires", digits=1, get="fo4"),
    Column("estimated", digits=1, get="fo4_wires"),
    Column("routed", digits=1, get="fo4_routed"),
)

FANOUT_COLUMNS = (
    Column("stage"),
    Column("sinks", get="fanout"),
    Column("nets", digits=0),
    Column("µm", digits=1, get="um"),
    Column("fF", digits=2, get="ff"),
    Column("fF per sink", digits=2, get="ff_per_sink"),
)


def print_routes(
    config: Config, stages: list[str], liberty: str, lefs: str, output: Path | None
) -> dict:
    """Place and route parts, and print their wires and their timing with them.

    stages: names of parts
    liberty, lefs: the library's files; those of LEF separated by commas
    output: folder for a picture of each layout, and OpenSTA's files
    Returns the same figures for a JSON file.
    Raises InputError if a tool is missing, or a part is too large or cannot be routed.
    """
    if "top" in stages:
        raise InputError("--route: --stage top is too large; name parts")
    library, lef, facts, nets = read_liberty(liberty), read_lef(lefs), {}, []
    with progress_bar("routing", len(stages)) as advance:
        for done, name in enumerate(stages):
            advance(done, len(stages), f"routing {name}")
            part = silicon(PARTS[name](config), library)
            folder = None if output is None else output / name
            facts[name], found = _route(name, part, lef, folder)
            nets.append(found)
    rows = [{"stage": name} | each for name, each in facts.items()]
    Table.of("routed", f"preset {config.name} in {library.name}", COLUMNS, rows).print()
    classes = [{"stage": r["stage"]} | each for r in rows for each in r["by_fanout"]]
    Table.of("wires", "by fan-out", FANOUT_COLUMNS, classes).print()
    fit = fitted(*zip(*nets, strict=True), inverter_input(library))
    console.print(
        f"Fit in inverter inputs: {fit[0]:.2f} per net and {fit[1]:.2f} per load. Neither the "
        "clock nor power is routed. Estimated: the wire model of docs/silicon.md. Routed: by "
        "OpenSTA, with the resistance and capacitance of each net's wires.",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    return {"parts": facts, "inverters_per_net": fit[0], "inverters_per_load": fit[1]}


def inverter_input(library: Library) -> float:
    """pF of the smallest inverter's input."""
    (edges,) = library.inverter.inputs.values()
    return sum(edges) / 2


def _route(
    name: str, part: Silicon, lef: Lef, folder: Path | None
) -> tuple[dict, tuple[np.ndarray, np.ndarray]]:
    """Route a part. Returns its figures; fan-out and pF of its nets."""
    circuit, library = Circuit(part.netlist), part.netlist.library
    routed = Routed.read(placed_and_routed(circuit, lef))
    capacitances = routed.capacitances(lef)
    nets = [net for net, sinks in routed.sinks.items() if sinks]
    fanout = np.array([routed.sinks[net] for net in nets])
    length = np.array([sum(routed.lengths[net].values()) for net in nets])
    capacitance = np.array([capacitances[net] for net in nets])
    files = None
    if folder is not None:
        make_folder(folder)
        flip_flops = {cell.name for cell in part.netlist.cell_kinds if cell.is_flip_flop}
        picture, files = folder / f"{name}.png", folder
        write_layout(picture, name, routed, lef, flip_flops)
        console.print(str(picture), soft_wrap=True)
    trees = spef(routed, lef)
    plain = longest_path(circuit, part.assumed, library.text)
    wired = longest_path(circuit, part.assumed, library.text, trees, files)
    left, bottom, right, top = routed.area
    return {
        "cells": len(routed.cells), "um": [right - left, top - bottom], "nets": len(nets),
        "failed": routed.failed, "wire_mm": float(length.sum()) / 1000,
        "ff_per_sink": 1000 * float(capacitance.sum() / fanout.sum()),
        "fo4": plain / part.assumed.fo4,
        "fo4_wires": part.wired.longest.time / part.assumed.fo4,
        "fo4_routed": wired / part.assumed.fo4,
        "by_fanout": by_fanout(fanout, length, capacitance),
    }, (fanout, capacitance)  # fmt: skip
