"""Output of `splatcore synth --liberty`: tables, the longest paths, mm² at 28 nm."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from splatcore.eda import paper
from splatcore.eda.cells.checked import print_checks
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.opensta import write_opensta
from splatcore.eda.cells.silicon import (
    FO4_28NM,
    LONG_FO4,
    UNCERTAINTY,
    Placed,
    Silicon,
    area_28nm,
    ends_by_part,
    long_paths,
    machine_silicon,
    silicon_of,
)  # fmt: skip
from splatcore.eda.cells.static_timing import MEMORY_ACCESS_FO4, MEMORY_SETUP_FO4, Assumed
from splatcore.eda.cells.ways import WIRED_FO4
from splatcore.eda.cells.wire_load import WIRE_LOAD, WIRE_MARGIN, WIRE_NET
from splatcore.eda.cells.wires import SIDE_SHARE
from splatcore.eda.deliver.verilog import constraints
from splatcore.eda.gates.machine_gates import netlist, parts_table, whole
from splatcore.eda.gates.macros import memory_size
from splatcore.eda.gates.synth import Netlist
from splatcore.hdl.stages import CONTROL, PRIMITIVES, STAGES
from splatcore.sim.common.output import console, make_folder, progress_bar, write
from splatcore.sim.common.table import Column, Table, comma_separated, shown
from splatcore.spec.config import KB, Config

PARTS = STAGES | CONTROL | PRIMITIVES

STAGE_COLUMNS = (
    Column("stage"),
    Column("um²", digits=0, get="um2"),
    Column("NAND2", digits=0, get="nand2"),
    Column("flip-flops", digits=0, get="flip_flops"),
    Column("gated", digits=1, get=lambda row: f"{row['gated'] / (row['flip_flops'] or 1):.1%}"),
    Column("buffers", digits=1, get=lambda row: f"{row['buffers'] / (row['cells'] or 1):.1%}"),
    Column("ps", digits=0, get="longest.ps"),
    Column("FO4", digits=1, get="longest.fo4"),
    Column("ps, wires", digits=0, get="longest_with_wires.ps"),
    Column("FO4, wires", digits=1, get="longest_with_wires.fo4"),
    Column("28 nm: MHz", digits=0, get=lambda row: _clocks(row["longest"])),
)

PART_COLUMNS = (
    Column("count", digits=0, none=""),
    Column("um²", digits=0, get="um2"),
    Column("NAND2", digits=0, get="nand2"),
    Column("flip-flops", digits=0, get="flip_flops"),
    Column("buffers", digits=1, none=""),
    Column("FO4 alone", digits=1, get="fo4", none=""),
    Column("wires", digits=1, get="fo4_wires", none=""),
    Column("in the machine", digits=1, get="fo4_machine", none=""),
    Column("paper", digits=0, none=""),
)

PATH_COLUMNS = (
    Column("parts", get=lambda row: f"{row['from_part']} → {row['to_part']}"),
    Column("ends", digits=0),
    Column("FO4", digits=1, get="fo4"),
    Column("ps", digits=0),
    Column("from"),
    Column("to"),
)

PATHS = ("longest", "between_registers", "longest_with_wires")


def print_silicon(
    config: Config,
    stages: list[str],
    liberty: str,
    process: float | None,
    output: Path | None,
    check: bool,
    clock_gates: bool,
) -> dict:
    """Print stages, or the whole machine, in cells of a library.

    stages: names; "top" for the whole machine
    liberty: the library's file
    process: its feature size in nm, to scale its area to 28 nm
    output: folder for OpenSTA's files
    check: whether to prove that netlists and RTL are equivalent
    clock_gates: whether to gate clocks
    Returns the same figures for a JSON file.
    """
    library = replace(read_liberty(liberty), gates_clocks=clock_gates)
    facts, found, rtl = {"liberty": _about(library)}, {}, {}
    with progress_bar("mapping", len(stages)) as advance:
        for done, name in enumerate(each for each in stages if each != "top"):
            advance(done, len(stages), f"mapping {name}")
            rtl[name] = Netlist.of(PARTS[name](config))
            found[name] = silicon_of(rtl[name], library)
    if "top" in stages:
        with progress_bar("elaborating the machine") as advance:
            hierarchy = netlist(config)
            parts, found["top"] = machine_silicon(hierarchy, library, advance)
            rtl["top"] = whole(hierarchy)
        facts["top"] = _print_machine(config, library, parts, found["top"], process)
        if output is not None:
            make_folder(output)
            rows = [{"part": name} | row for name, row in facts["top"]["parts"].items()]
            tables = {"parts": rows, "paths": facts["top"]["long_paths"]}
            for name, table in (tables | {"wired_paths": facts["top"]["wired_paths"]}).items():
                write(output / f"top_{name}.csv", comma_separated(table).encode())
                console.print(str(output / f"top_{name}.csv"), soft_wrap=True)
    facts["stages"] = {name: each.facts for name, each in found.items()}
    _print_stages(config, library, facts["stages"])
    for name, each in found.items():
        if output is not None:
            shipped = constraints(config, each.netlist.port_names()) if name == "top" else None
            for path in write_opensta(each.timing, liberty, name, output, shipped):
                console.print(str(path), soft_wrap=True)
    if check:
        facts["check"] = print_checks({k: (rtl[k], each.netlist) for k, each in found.items()})
    return facts


def _about(library: Library) -> dict:
    """Facts of a library: its corner and its units of area and delay."""
    assumed = Assumed.of(library)
    return {
        "library": library.name, "corner": library.corner,
        "nand2": library.nand2.name, "nand2_um2": library.nand2.area,
        "flip_flop": library.flip_flop.name, "fo4_ps": 1000 * assumed.fo4,
        "memory_access_ps": 1000 * assumed.access, "memory_setup_ps": 1000 * assumed.memory_setup,
    }  # fmt: skip


def _print_stages(config: Config, library: Library, stages: dict[str, dict]):
    """Print a table of stages and one line per path."""
    about = _about(library)
    rows = ({"stage": name} | facts for name, facts in stages.items())
    Table.of("silicon", f"preset {config.name} in {library.name}", STAGE_COLUMNS, rows).print()
    for name, facts in stages.items():
        for kind in PATHS:
            if facts[kind] is not None and not (
                kind == "between_registers" and facts[kind] == facts["longest"]
            ):
                _print(f"{name}, {kind.replace('_', ' ')}: {_described(facts[kind])}")
    _print(
        f"Corner: {about['corner']}. FO4 {about['fo4_ps']:.1f} ps, NAND2 "
        f"{about['nand2_um2']:g} um² ({about['nand2']}). ASSUMED: memories "
        f"{MEMORY_ACCESS_FO4} FO4 to their outputs and {MEMORY_SETUP_FO4} FO4 setup; with wires, "
        f"{WIRE_MARGIN:g} · ({WIRE_LOAD:g} per load − {-WIRE_NET:g}) inverter inputs "
        f"in addition, and between parts "
        f"{SIDE_SHARE:g} sides of their area behind a repeater; at 28 nm an FO4 of "
        f"{1000 * FO4_28NM[0]:.0f} to {1000 * FO4_28NM[1]:.0f} ps at the slow corner and "
        f"{UNCERTAINTY:.0%} of the period for skew and jitter, without wires. "
        f"The paper: {paper.CLOCK_HZ / 1e6:.0f} MHz."
    )


def _described(path: dict) -> str:
    """A path as a line of text: its ends, and each cell with the ps at which it switches."""
    ends = f"from {path['from']['kind']} {path['from']['name']} to {path['to']['kind']} "
    cells = ", ".join(f"{step['cell'] or 'begin'} {step['ps']:.0f}" for step in path["cells"])
    return f"{path['ps']:,.0f} ps, {path['fo4']:.1f} FO4, {ends}{path['to']['name']}; ps: {cells}"


def _print_machine(
    config: Config, library: Library, parts: list[Placed], machine: Silicon, process: float | None
) -> dict:
    """Print the machine's parts, slow paths across them, mm² at 28 nm; return them for JSON."""
    title = f"preset {config.name} in {library.name}"
    whole_fo4 = ends_by_part(machine.wired)
    parts_table(title, PART_COLUMNS, parts, partial(_row, library, whole_fo4)).print()
    cells, total = len(machine.netlist.kinds), sum(each.um2 for each in parts)
    _print(
        f"Assembled: {cells:,} cells, {machine.netlist.area:,.0f} um²; the sum of the parts is "
        f"{total:,.0f} um². Memories: {len(machine.netlist.memories)}."
    )
    paths, wired = long_paths(machine.timing), long_paths(machine.wired, WIRED_FO4)
    for kind, limit, rows in ("paths", LONG_FO4, paths), ("wired_paths", WIRED_FO4, wired):
        wires = ", with wires" if rows is wired else ""
        Table.of(kind, f"paths above {limit} FO4{wires}", PATH_COLUMNS, rows).print()
    sizes = (memory_size(module) for _, module, _ in machine.netlist.memories)
    kilobytes = sum(words * bits for words, bits in sizes) / 8 / KB
    mm2 = area_28nm(total / library.nand2.area, kilobytes)
    if process:
        mm2["logic_scaled_mm2"] = total / 1e6 * (28 / process) ** 2
    _print(_area_line(mm2, kilobytes, process))
    return {
        "parts": {
            each.part.name: {
                "stage": each.part.stage, "count": each.count, "um2": round(each.um2, 1),
                "nand2": round(each.um2 / library.nand2.area, 1), "flip_flops": each.flip_flops,
                "buffers": round(each.buffers, 4), "fo4": each.fo4 and round(each.fo4, 1),
                "fo4_wires": each.fo4_wires and round(each.fo4_wires, 1),
                "fo4_machine": whole_fo4.get(each.part.name),
            }
            for each in parts
        },
        "um2": total, "long_paths": paths, "wired_paths": wired,
        "kilobytes": kilobytes, "area_28nm": mm2,
    }  # fmt: skip


