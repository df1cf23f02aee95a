"""The command `fit`: the smallest machine for a scene, and the preset file that describes it."""

import math
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from splatcore.app.cli import options
from splatcore.app.cli.options import option
from splatcore.sim.common.output import console, messages, progress_bar
from splatcore.sim.common.preset_file import write_preset
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.metric import LEVELS
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source, open_cameras, open_source
from splatcore.spec.config import CLOCK_HZ, DEFAULT, PRESETS, Config
from splatcore.spec.error import InputError
from splatcore.study.results.fields import with_names

if TYPE_CHECKING:
    from splatcore.study.fit.search import Fit, Knob
    from splatcore.study.fit.views import View


MINIMUM = {"fps": 1e-3, "psnr": 1.0}  # of --fps and --psnr
PSNR_MAX = 200.0  # a limit for typing errors; 8 bits cannot show as much


@options.command("fit")
def fit_command(
    view: options.NextCameras,
    scene: str = options.SOURCE,
    output: Path = option(..., "PRESET.toml", "Preset file to write."),
    fps: float = option(..., "F", "Target: frames per second at 800 MHz."),
    psnr: float | None = option(
        None,
        "P",
        "Target: dB against the reference on the packed model. Default: keep DEFAULT's formats.",
    ),
    gates: bool = option(False, None, "Also synthesise all parts of the machine and of DEFAULT."),
    confirm: bool = option(
        False, None, "Also simulate the slowest view in RTL, which takes minutes."
    ),
) -> dict:
    """Find the smallest machine that renders a scene fast and well enough.

    Every view must reach F frames per second, by the cycle model with a margin for memory, and P dB
    against the float64 reference on the same packed model. Smallest means fewest gates. Writes a
    preset file for --preset, with the reason for each size.

    Exit status 1, and no file, if no machine reaches the targets. Also 1 if --confirm finds the
    machine too slow in RTL, or its picture different from the golden model's.
    """
    begin = time.perf_counter()
    _check_figures(fps, psnr)
    name = _name(output)
    source, start, views = _open(name, scene, view)
    from splatcore.study.fit.search import Impossible, fit, knobs

    try:
        with progress_bar("fitting") as advance:
            chosen = fit(start, views, fps, psnr, lambda text: advance(0, None, text))
    except Impossible as impossible:
        messages.print(f"impossible: {impossible}", soft_wrap=True)
        raise typer.Exit(1) from None
    rows = knobs(chosen)
    reasons = {row.name: row.reason for row in rows}
    reasons |= {"pe_arrays": reasons["pes"], "depth": "as arithmetic"}
    target = f"{fps:g} frames per second" + ("" if psnr is None else f", {psnr:g} dB (machine)")
    about = f"splatcore fit {Path(scene).name}, {len(views)} views: {target}"
    write_preset(output, chosen.config, DEFAULT, reasons, about)
    sizes = _gates(chosen.config) if gates else {}
    facts = _facts(chosen, rows, sizes)
    _show(facts, rows, f"{chosen.config.name}: {target}")
    facts["seconds"] = round(time.perf_counter() - begin, 1)
    console.print(f"{output}: {facts['seconds']:.0f} s")
    if confirm:
        facts["confirmed"] = _confirm(chosen, views, fps)
    asked = {"scene": scene, "fps": fps, "psnr_db_machine": psnr} | source.stated
    return options.result(asked | facts, confirm and not facts["confirmed"]["reached"])


def _open(name: str, scene: str, view: options.NextCameras) -> "tuple[Source, Config, list[View]]":
    """Return the scene, the machine to start from and the views to fit it to."""
    with progress_bar(f"reading {scene}") as advance:
        source = open_source(scene, view.reading)
        own = None if view.cameras else view.camera_of(scene)
        found = open_cameras(own or view.camera, view.cameras, view.size, source)
        from splatcore.study.fit.views import start_config, views_of

        model = Shot(source, found[0]).model
        views = views_of(source.name, model, found, advance)
        return source, start_config(name, model, found), views


def _check_figures(fps: float, psnr: float | None):
    """Raise InputError for targets out of range."""
    if not (math.isfinite(fps) and MINIMUM["fps"] <= fps <= CLOCK_HZ):
        raise InputError(f"--fps {fps:g}: is not in {MINIMUM['fps']:g} … {CLOCK_HZ:g}")
    if psnr is not None and not (math.isfinite(psnr) and MINIMUM["psnr"] <= psnr <= PSNR_MAX):
        raise InputError(f"--psnr {psnr:g}: is not in {MINIMUM['psnr']:g} … {PSNR_MAX:g} dB")


