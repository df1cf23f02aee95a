"""The commands `bench …`: campaigns over many scenes or machines, and sorting in RTL."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import typer

from splatcore.app.cli.options import (
    KEPT_FOLDER,
    MACHINE,
    PRESET,
    QUALITY,
    SCENE,
    SCHEDULER,
    argument,
    check_quality,
    command,
    listed,
    option,
)
from splatcore.model.formats.model_file import is_packed
from splatcore.model.pack.quality import COMPACT, QUALITIES
from splatcore.sim.common.choice import check_known, numbers, numbers_within
from splatcore.sim.common.output import console, make_folder, messages, write_json
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.size import parse_size
from splatcore.sim.frame.source import VIEW_SIZE, check_fits, check_source
from splatcore.sim.machine.script import IDEAL, LPDDR4, find_timing
from splatcore.spec.config import Config
from splatcore.study.results.campaigns import SweepPoint
from splatcore.study.results.fields import columns, with_names
from splatcore.study.results.frames import QualityRow

PIXELS = option("x".join(map(str, VIEW_SIZE)), "WxH", "Pixels of the pictures.", panel=SCENE)

TARGETS = "36,40,44,48,52"
"""Target PSNRs in dB, for each of which the smallest model is found."""

LENGTH_MAX = 1_000_000  # upper limit of --lengths: more entries than a frame has in a group


@dataclass(frozen=True)
class Campaign(Reading):
    """The options of the views to measure, and of the results."""

    output: Path = KEPT_FOLDER
    scene: list[str] | None = argument(
        None, "SCENE …", "Scenes. Default: all in the folder SPLATCORE_SCENES."
    )
    cameras: str | None = option(
        None,
        "ID,ID,…",
        "Cameras in the file next to each scene. Default: the first; for kitchen.spz also "
        "kitchen_inside_0 and kitchen_inside_150.",
        panel=SCENE,
    )
    size: str = PIXELS

    def views(self, machines: Iterable[Config], quality: str | None = None) -> list[View]:
        """Check the arguments, make the output folder, and return the views to measure.

        Raises InputError for a picture too large for one of the machines.
        """
        for config in machines:
            check_fits(config, *parse_size(self.size))
        size = "x".join(map(str, parse_size(self.size)))
        check_quality(quality, *(self.scene or ()))
        for text in self.scene or ():
            check_source(text, self.reading)
        from splatcore.study.bench.scenes import views

        found = views(list(self.scene or ()), self.cameras, size, quality, self.reading)
        make_folder(self.output)
        return found

    def view_of(self, text: str, size: str, quality: str | None = None) -> View:
        """Return the view that SCENE[:ID] names."""
        scene, _, camera = text.partition(":")
        check_quality(quality, scene)
        return View(scene, camera, size, quality=quality, reading=self.reading)

    def finish(self, name: str, facts: dict):
        """Write the result as JSON; list the failures again and exit with status 1 if any."""
        finish(self.output / f"{name}.json", facts)


def finish(path: Path, facts: dict):
    """Write a result; list the failures again and exit with status 1 if any."""
    write_json(path, facts)
    console.print(str(path))
    for failure in facts["failed"]:
        text = f"missing: {failure['what']}: {failure['why']}"
        messages.print(text, soft_wrap=True)
    if facts["failed"]:
        raise typer.Exit(1)


@command("bench sort")
def sort_command(
    output: Path = option(..., "DIR", "Folder for sort.png."),
    config: Config = PRESET,
    lengths: str | None = option(None, "N,N,…", "Entries per list. Default: 1 to 20,000."),
) -> dict:
    """Measure the cycles of sorting, with stage 2 simulated in RTL.

    Sorts lists of random, equal, sorted, reversed and clustered keys. Prints the cycles from the
    first entry to the end mark of a list, simulated and by the cycle model, and plots them in
    DIR/sort.png. The sorted lists are compared with the golden model's.
    """
    asked = None if lengths is None else parse_lengths(lengths)
    from splatcore.study.bench.sort import LENGTHS, bench_sort

    counts, path = asked or LENGTHS, output / "sort.png"
    output.mkdir(exist_ok=True)
    found, model = bench_sort(config, counts, path)
    console.print(str(path))
    return {"preset": config.name, "lengths": list(counts), "cycles": found, "model": model}


def parse_lengths(text: str) -> tuple[int, ...]:
    """Parse the lengths of lists; raise InputError for impossible ones."""
    return numbers_within("--lengths", text, 1, LENGTH_MAX, int)


@command("bench scenes")
def scenes_command(
    campaign: Campaign,
    timing: str = option(
        "both",
        "NAME",
        "Memory model: 'ideal', 'lpddr4', 'both' of these, or 'lpddr4-80' with 80 % of the "
        "bandwidth.",
        panel=MACHINE,
    ),
    quality: str | None = QUALITY,
    config: Config = PRESET,
):
    """Render scenes in RTL: cycles, memory traffic, correctness.

    Results already in DIR are kept as long as the machine's Verilog is the same. Exit status 1 if a
    picture differs from the golden model's.
    """
    timings = [IDEAL, LPDDR4] if timing == "both" else [find_timing(timing)]
    found = campaign.views([config], quality)
    from splatcore.study.bench import scenes

    right = scenes.bench_scenes(config, found, timings, campaign.output)
    console.print((campaign.output / "scenes.md").read_text())
    if not right:
        raise typer.Exit(1)


@command("bench sweep")
def sweep_command(
    campaign: Campaign,
    only: list[str] | None = option(
        None,
        "NAME",
        "Measure this machine only (see --list); may be repeated.",
        "--point",
        panel=MACHINE,
    ),
    listed: bool = option(False, None, "List the machines and exit.", "--list", panel=MACHINE),
    confirm: str | None = option(
        None, "SCENE[:ID]", "Also simulate the machines of the Pareto front on this view in RTL."
    ),
    scheduler: str | None = SCHEDULER,
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
            console.print(f"{point.name:22} {point.fields}")
        return
    machines = [point.config for point in chosen]
    found = campaign.views(machines)
    facts = campaigns.sweep(chosen, found, campaign.output, scheduler)
    if confirm:
        view = campaign.view_of(confirm, found[0].size)
        campaigns.confirm(chosen, facts, view, campaign.output)
    sweep_table(facts).print()
    campaign.finish("sweep", facts)


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


@command("bench ablation")
def ablation_command(
    campaign: Campaign,
    rtl: list[str] | None = option(
        None, "SCENE[:ID]", "Also simulate all steps on this view in RTL."
    ),
    quality: str | None = QUALITY,
    config: Config = PRESET,
    scheduler: str | None = SCHEDULER,
):
    """Measure the gain of culling, zero skipping and early termination.

    Adds them one by one; each step is a machine built without the missing ones. Cycles are from the
    cycle model, pictures and counts from the golden model. Writes DIR/ablation.json.
    """
    found = campaign.views([config], quality)
    from splatcore.study.bench import campaigns

    size = found[0].size
    simulated = [campaign.view_of(text, size, quality) for text in rtl or ()]
    facts = campaigns.ablation(config, found, campaign.output, scheduler, simulated)
    ablation_table(facts).print()
    campaign.finish("ablation", facts)


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


@command("bench rule")
def rule_command(
    campaign: Campaign,
    quality: str | None = option(
        None,
        "NAME",
        f"Packing of the scenes: {listed(QUALITIES)}. Default: {COMPACT}.",
        panel=MACHINE,
    ),
    config: Config = PRESET,
    scheduler: str | None = SCHEDULER,
):
    """Compare faintness rules: cycles of stage 3 against error.

    Under rule A, B, C, once T is below 2^-A, a splat that would take less than 2^-B of the light
    is skipped, and one that would leave less than 2^-C takes all of it. Tries A = 4, 5, 6, B = 9,
    11, 13, C = B − 2, 3DGS's own rule and some others, by golden and cycle model. dB and maximum
    error compare 8-bit pictures with the reference's of the same packed model under 3DGS's rule.
    Writes DIR/rule.json, rule.md and rule.csv.
    """
    found = campaign.views([config], quality)
    from splatcore.study.bench.rule import measure_rules, over_all

    found = [
        view if view.quality or is_packed(view.scene) else replace(view, quality=COMPACT)
        for view in found
    ]
    facts = measure_rules(config, found, campaign.output, scheduler)
    over_all(facts).print()
    campaign.finish("rule", facts)


QUALITY_SHOWN = (
    "scene camera asked bytes_per_gaussian psnr_db_scene psnr_db_packing psnr_db_machine "
    "max_error_machine cycles.frame model_bytes"
)
"""Keys of columns."""


@command("bench quality")
def quality_command(
    campaign: Campaign,
    psnr: str = option(
        TARGETS, "DB,DB,…", "Also pack the smallest model for each PSNR.", panel=MACHINE
    ),
    config: Config = PRESET,
    scheduler: str | None = SCHEDULER,
):
    """Measure bytes per Gaussian against dB for each way to pack.

    dB of the golden model's 8-bit pictures: against the reference's picture of the original scene
    ("scene") and of the same packed model ("machine"). Writes DIR/quality.json, a plot and
    pictures.
    """
    targets = [*numbers("--psnr", psnr, blank=True)]
    found = campaign.views([config])
    from splatcore.study.bench.quality import quality

    facts = quality(config, found, targets, campaign.output, scheduler)
    Table.of(
        "quality", "by golden and cycle model", columns(QualityRow, QUALITY_SHOWN), facts["rows"]
    ).print()
    campaign.finish("quality", facts)