def _area_line(mm2: dict[str, float], kilobytes: float, process: float | None) -> str:
    logic, memories = mm2["logic_mm2"], mm2["memories_mm2"]
    scaled = "" if not process else (
        f" The library's area times (28/{process:g})² is {mm2['logic_scaled_mm2']:.3f} mm² of "
        "logic."
    )  # fmt: skip
    theirs = sum(paper.AREA.values()) / 1e6, sum(paper.MEMORY_AREA.values()) / 1e6
    return (
        f"At 28 nm with the paper's {paper.UM2_PER_GATE:.3f} um² per gate and "
        f"{paper.UM2_PER_KB:,.0f} um² per KB: {logic:.3f} mm² of logic and {memories:.3f} mm² for "
        f"{kilobytes:.1f} KB of memories, {logic + memories:.3f} mm² in all.{scaled} The paper: "
        f"{theirs[0]:.3f} and {theirs[1]:.3f} mm² for {sum(paper.MEMORIES.values())} KB, "
        f"{sum(theirs):.3f} mm² in all."
    )


def _row(
    library: Library, whole_fo4: dict[str, float], parts: list[Placed], theirs: int | None
) -> dict:
    """A row of the table: sums, and what one part has alone."""
    um2, only = sum(each.um2 for each in parts), parts[0]
    alone = {"count": only.count, "buffers": f"{only.buffers:.1%}", "fo4": only.fo4}
    alone |= {"fo4_wires": only.fo4_wires}
    return {
        "um2": um2, "nand2": um2 / library.nand2.area, "paper": theirs,
        "flip_flops": sum(each.flip_flops for each in parts),
        "fo4_machine": max(whole_fo4.get(each.part.name, 0) for each in parts) or None,
    } | (alone if len(parts) == 1 else dict.fromkeys(alone))  # fmt: skip


def _clocks(longest: dict | None) -> str:
    """The range of clocks at 28 nm in MHz, as text."""
    slow, fast = (longest or {}).get("mhz_28nm", (None, None))
    return f"{shown(slow, '.0f')}–{shown(fast, '.0f')}"


def _print(text: str):
    console.print(text, soft_wrap=True, markup=False)
