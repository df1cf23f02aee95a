"""The commands `bench scenes`, `bench sweep` and `bench ablation`."""

import typer
from rich.table import Table

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    MACHINE,
    PresetOption,
    QualityOption,
    option,
)
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.frame.reading import Reading
from splatcore.sim.machine.script import TIMINGS, find_timing
from splatcore.spec.preset import find_preset

TimingOption = option(str, "NAME", "Memory model: 'ideal', 'lpddr4' or 'both'.", panel=MACHINE)
PointOption = option(
    list[str] | None,
    "NAME",
    "Measure this machine only (see --list); may be repeated.",
    "--point",
    panel=MACHINE,
)
ListOption = option(bool, None, "List the machines and exit.", "--list", panel=MACHINE)
ConfirmOption = option(
    str | None, "SCENE[:ID]", "Also simulate the machines of the Pareto front on this view in RTL."
)
RtlOption = option(
    list[str] | None, "SCENE[:ID]", "Also simulate all steps on this view in RTL.", "--rtl"
)


@bench.bench.command("scenes")
def scenes_command(
    output: bench.FolderOption,
    reading: Reading,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    timing: TimingOption = "both",
    quality: QualityOption = None,
    preset: PresetOption = "DEFAULT",
):
    """Render scenes in RTL: cycles, memory traffic, correctness.

    Results already in DIR are kept as long as the machine's Verilog is the same. Exit status 1 if a
    picture differs from the golden model's.
    """
    config = find_preset(preset)
    timings = list(TIMINGS.values()) if timing == "both" else [find_timing(timing)]
    found = bench.look(output, scene, cameras, size, [config], quality, reading)
    from splatcore.study.bench import scenes

    right = scenes.bench_scenes(config, found, timings, output)
    console.print((output / "scenes.md").read_text(), soft_wrap=True)
    if not right:
        raise typer.Exit(1)


@bench.bench.command("sweep")
def sweep_command(
    output: bench.FolderOption,
    reading: Reading,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    only: PointOption = None,
    listed: ListOption = False,
    confirm: ConfirmOption = None,
    scheduler: bench.SchedulerOption = None,
):
    """Compare many machines on many scenes: speed, error, gates.

    Writes DIR/sweep.json: by golden and cycle model, cycles, PSNR and maximum error of each machine
    on each view, against the reference on the same packed model and on the original scene; gates
    and memories of each machine; and the Pareto front: the machines that no other one beats in
    cycles (slowest view and geometric mean), gates and PSNR together. Parts that differ from
    DEFAULT's are synthesised; the other gates are DEFAULT's.
    """
    from splatcore.study.bench import campaigns
    from splatcore.study.bench.sweep_points import points

    by_name = {point.name: point for point in points()}
    check_known("--point", by_name, *(only or ()))
    chosen = [by_name[name] for name in only or by_name]
    if listed:
        for point in chosen:
            console.print(f"{point.name:22} {point.fields}", markup=False, soft_wrap=True)
        return
    machines = [point.config for point in chosen]
    found = bench.look(output, scene, cameras, size, machines, reading=reading)
    facts = campaigns.sweep(chosen, found, output, scheduler)
    if confirm:
        view = bench.view_of(confirm, found[0].size, reading=reading)
        campaigns.confirm(chosen, facts, view, output)
    print_whole(sweep_table(facts))
    bench.finish(output / "sweep.json", facts)


def sweep_table(facts: dict) -> Table:
    """Return a table of the machines of a sweep."""
    headings = "k cycles|… mean|FPS|dB min|dB mean|max error|k gates|KB|front".split("|")
    table = new_table(
        "machine", headings, "slowest and worst view of each; dB and maximum error of the machine"
    )
    forms = {
        "frame_cycles_max": (",.0f", 1000), "frame_cycles_mean": (",.0f", 1000),
        "fps_min": (".1f",), "psnr_db_machine_min": (".1f",), "psnr_db_machine_mean": (".1f",),
        "max_error_machine_max": (".3f",),
        "nand2": (",.0f", 1000), "memory_kb": (".1f",),
    }  # fmt: skip
    for name, found in facts["points"].items():
        cells = (shown(found.get(key), *form) for key, form in forms.items())
        table.add_row(name, *cells, "*" if found["front"] else "")
    return table


@bench.bench.command("ablation")
def ablation_command(
    output: bench.FolderOption,
    reading: Reading,
    scene: bench.ScenesArgument = None,
    cameras: bench.CamerasOption = None,
    size: bench.PixelsOption = bench.SIZE,
    rtl: RtlOption = None,
    quality: QualityOption = None,
    preset: PresetOption = "DEFAULT",
    scheduler: bench.SchedulerOption = None,
):
    """Measure the gain of culling, zero skipping and early termination.

    Adds them one by one; each step is a machine built without the missing ones. Cycles are from the
    cycle model, pictures and counts from the golden model. Writes DIR/ablation.json.
    """
    config = find_preset(preset)
    found = bench.look(output, scene, cameras, size, [config], quality, reading)
    from splatcore.study.bench import campaigns

    size = found[0].size
    simulated = [bench.view_of(text, size, quality, reading) for text in rtl or ()]
    facts = campaigns.ablation(config, found, output, scheduler, simulated)
    names = [step["name"] for step in facts["steps"]]
    table = new_table("view", names, "frames per second at 800 MHz")
    cells: dict[str, list[str]] = {}
    for row in facts["rows"]:
        title = f"{row['scene']} {row['camera']}"
        simulated = f" ({row['rtl_cycles'] / 1000:,.0f} k in RTL)" if row["rtl_cycles"] else ""
        cells.setdefault(title, []).append(f"{row['fps_at_800mhz']:.1f}{simulated}")
    for title, values in cells.items():
        table.add_row(title, *values)
    table.add_row("the paper", *(str(step["paper_fps"] or "–") for step in facts["steps"]))
    print_whole(table)
    bench.finish(output / "ablation.json", facts)
