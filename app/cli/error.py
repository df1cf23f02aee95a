"""The command `error`: errors of the machine's numbers, stage by stage."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from splatcore.app.cli.error_tables import decibels, print_tables
from splatcore.app.cli.options import (
    MACHINE,
    QUALITY,
    Viewing,
    argument,
    command,
    listed,
    option,
)
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.option import SCENE
from splatcore.sim.common.output import console, messages
from splatcore.sim.frame.shot import View
from splatcore.sim.frame.source import check_source
from splatcore.spec.config import DEFAULT, PRESETS, Config
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset


@dataclass(frozen=True)
class SceneView(Viewing):
    """The options of a scene and its view; without SCENE they go for all."""

    camera: str | None = option(
        None,
        "FILE[:ID]",
        "Camera of the SCENE. Default: the first in the file next to it, else a generated view.",
        panel=SCENE,
    )
    size: str | None = option(
        None, "WxH", "Pixels; hard cases keep their own size unless named as SCENE.", panel=SCENE
    )
    scenes: str | None = option(
        None,
        "DIR",
        "Folder of scenes. Default: SPLATCORE_SCENES, else ../shared/scenes.",
        panel=SCENE,
    )


BUDGET = (
    "Pictures are rounded to 8 bits only for the part of that name. Parts of packing are compared\n"
    "with the original scene, parts of the machine with the packed model; share of the total square"
)


class Errors(NamedTuple):
    """The measured errors of a stage.

    show: prints its tables
    plot: writes its plot into a file
    facts: for `--json`
    """

    show: Callable[[], object]
    plot: Callable[[Path], object]
    facts: dict


Views = dict[str, View]


def of_points(views: Views, machines: list[Config], quality: str | None, named: bool) -> Errors:
    """Measure the errors of stages 0 and 1; a scene that is named must be visible."""
    from splatcore.study.accuracy.plot import write_error_plot
    from splatcore.study.accuracy.points import MACHINES, width_of
    from splatcore.study.accuracy.run import measured

    begin, results = time.perf_counter(), {}
    machines = tuple({config.name: config for config in machines or MACHINES}.values())
    for name, facts in measured(views, machines):
        if named and not facts["visible"]:
            raise InputError(f"{name}: no Gaussian is visible from this camera")
        results[name] = facts
        pictures = [f"{machine} {decibels(found)}" for machine, found in facts["machines"].items()]
        line = f"{name}: {', '.join(pictures)} dB; {facts['seconds']:.0f} s"
        messages.print(line, soft_wrap=True)
    results = {name: results[name] for name in views}
    largest = largest_errors(results)
    facts = {
        c.name: {"arithmetic": width_of(c), "position": c.position}
        | {"screen_exponent": c.screen_exponent}
        for c in machines
    }
    return Errors(
        lambda: print_tables(results, largest, machines),
        lambda path: write_error_plot(path, results, largest, machines),
        {"machines": facts, "scenes": results, "largest": largest}
        | {"seconds": round(time.perf_counter() - begin, 1)},
    )


def of_formats(stage: str) -> Callable[..., Errors]:
    """Return the measurement of stage 2 or 3, whose number formats are swept."""

    def measure(views: Views, *_) -> Errors:
        from splatcore.study.accuracy import formats

        found = formats.STAGES[stage].errors(views)
        show, plot = formats.table(found).print, partial(formats.write_plot, stage, found)
        return Errors(show, plot, {"machines": found})

    return measure


def of_all(views: Views, machines: list[Config], quality: str | None, *_) -> Errors:
    """Measure the errors of all parts of packing and machine."""
    from splatcore.study.accuracy import budget

    [config] = machines or [DEFAULT]
    views = {name: replace(view, quality=quality) for name, view in views.items()}
    rows = budget.budgets(config, views)
    sizes = {"x".join(map(str, found["size"])) for found in rows}
    size = sizes.pop() if len(sizes) == 1 else None

    def show():
        for found in rows:
            budget.budget_table(found).print()
            console.print(f"{budget.budget_line(found)}\n")
        console.print(BUDGET)

    facts = {"preset": config.name, "size": size, "rows": rows}
    return Errors(show, lambda path: budget.write_budget_plot(path, rows), facts)


class Stage(NamedTuple):
    """A value of --stage.

    measure: called with the views, the given machines, the quality, and whether scenes were named
    machines: how many may be given
    hard: whether it measures the hard cases, too, if no scene is named
    """

    measure: Callable[[Views, list[Config], str | None, bool], Errors]
    machines: int | None = None
    hard: bool = False


EVERYTHING = "all"

STAGES = {
    "project": Stage(of_points, hard=True),
    "sort": Stage(of_formats("sort"), 0),
    "raster": Stage(of_formats("raster"), 0),
    EVERYTHING: Stage(of_all, 1),
}


@command("error")
def error_command(
    view: SceneView,
    scene: list[str] | None = argument(
        None, "SCENE|MODEL", "Default: all scenes of --scenes and the hard cases."
    ),
    stage: str = option(
        "project",
        "NAME",
        "Stage to measure: project, sort or raster; or all: the budget of a picture.",
    ),
    width: list[str] | None = option(
        None, "E/F", "Machine with E exponent and F fraction bits; may be repeated.", panel=MACHINE
    ),
    machine: list[str] | None = option(
        None,
        "NAME|FILE",
        f"Machine: {listed(PRESETS)} or a TOML file; may be repeated.",
        "--preset",
        panel=MACHINE,
    ),
    quality: str | None = QUALITY,
    output: Path | None = option(None, "PLOT.png", "Plot the errors."),
) -> dict:
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
    seen = view.camera, view.size, view.reading
    for text in scene or ():
        check_source(text, view.reading)
    from splatcore.study.accuracy.points import with_width
    from splatcore.study.accuracy.run import everything, named

    machines = [*map(find_preset, machine or ()), *map(with_width, width or ())]
    check_stage(stage, quality, len(machines))
    if scene and view.scenes:
        raise InputError(f"--scenes {view.scenes}: name a folder or a SCENE, not both")
    views = named(scene, *seen) if scene else everything(view.scenes, *seen)
    if not (scene or STAGES[stage].hard):
        views = {name: each for name, each in views.items() if name not in HARD}
    found = STAGES[stage].measure(views, machines, quality, bool(scene))
    found.show()
    if output:
        found.plot(output)
    return {"stage": stage} | found.facts


def check_stage(stage: str, quality: str | None, machines: int):
    """Raise InputError for an unknown stage, or options that do not go with it."""
    check_known("--stage", STAGES, stage)
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
        if stage != EVERYTHING:
            raise InputError(f"--quality: goes with --stage {EVERYTHING}")
    most = STAGES[stage].machines
    if machines and most == 0:
        raise InputError(f"--stage {stage}: has formats of its own; omit --width and --preset")
    if most is not None and machines > most:
        raise InputError(f"--stage {stage}: takes one machine: one --preset or --width")


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
