"""The command `error` and its tables."""

import time
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

from rich.table import Table

from splatcore.model.generate.hard import HARD
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.cli.options import (
    AntialiasedOption,
    AxesOption,
    JsonOption,
    NearOption,
    QualityOption,
    app,
    argument,
    option,
)
from splatcore.sim.common.output import console, messages, write_json
from splatcore.sim.common.reading import Reading
from splatcore.sim.common.source import View, check_known, check_source
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.spec.config import DEFAULT, PRESETS, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

Scenes = argument(
    list[str] | None, "SCENE|MODEL", "Default: all scenes of --scenes and the hard cases."
)
StageOption = option(
    str, None, "Which stage's errors: project, sort, raster; or all: the budget of a picture."
)
ScenesOption = option(
    str | None, "DIR", "Folder of scenes. Default: SPLATCORE_SCENES, else ../shared/scenes."
)
WidthOption = option(
    list[str] | None, "E/F", "A machine with these exponent/fraction bits. May repeat."
)
MachineOption = option(
    list[str] | None,
    "NAME",
    f"A machine: {', '.join(PRESETS)} or a preset file. May repeat.",
    "--preset",
)
ViewOption = option(
    str | None,
    "FILE[:ID]",
    "Camera of the SCENE. Default: the first of NAME.cameras.json beside NAME.ply (.spz, "
    "…), else a sensible view.",
)
SizeOption = option(str | None, "WxH", "Pixels; hard cases keep theirs unless they are named.")
OutputOption = option(Path | None, "PLOT.png", "Draw the errors.", "-o")

LABELS = {
    "depth_stage_0": "depth, stage 0",
    "u": "u, pixels",
    "v": "v, pixels",
    "colour": "colour, of full scale",
}
"""Names of fields in the tables, where they differ; what has no unit there is relative."""

COUNT_TITLE = (
    "Visible Gaussians lost + splats that are not finite.\n"
    "axes: longest over shortest axis of a visible Gaussian; on screen: of a splat, with blur"
)

COUNTS = {
    "projected": "projected",
    "lost": "lost: visible, not projected",
    "gained": "gained: seen, in the reference not",
    "not_finite": "with a field that is not finite",
    "not_positive": "not positive definite",
}
"""Counts of each machine and their names in the table."""


SWEEPS = ("sort", "raster")
"""Stages of `--stage` beside project whose formats are swept."""

EVERYTHING = "all"
"""The stage of `--stage` that is the budget of all errors."""

BUDGET = (
    "Pictures are not rounded to 8 bits but where that is the part: those of packing against the\n"
    "scene as it is, those of the machine against the packed model; share: of everything's square"
)


@app.command("error")
def error_command(
    scene: Scenes = None,
    stage: StageOption = "project",
    scenes: ScenesOption = None,
    width: WidthOption = None,
    machine: MachineOption = None,
    camera: ViewOption = None,
    size: SizeOption = None,
    antialiased: AntialiasedOption = None,
    axes: AxesOption = None,
    near: NearOption = None,
    quality: QualityOption = None,
    output: OutputOption = None,
    json: JsonOption = None,
):
    """Error of the numbers of stages 0 and 1: each field, and the picture that they make.

    The golden model of stages 0 and 1 against the float64 reference on the same packed model, by
    machine: PAPER, DEFAULT and widths between (exponent/fraction bits), or those of --preset
    and --width. Pictures are blended in float64 from stage 1's splats.

    For a machine that has its models packed otherwise than DEFAULT (PAPER: FP16 positions, smaller
    codebooks) the picture is also compared with the reference's of the scene as packed for DEFAULT:
    "and packing" in the table, what its packing and its numbers lose together.

    With --stage sort: order by depth keys of fewer bits, on exact inputs: PSNR and largest error of
    the pictures against float64, and how many entries changed places.

    With --stage raster: the formats of stage 3, one changed at a time, on exact inputs: PSNR and
    largest error of the pictures against float64, over the gates of a lane from synthesis.

    With --stage all: where the error of the 8-bit picture against the scene as it is comes from, by
    part: positions, shape, opacity and colours as they are packed, arithmetic of stages 0 and 1,
    order by depth keys, stage 3, 8 bits; each alone, their sum, and all together. Of one machine.

    Exponents of 5 bits or less have FP16's infinities. Splats that are not finite are only counted.
    """
    seen = camera, size, Reading(antialiased, axes, near)
    for text in scene or ():
        check_source(text, seen[-1])
    from splatcore.sim.accuracy.points import MACHINES, with_width
    from splatcore.sim.accuracy.run import everything, named

    chosen = [*map(find_preset, machine or ()), *map(with_width, width or ())]
    check_stage(stage, quality, len(chosen))
    if scene and scenes:
        raise InputError(f"--scenes {scenes}: name a folder or a SCENE, not both")
    views = named(scene, *seen) if scene else everything(scenes, *seen)
    own = {name: view for name, view in views.items() if scene or name not in HARD}
    if stage == EVERYTHING:
        own = {name: replace(view, quality=quality) for name, view in own.items()}
        return error_budget(own, (chosen or [DEFAULT])[0], output, json)
    if stage in SWEEPS:
        return error_of_formats(stage, own, output, json)
    machines = tuple({config.name: config for config in chosen or MACHINES}.values())
    error_of_points(views, machines, bool(scene), output, json)


