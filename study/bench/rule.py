"""`splatcore bench rule`: stage 3's cycles against error, by faintness rule (`Config.faint`).

The golden model renders each view with each rule of `rules`. Points, binning and sorting do not
depend on the rule. Cycles are the cycle model's for stage 3 alone, with splats always valid. Errors
are between 8-bit pictures of the golden model and of the reference on the same packed model with
3DGS's rule.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import Frame, render
from splatcore.golden.raster import rasterize
from splatcore.sim.common.output import write
from splatcore.sim.common.table import comma_separated, in_markdown, shown
from splatcore.sim.cycles.raster import raster_cycles
from splatcore.sim.frame.metric import against, differences
from splatcore.sim.frame.shot import View
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.study.bench.campaign import Task, collected
from splatcore.study.bench.campaigns import front

Rule = tuple[int, ...]

LIMITS, THRESHOLDS = (4, 5, 6), (9, 11, 13)
"""a and b of the rules to try: once T < 2^−a, splats that would take less than 2^−b are skipped."""

MORE: tuple[Rule, ...] = (
    (4, 10, 9), (5, 10, 9), (4, 11, 8), (5, 11, 7), (5, 11, 8), (6, 11, 8), (5, 12, 8), (5, 12, 9),
    (5, 12, 10),
)  # fmt: skip
"""Further rules (a, b, c) to try."""

LEAST, LARGEST = 55.0, 0.1
"""Minimum dB and maximum error (of 1.0) of every view under an allowed rule."""

AXES = (("raster_cycles", 1), ("psnr_db_machine_mean", -1))
"""Metrics of the Pareto front of rules, as in `bench sweep`."""

WORK = ("raster_cycles", "visited", "pairs")


def rules() -> list[Rule]:
    """All rules to try: 3DGS's, all limits with all thresholds and c = b − 2, and `MORE`."""
    return [(), *((a, b, b - 2) for a in LIMITS for b in THRESHOLDS), *MORE]


def title(rule: Rule) -> str:
    """A rule's name in tables."""
    return ", ".join(map(str, rule)) if rule else "3DGS"


def measure_rules(config: Config, views: list[View], folder: Path, scheduler: str | None) -> dict:
    """Measure all views, reuse existing results, and write rule.md and rule.csv."""
    tasks = [
        Task(
            f"rule {view.name} {view.size}".replace("/", "-").replace(":", "-"),
            f"{view} {config!r} {rules()}", measure, (config, view),
        )
        for view in views
    ]  # fmt: skip
    results, failed = collected(tasks, folder, scheduler, "rule")
    rows = [row for task in tasks for row in results.get(task.name, {}).get("rows", ())]
    facts = {
        "preset": config.name, "size": views[0].size, "quality": views[0].quality,
        "rules": summaries(rows), "rows": rows, "failed": failed,
    }  # fmt: skip
    write(folder / "rule.md", markdown(facts).encode())
    write(folder / "rule.csv", comma_separated(rows).encode())
    return facts


def measure(config: Config, view: View) -> dict:
    """Measure a view: {"rows": [one row per rule]}."""
    shot = view.open(config)
    camera, truth = shot.camera, {"machine": shot.reference}
    frame = render(replace(config, faint=()), shot.model, camera)
    about = {"scene": Path(view.scene).name, "camera": view.camera or camera.name}
    rows = [about | row(replace(config, faint=rule), frame, camera, truth) for rule in rules()]
    return {"rows": rows}


def row(config: Config, frame: Frame, camera: Camera, truth: dict[str, np.ndarray]) -> dict:
    """Work and error of a frame that is rasterized again with the machine's rule."""
    size = camera.width, camera.height
    raster = rasterize(config, frame.binned.features, frame.sorted, size)
    counts = raster.counts
    return {
        "rule": title(config.faint),
        "raster_cycles": raster_cycles(config, replace(frame, raster=raster)),
        "visited": counts["visited"], "pairs": counts["pairs"] - counts["far"] - counts["empty"],
    } | against(differences(raster.pixels, truth))  # fmt: skip


