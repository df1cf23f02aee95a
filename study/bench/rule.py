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
from splatcore.sim.common.table import Column, Table, comma_separated
from splatcore.sim.cycles.raster import raster_cycles
from splatcore.sim.frame.metric import LEVELS, against, differences
from splatcore.sim.frame.shot import View
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.study.bench.campaign import rows_of_views
from splatcore.study.bench.campaigns import front
from splatcore.study.results.campaigns import RuleRow, RuleSummary
from splatcore.study.results.fields import columns, facts, with_names

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

SHOWN = (
    "raster_cycles raster_cycles_share_min raster_cycles_share_max visited pairs "
    "psnr_db_machine_mean psnr_db_machine_min max_error_machine_max allowed front"
)
"""Keys of columns."""


def rules() -> list[Rule]:
    """All rules to try: 3DGS's, all limits with all thresholds and c = b − 2, and `MORE`."""
    return [(), *((a, b, b - 2) for a in LIMITS for b in THRESHOLDS), *MORE]


def title(rule: Rule) -> str:
    """A rule's name in tables."""
    return ", ".join(map(str, rule)) if rule else "3DGS"


def measure_rules(config: Config, views: list[View], folder: Path, scheduler: str | None) -> dict:
    """Measure all views, reuse existing results, and write rule.md and rule.csv."""
    rows, failed = rows_of_views("rule", measure, views, folder, scheduler, config, rules())
    found = {
        "preset": config.name, "size": views[0].size, "quality": views[0].quality,
        "rules": summaries(rows), "rows": rows, "failed": failed,
    }  # fmt: skip
    write(folder / "rule.md", markdown(found).encode())
    write(folder / "rule.csv", comma_separated(rows).encode())
    return found


def measure(view: View, config: Config, rules: list[Rule]) -> dict:
    """Measure a view: {"rows": [one row per rule]}."""
    shot = view.open(config)
    camera, truth = shot.camera, {"machine": shot.reference}
    frame = render(replace(config, faint=()), shot.model, camera)
    about = {"scene": Path(view.scene).name, "camera": view.camera or camera.name}
    rows = [row(replace(config, faint=rule), frame, camera, truth, about) for rule in rules]
    return {"rows": facts(rows)}


def row(
    config: Config, frame: Frame, camera: Camera, truth: dict[str, np.ndarray], about: dict
) -> RuleRow:
    """Work and error of a frame that is rasterized again with the machine's rule.

    about: the view
    """
    size = camera.width, camera.height
    raster = rasterize(config, frame.binned.features, frame.sorted, size)
    counts = raster.counts
    return RuleRow(
        rule=title(config.faint), visited=counts["visited"],
        raster_cycles=raster_cycles(config, replace(frame, raster=raster)),
        pairs=counts["pairs"] - counts["far"] - counts["empty"],
        **about, **against(differences(raster.pixels, truth)),
    )  # fmt: skip


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
        least, largest = min(decibels, default=None), max(row["max_error_machine"] for row in mine)
        allowed = least is None or (least >= LEAST and largest <= LARGEST)
        found[name] = facts(RuleSummary(
            views=len(mine), raster_cycles_max=max(row["raster_cycles"] for row in mine),
            raster_cycles_share_min=min(shares["raster_cycles"]),
            raster_cycles_share_max=max(shares["raster_cycles"]), psnr_db_machine_min=least,
            psnr_db_machine_mean=float(np.mean(decibels)) if decibels else None,
            psnr_db_machine_max=max(decibels, default=None), max_error_machine_max=largest,
            allowed=allowed, front=False,
            **{key: float(np.mean(all_)) for key, all_ in shares.items()},
        ))  # fmt: skip
    known = {k: f for k, f in found.items() if f["allowed"] and f["psnr_db_machine_mean"]}
    for name in front(known, AXES) if known else ():
        found[name]["front"] = True
    return found


def over_all(result: dict) -> Table:
    """The rules over all views."""
    return Table.of(
        "rules",
        "Mean of all views. Cycles, blocks and pairs: ratio to 3DGS's rule. PSNR and largest "
        f"error: machine. Allowed: ≥ {LEAST:.0f} dB and error ≤ {LARGEST} in every view.",
        [Column("rule"), *columns(RuleSummary, SHOWN)], with_names("rule", result["rules"]),
    )  # fmt: skip


def by_view(result: dict) -> Table:
    """Each view with each rule."""
    rows: dict[str, dict[str, str]] = {}
    cycles, decibels, error = columns(RuleRow, "raster_cycles psnr_db_machine max_error_machine")
    for row in result["rows"]:
        cells = (column.cell(column.value(row)) for column in (cycles, decibels, error))
        view = f"{row['scene']} {row['camera']}"
        rows.setdefault(row["rule"], {"rule": row["rule"]})[view] = ", ".join(cells)
    views = dict.fromkeys(f"{row['scene']} {row['camera']}" for row in result["rows"])
    return Table(
        "views",
        f"Thousands of cycles, PSNR (machine) and largest error of {LEVELS} per view:",
        [Column(name) for name in ("rule", *views)], [list(row.values()) for row in rows.values()],
    )  # fmt: skip


def markdown(result: dict) -> str:
    """Two Markdown tables: the rules over all views, and each view with each rule."""
    return f"{over_all(result).markdown()}\n\n{by_view(result).markdown()}\n"