def check_stage(stage: str, quality: str | None, machines: int):
    """InputError for a stage that there is not, and for what does not go with it."""
    check_known("--stage", ("project", *SWEEPS, EVERYTHING), stage)
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
        if stage != EVERYTHING:
            raise InputError(f"--quality: goes with --stage {EVERYTHING}")
    if stage in SWEEPS and machines:
        raise InputError(f"--stage {stage}: has formats of its own, without --width, --preset")
    if stage == EVERYTHING and machines > 1:
        raise InputError(f"--stage {EVERYTHING}: is of one machine; name one --preset or --width")


def error_of_formats(stage: str, views: dict[str, View], output: Path | None, json: Path | None):
    """Errors by the formats of stage 2's keys, or of stage 3."""
    from splatcore.sim.accuracy import raster, sort

    measure, table, plot = {
        "sort": (sort.sort_errors, sort.sort_table, sort.write_sort_plot),
        "raster": (raster.raster_errors, raster.raster_table, raster.write_raster_plot),
    }[stage]
    found = measure(views)
    print_whole(table(found))
    if output:
        plot(output, found)
    write_json(json, {"stage": stage, "machines": found})


def error_budget(views: dict[str, View], config: Config, output: Path | None, json: Path | None):
    """Errors of all parts of packing and machine."""
    from splatcore.sim.accuracy.budget import budget_line, budget_table, budgets, write_budget_plot

    rows = budgets(config, views)
    for found in rows:
        print_whole(budget_table(found))
        console.print(f"{budget_line(found)}\n", soft_wrap=True)
    console.print(BUDGET, soft_wrap=True)
    if output:
        write_budget_plot(output, rows)
    sizes = {"x".join(map(str, found["size"])) for found in rows}
    size = sizes.pop() if len(sizes) == 1 else None
    facts = {"stage": EVERYTHING, "preset": config.name, "size": size, "rows": rows}
    write_json(json, facts)


def error_of_points(
    views: dict[str, View],
    machines: tuple[Config, ...],
    visible: bool,
    output: Path | None,
    json: Path | None,
):
    """Errors of stages 0 and 1; InputError if a scene is not visible that has to be."""
    from splatcore.sim.accuracy.plot import write_error_plot
    from splatcore.sim.accuracy.points import width_of
    from splatcore.sim.accuracy.run import measured

    begin, results = time.perf_counter(), {}
    for name, facts in measured(views, machines):
        if visible and not facts["visible"]:
            raise InputError(f"{name}: no Gaussian is visible from this camera")
        results[name] = facts
        pictures = [f"{machine} {decibels(found)}" for machine, found in facts["machines"].items()]
        line = f"{name}: {', '.join(pictures)} dB; {facts['seconds']:.0f} s"
        messages.print(line, markup=False, soft_wrap=True)
    results = {name: results[name] for name in views}
    largest = largest_errors(results)
    show(results, largest, machines)
    if output:
        write_error_plot(output, results, largest, machines)
    facts = {
        c.name: {"arithmetic": width_of(c), "position": c.position}
        | {"screen_exponent": c.screen_exponent}
        for c in machines
    }
    found = {"stage": "project", "machines": facts, "scenes": results, "largest": largest}
    write_json(json, found | {"seconds": round(time.perf_counter() - begin, 1)})


