"""The command `error`: errors of the machine's numbers, and their tables."""

import time
from dataclasses import replace
from pathlib import Path

from splatcore.app.cli.error_tables import decibels, print_tables
from splatcore.app.cli.options import (
    MACHINE,
    OUTPUT,
    SCENE,
    AntialiasedOption,
    AxesOption,
    JsonOption,
    NearOption,
    QualityOption,
    app,
    argument,
    option,
)
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import console, messages, write_json
from splatcore.sim.common.table import print_whole
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import View, check_source
from splatcore.spec.config import DEFAULT, PRESETS, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ScenesArgument = argument(
    list[str] | None, "SCENE|MODEL", "Default: all scenes of --scenes and the hard cases."
)
StageOption = option(
    str, "NAME", "Stage to measure: project, sort or raster; or all: the budget of a picture."
)
ScenesOption = option(
    str | None,
    "DIR",
    "Folder of scenes. Default: SPLATCORE_SCENES, else ../shared/scenes.",
    panel=SCENE,
)
WidthOption = option(
    list[str] | None,
    "E/F",
    "Machine with E exponent and F fraction bits; may be repeated.",
    panel=MACHINE,
)
MachineOption = option(
    list[str] | None,
    "NAME|FILE",
    f"Machine: {', '.join(PRESETS)} or a TOML file; may be repeated.",
    "--preset",
    panel=MACHINE,
)
ViewOption = option(
    str | None,
    "FILE[:ID]",
    "Camera of the SCENE. Default: the first in the file next to it, else a generated view.",
    "--camera",
    panel=SCENE,
)
SizeOption = option(
    str | None,
    "WxH",
    "Pixels; hard cases keep their own size unless named as SCENE.",
    "--size",
    panel=SCENE,
)
OutputOption = option(Path | None, "PLOT.png", "Plot the errors.", "-o", panel=OUTPUT)

SWEEPS = ("sort", "raster")
"""Stages whose number formats are swept."""

EVERYTHING = "all"
"""Value of --stage for the budget of all errors."""

BUDGET = (
    "Pictures are rounded to 8 bits only for the part of that name. Parts of packing are compared\n"
    "with the original scene, parts of the machine with the packed model; share of the total square"
)


@app.command("error")
def error_command(
    scene: ScenesArgument = None,
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
    """Measure the error of the machine's numbers, stage by stage.

    --stage project: compares each field of a splat by the golden model of stages 0 and 1 with the
    float64 reference on the same packed model, and pictures blended in float64 from the splats.
    Machines: PAPER, DEFAULT and widths in between, or those of --preset and --width. A machine that
    packs models unlike DEFAULT (PAPER) is also compared with DEFAULT's packed model ("and
    packing"). Exponents up to 5 bits have FP16's infinities; non-finite splats are only counted.

    --stage sort: sorts by depth keys of fewer bits; prints PSNR and maximum error of the pictures
    against float64, and the number of entries out of place.

    --stage raster: changes one number format of stage 3 at a time; prints PSNR and maximum error
    of the pictures, and the gates of a lane from synthesis.

    --stage all: splits the error of the 8-bit picture against the original scene into parts
    (packed positions, shape, opacity, colours; arithmetic; depth keys; stage 3; 8 bits), each
    alone, their sum, and all together. For one machine.
    """
    seen = camera, size, Reading(antialiased, axes, near)
    for text in scene or ():
        check_source(text, seen[-1])
    from splatcore.study.accuracy.points import MACHINES, with_width
    from splatcore.study.accuracy.run import everything, named

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
    """Raise InputError for an unknown stage, or options that do not go with it."""
    check_known("--stage", ("project", *SWEEPS, EVERYTHING), stage)
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
        if stage != EVERYTHING:
            raise InputError(f"--quality: goes with --stage {EVERYTHING}")
    if stage in SWEEPS and machines:
        raise InputError(f"--stage {stage}: has formats of its own; omit --width and --preset")
    if stage == EVERYTHING and machines > 1:
        raise InputError(f"--stage {EVERYTHING}: takes one machine: one --preset or --width")


def error_of_formats(stage: str, views: dict[str, View], output: Path | None, json: Path | None):
    """Measure the error by format of stage 2's keys, or of stage 3."""
    from splatcore.study.accuracy import raster, sort

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
    """Measure the errors of all parts of packing and machine."""
    from splatcore.study.accuracy.budget import (
        budget_line,
        budget_table,
        budgets,
        write_budget_plot,
    )

    rows = budgets(config, views)
    for found in rows:
        budget_table(found).print()
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
    """Measure the errors of stages 0 and 1.

    visible: raise InputError for a scene of which no Gaussian is visible
    """
    from splatcore.study.accuracy.plot import write_error_plot
    from splatcore.study.accuracy.points import width_of
    from splatcore.study.accuracy.run import measured

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
    print_tables(results, largest, machines)
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
    """Return the largest RMS and maximum error: "scenes" or "hard" → machine → field → rms, max."""
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
