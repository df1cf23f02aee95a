"""`splatcore bench ablation`: what each of the paper's ideas buys, with the others truly off."""

from dataclasses import asdict, replace
from pathlib import Path

from splatcore.sim.bench.campaign import Failure, results
from splatcore.sim.bench.confirm import confirmed
from splatcore.sim.bench.sweep import tasks
from splatcore.sim.common.paper import ABLATION
from splatcore.sim.common.scenes import View
from splatcore.spec.config import Config

RESULT = "ablation.json"

STEPS = {
    "none": {"culling": "none", "skip_zeros": False, "early_termination": False},
    "+ near-plane culling": {"culling": "near"},
    "+ guard band": {"culling": "all"},
    "+ zero skipping": {"skip_zeros": True},
    "+ early termination": {"early_termination": True},
}
"""Fields that each step changes in the one before; the names are those of the paper's ablation.

The paper does not say what culling leaves out beside the camera's sides; we tell the two apart.
"""


def machines(config: Config) -> dict[str, Config]:
    """The machines of all steps; the last one has all features on."""
    found, changes = {}, {}
    for name, change in STEPS.items():
        changes |= change
        found[name] = replace(config, name=f"{config.name}-{len(found)}", **changes)
    return found


def ablation(
    config: Config, views: list[View], folder: Path, scheduler: str | None, rtl: list[View]
) -> dict:
    """Measure every step on all views by twins and cycle model, and on some in RTL."""
    steps = machines(config)
    rows, failed = [], []
    for _, found in results(
        tasks("ablation", views, steps), folder / "parts", scheduler, "ablation"
    ):
        if isinstance(found, Failure):
            failed.append(asdict(found))
        else:
            rows += found["rows"]
    order = {name: number for number, name in enumerate(steps)}
    rows.sort(key=lambda row: (row["scene"], row["camera"], order[row["point"]]))
    for row in rows:
        row["step"] = row.pop("point")
        row |= {"rtl_cycles": None, "rtl_identical": None}
    measured = _rtl(steps, rtl, folder / "parts", failed)
    for row in rows:
        row |= measured.get((row["step"], row["scene"], row["camera"]), {})
    told = [
        {"name": name, "fields": change, "paper_fps": ABLATION.get(name)}
        for name, change in STEPS.items()
    ]  # fmt: skip
    size = views[0].size
    return {"preset": config.name, "size": size, "steps": told, "rows": rows, "failed": failed}


def _rtl(steps: dict[str, Config], views: list[View], folder: Path, failed: list) -> dict:
    """Cycles in RTL by step, scene and camera."""
    found = {}
    for name, config in steps.items():
        for view in views:
            row = confirmed(config, view, folder, name, failed)
            if row is not None:
                found[name, row["scene"], row["camera"]] = {
                    "rtl_cycles": row["cycles"], "rtl_identical": row["identical"],
                }  # fmt: skip
    return found