def largest_errors(results: dict[str, dict]) -> dict[str, dict]:
    """Largest RMS and largest error: "scenes" or "hard" → machine → field → rms, max."""
    largest = {}
    for facts in results.values():
        kind = largest.setdefault("hard" if facts["hard"] else "scenes", {})
        for name, result in facts["machines"].items():
            machine = kind.setdefault(name, {})
            for field, sizes in result["fields"].items():
                old = machine.setdefault(field, dict.fromkeys(sizes))
                for key, size in sizes.items():
                    known = [value for value in (old[key], size) if value is not None]
                    old[key] = max(known, default=None)
    return largest


def decibels(result: dict, key: str = "psnr_db_machine") -> str:
    """A picture's PSNR."""
    return shown(result[key], ".1f", none="exact")


def show(results: dict[str, dict], largest: dict[str, dict], machines: tuple[Config, ...]):
    """Print all tables: pictures and counts by scene, errors by field."""
    from splatcore.sim.accuracy.points import heading

    headings = [*map(heading, machines)]
    title = "PSNR of the pictures, dB, machine: against the reference on the same packed model"
    tables = {title: picture_table(results, machines, headings)}
    for kind, name in (("scenes", "scenes"), ("hard", "hard cases")):
        if kind in largest:
            title = f"Errors over the {name}: largest RMS, largest of all; relative but for units"
            tables[title] = field_table(largest[kind], machines, headings)
    tables[COUNT_TITLE] = count_table(results, machines, headings)
    tables["All together"] = total_table(results, machines, headings)
    for title, table in tables.items():
        console.print(f"\n{title}", soft_wrap=True)
        print_whole(table)


def picture_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """PSNR of every scene's picture by machine; with packing where models differ from DEFAULT's."""
    packing = attrgetter("position", "colour_index", "sh_index")
    other = [config.name for config in machines if packing(config) != packing(DEFAULT)]
    headings = [*headings, *(f"{name} and\npacking" for name in other)]
    table = new_table("scene", headings)
    for name, facts in results.items():
        cells = [decibels(result) for result in facts["machines"].values()]
        cells += [decibels(facts["machines"][name], "psnr_db_default_model") for name in other]
        table.add_row(name, *cells)
    return table


def field_table(
    largest: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Errors by field and machine."""
    table = new_table("field", headings)
    for field in next(iter(largest.values())):
        name = LABELS.get(field, field.replace("_", " "))
        for key, text in (("rms", name), ("max", "  largest")):
            sizes = [largest[config.name][field][key] for config in machines]
            table.add_row(text, *(shown(size, ".1e") for size in sizes))
    return table


def count_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Visible Gaussians and their longest axes, and those missing in each machine's picture."""
    table = new_table("scene", ["visible", "axes", "on screen", *headings])
    for name, facts in results.items():
        ratio = facts["axis_ratio"]
        cells = [f"{facts['visible']:,}", "∞" if ratio is None else f"{ratio:,.0f}"]
        cells.append(f"{facts['screen_ratio']:,.0f}")
        for result in facts["machines"].values():
            lost, broken = result["lost"], result["not_finite"]
            cells.append(f"{lost}+{broken}" if lost or broken else "–")
        table.add_row(name, *cells)
    return table


def total_table(
    results: dict[str, dict], machines: tuple[Config, ...], headings: list[str]
) -> Table:
    """Counts over all scenes by machine."""
    table = new_table("Gaussians", headings)
    for key, name in COUNTS.items():
        counts = [[facts["machines"][c.name][key] for facts in results.values()] for c in machines]
        table.add_row(name, *(f"{sum(each):,}" for each in counts))
    return table
