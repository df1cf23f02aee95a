"""The commands `bench scenes`, `bench sweep` and `bench ablation`."""

import typer

from splatcore.app.cli import bench
from splatcore.app.cli.options import (
    MACHINE,
    PresetOption,
    QualityOption,
    option,
)
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.reading import Reading
from splatcore.sim.machine.script import TIMINGS, find_timing
from splatcore.spec.preset import find_preset
from splatcore.study.results.campaigns import SweepPoint
from splatcore.study.results.fields import columns, with_names

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
    from splatcore.study.bench.sweep import points

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
    sweep_table(facts).print()
    bench.finish(output / "sweep.json", facts)


SHOWN = (
    "frame_cycles_max frame_cycles_mean fps_min psnr_db_machine_min psnr_db_machine_mean "
    "max_error_machine_max nand2 memory_kb front"
)
"""Keys of columns."""


def sweep_table(facts: dict) -> Table:
    """Return a table of the machines of a sweep."""
    shown = [Column("machine"), *columns(SweepPoint, SHOWN)]
    points = with_names("machine", facts["points"])
    return Table.of("sweep", "slowest and worst view of each; errors of the machine", shown, points)


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
    ablation_table(facts).print()
    bench.finish(output / "ablation.json", facts)


def ablation_table(facts: dict) -> Table:
    """Return a table of frames per second by view and step."""
    rows: dict[str, dict] = {}
    for row in facts["rows"]:
        title = f"{row['scene']} {row['camera']}"
        simulated = f" ({row['rtl_cycles'] / 1000:,.0f} k in RTL)" if row["rtl_cycles"] else ""
        found = rows.setdefault(title, {"view": title})
        found[row["step"]] = f"{row['fps_at_800mhz']:.1f}{simulated}"
    steps = {step["name"]: step["paper_fps"] for step in facts["steps"]}
    shown = [Column("view"), *(Column(name, digits=1, get=name) for name in steps)]
    return Table.of(
        "ablation", "frames per second at 800 MHz", shown,
        [*rows.values(), {"view": "the paper"} | steps],
    )  # fmt: skip
