"""The table of the whole machine's gates beside the paper's."""

from collections.abc import Iterable
from itertools import groupby

from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.common.output import console, messages, progress_bar
from splatcore.sim.common.paper import GATES, GATES_ALL
from splatcore.sim.eda.machine_gates import Size, examined, netlist, sizes, whole
from splatcore.sim.eda.synth import DEPTH_MAX
from splatcore.spec.config import Config

HEADINGS = ("count", "each", "all", "for speed", "depth", "paper")


def synthesise_machine(config: Config) -> dict:
    """Print the gates of all parts of a machine; the same for a JSON file."""
    with progress_bar("elaborating the machine") as advance:
        hierarchy = netlist(config)
        found = sizes(hierarchy, advance)
        advance(0, 1, "checking the machine")
        about = examined(whole(hierarchy))
    title = f"preset {config.name}; thousands of NAND2; depth for speed ≤ {DEPTH_MAX}"
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    table.add_column("part", no_wrap=True)
    for heading in HEADINGS:
        table.add_column(heading, justify="right")
    for stage, parts in groupby(found, key=lambda size: size.part.stage):
        parts = list(parts)
        table.add_row(stage, *_row(parts, None, GATES.get(stage)), style="bold")
        for size in parts:
            table.add_row(f"  {size.part.name}", *_row([size], size.count, None))
    table.add_row("all", *_row(found, None, GATES_ALL), style="bold")
    console.print(table)
    parted = sum(size.flip_flops_before for size in found)
    console.print(
        f"Flip-flops as described: {parted:,} in the parts, {about['flip_flops_before']:,} in the "
        f"whole. Latches, loops, wires of several drivers or none: {len(about['faults'])}."
    )
    for fault in about["faults"]:
        messages.print(fault, markup=False, soft_wrap=True)
    return {
        "nand2": sum(size.nand2 for size in found),
        "speed_nand2": sum(size.speed_nand2 for size in found),
        "paper_nand2": GATES_ALL,
        "flip_flops_before": {"parts": parted, "whole": about["flip_flops_before"]},
        "faults": about["faults"],
        "parts": {size.part.name: _facts(size) for size in found},
    }


def _row(sizes: list[Size], count: int | None, paper: int | None) -> Iterable[str]:
    """Cells of a row: sums, and the largest depth."""
    nand2, speed_nand2 = (
        sum(getattr(size, name) for size in sizes) for name in ("nand2", "speed_nand2")
    )
    yield str(count or "")
    for value in (count and nand2 / count, nand2, speed_nand2):
        yield f"{value / 1000:,.1f}" if value else ""
    yield str(max(size.speed_depth for size in sizes))
    yield f"{paper / 1000:,.1f}" if paper else ""


def _facts(size: Size) -> dict:
    """A part's sizes for a JSON file."""
    return {"stage": size.part.stage} | {k: v for k, v in vars(size).items() if k != "part"}