def summaries(rows: list[dict]) -> dict[str, dict]:
    """Summary of each rule over all views.

    Work is the mean ratio to 3DGS's rule. `allowed`: within the bounds of error; `front`: on the
    Pareto front of the allowed rules.
    """
    plain = {(row["scene"], row["camera"]): row for row in rows if row["rule"] == title(())}
    found = {}
    for name in dict.fromkeys(row["rule"] for row in rows):
        mine = [row for row in rows if row["rule"] == name]
        shares = {
            key: [row[key] / max(plain[row["scene"], row["camera"]][key], 1) for row in mine]
            for key in WORK
        }
        decibels = [row["psnr_db_machine"] for row in mine if row["psnr_db_machine"] is not None]
        facts = {"views": len(mine)} | {key: float(np.mean(all_)) for key, all_ in shares.items()}
        facts |= {"raster_cycles_max": max(row["raster_cycles"] for row in mine)}
        facts |= {
            f"raster_cycles_share_{f.__name__}": f(shares["raster_cycles"]) for f in (min, max)
        }
        facts |= {
            "psnr_db_machine_min": min(decibels, default=None),
            "psnr_db_machine_mean": float(np.mean(decibels)) if decibels else None,
            "psnr_db_machine_max": max(decibels, default=None),
            "max_error_machine_max": max(row["max_error_machine"] for row in mine),
        }
        facts["allowed"] = not decibels or (
            facts["psnr_db_machine_min"] >= LEAST and facts["max_error_machine_max"] <= LARGEST
        )
        found[name] = facts | {"front": False}
    known = {k: f for k, f in found.items() if f["allowed"] and f["psnr_db_machine_mean"]}
    for name in front(known, AXES) if known else ():
        found[name]["front"] = True
    return found


def markdown(facts: dict) -> str:
    """Two Markdown tables: the rules over all views, and each view with each rule."""
    rules, rows = facts["rules"], facts["rows"]
    over_all = [cells(found) for found in rules.values()]
    views = list(dict.fromkeys((row["scene"], row["camera"]) for row in rows))
    of = {(row["scene"], row["camera"], row["rule"]): row for row in rows}
    each = [
        {
            f"{scene} {camera}": f"{found['raster_cycles'] / 1000:,.0f}, "
            f"{shown(found['psnr_db_machine'], '.2f', none='∞')}, {found['max_error_machine']:.3f}"
            for scene, camera in views
            for found in [of[scene, camera, name]]
        }
        for name in rules
    ]
    tables = {
        "Mean of all views. Cycles, blocks and pairs: ratio to 3DGS's rule. dB and largest error: "
        f"machine. Allowed: ≥ {LEAST:.0f} dB and error ≤ {LARGEST} in every view.": over_all,
        "Thousands of cycles, dB (machine) and largest error per view:": each,
    }
    names = list(rules)
    return (
        "\n\n".join(p for head, t in tables.items() for p in (head, in_markdown(names, t))) + "\n"
    )


def cells(found: dict) -> dict[str, str]:
    """A rule's summary as a row of a table."""
    decibels = [shown(found[f"psnr_db_machine_{k}"], ".2f", none="∞") for k in ("mean", "min")]
    ends = [f"{found[f'raster_cycles_share_{k}']:.3f}" for k in ("min", "max")]
    return {
        "cycles": f"{found['raster_cycles']:.3f}", "min … max": " … ".join(ends),
        "blocks": f"{found['visited']:.3f}", "pairs": f"{found['pairs']:.3f}",
        "dB, mean": decibels[0], "dB, min": decibels[1],
        "largest error": f"{found['max_error_machine_max']:.3f}",
        "allowed": "yes" if found["allowed"] else "no", "front": "*" if found["front"] else "",
    }  # fmt: skip