def _name(path: Path) -> str:
    """Return the preset's name, made from its file's."""
    if path.suffix.lower() != ".toml":
        raise InputError(f"-o {path}: must end in .toml")
    name = re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)
    if name.upper() in PRESETS:
        raise InputError(f"-o {path}: {name} is the name of a built-in preset")
    return name


def _gates(config: Config) -> dict[str, tuple[float, float]]:
    """Synthesise each part; return NAND2-equivalents of DEFAULT and of the machine."""
    from splatcore.study.fit.gates import part_gates

    with progress_bar("synthesising") as advance:
        before, after = (
            part_gates(c, lambda part, c=c: advance(0, None, f"synthesising {c.name}: {part}"))
            for c in (DEFAULT, config)
        )
    return {name: (before[name], after[name]) for name in before}


FIELDS = (
    Column("field", get=lambda row: row.name.replace("_", " ")),
    Column("DEFAULT", digits=0, get=lambda row: str(row.before)),
    Column("chosen", digits=0, get=lambda row: str(row.value)),
    Column("reason"),
)
"""Columns of a table of `search.Knob`."""

VIEWS = (
    Column("view"),
    *(Column(name, digits=0) for name in ("preprocessing", "rendering", "frame")),
    Column("FPS", digits=1, get="fps"),
    Column("dB, machine", digits=2, get="psnr_db_machine", none="exact"),
    Column(
        "max error, machine",
        digits=1,
        get=lambda row: f"{row['max_error_machine'] * LEVELS:.1f}/{LEVELS}",
    ),
)
"""Columns of a table of the views in `_facts`."""

PARTS = (
    Column("part"),
    Column("DEFAULT", digits=1, get="default", per=1000),
    Column("chosen", digits=1, per=1000),
)
"""Columns of a table of the gates in `_facts`."""


def _show(facts: dict, rows: "list[Knob]", title: str):
    """Print all tables."""
    Table.of("fields", title, FIELDS, rows).print()
    Table.of("views", "", VIEWS, with_names("view", facts["views"])).print()
    if sizes := list(with_names("part", facts["gates"])):
        every = {key: sum(row[key] for row in sizes) for key in ("default", "chosen")}
        title = "thousands of NAND2, all instances"
        Table.of("gates", title, PARTS, [*sizes, {"part": "all of these"} | every]).print()


def _facts(found: "Fit", rows: "list[Knob]", sizes: dict) -> dict:
    """Return the object that `--json` writes."""
    from splatcore.study.fit.formats import decibels

    views = {}
    for view, (square, largest) in found.errors.items():
        psnr = decibels(square)
        views[view] = found.cycles(view).by_name | {
            "fps": round(found.fps(view), 1),
            "psnr_db_machine": psnr if math.isfinite(psnr) else None, "max_error_machine": largest,
        }  # fmt: skip
    return {
        "preset": found.config.name,
        "cycles_max": found.most,
        "fields": {
            row.name: {"default": row.before, "chosen": row.value, "reason": row.reason}
            for row in rows
        },
        "views": views,
        "gates": {name: {"default": a, "chosen": b} for name, (a, b) in sizes.items()},
    }


def _confirm(found: "Fit", views: "list[View]", fps: float) -> dict:
    """Simulate the slowest view in RTL; print and return the outcome."""
    from splatcore.sim.machine.machine import Job
    from splatcore.sim.machine.path import build, simulate
    from splatcore.sim.machine.script import LPDDR4
    from splatcore.study.bench.scenes import FRAMES, judge

    name, _ = found.speed.slowest(found.config)
    view = next(view for view in views if view.name == name)
    golden = view.frame(found.config)
    run = simulate(
        build(found.config), [Job(view.model, view.camera)] * FRAMES, LPDDR4, f"simulating {name}"
    )
    if not run.done:
        console.print(f"{name}: the machine failed: {run.why}")
        return {"view": name, "reached": False, "ended": run.why}
    exact = np.rint(view.exact * LEVELS).astype(np.uint8)
    facts = judge(found.config, run, golden, {"machine": exact})
    cycles = facts["cycles"]
    reached = facts["identical"] and cycles["fps_at_800mhz"] >= fps
    same = "identical to the golden model's" if facts["identical"] else facts["difference"]
    console.print(
        f"{name} in RTL: {cycles['frame']:,} cycles (model {found.cycles(name).frame:,}), "
        f"{cycles['fps_at_800mhz']:.1f} frames per second, picture {same}: "
        f"{'confirmed' if reached else 'NOT confirmed'}"
    )
    return {"view": name, "reached": reached} | facts
