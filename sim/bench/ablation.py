"""`splatcore bench ablation`: the gain of each of the paper's ideas, with the others truly off."""

from dataclasses import replace
from itertools import product
from pathlib import Path

from splatcore.sim.bench.campaign import collected
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
    """Measure every step on all views by golden and cycle model, and on some in RTL."""
    steps = machines(config)
    work = tasks("ablation", views, steps)
    results, failed = collected(work, folder, scheduler, "ablation")
    rows = [row for result in results.values() for row in result["rows"]]
    order = {name: number for number, name in enumerate(steps)}
    rows.sort(key=lambda row: (row["scene"], row["camera"], order[row["point"]]))
    simulated = {}
    for (name, machine), view in product(steps.items(), rtl):
        row = confirmed(machine, view, folder / "parts", name, failed)
        if row is not None:
            simulated[name, row["scene"], row["camera"]] = row["cycles"], row["identical"]
    for row in rows:
        row["step"] = row.pop("point")
        measured = simulated.get((row["step"], row["scene"], row["camera"]), (None, None))
        row["rtl_cycles"], row["rtl_identical"] = measured
    told = [
        {"name": name, "fields": change, "paper_fps": ABLATION.get(name)}
        for name, change in STEPS.items()
    ]  # fmt: skip
    size = views[0].size
    return {"preset": config.name, "size": size, "steps": told, "rows": rows, "failed": failed}
