"""`splatcore bench sweep`: speed against error and gates over many machines and scenes."""

from pathlib import Path

import numpy as np

from splatcore.hdl.stages import WHOLE
from splatcore.sim.bench.campaign import Task, collected
from splatcore.sim.bench.confirm import confirmed
from splatcore.sim.bench.sweep import tasks
from splatcore.sim.bench.sweep_points import Point
from splatcore.sim.common.output import console
from splatcore.sim.common.scenes import View
from splatcore.sim.eda.machine_gates import netlist, sizes
from splatcore.sim.eda.synth import memories
from splatcore.sim.fit.gates import part_gates
from splatcore.spec.config import DEFAULT, KB, Config

RESULT = "sweep.json"

AXES = (("frame_cycles_max", 1), ("nand2", 1), ("psnr_db_mean", -1))
"""Figures by which machines are compared for the front: 1 where less is better, −1 where more."""


def sweep(points: list[Point], views: list[View], folder: Path, scheduler: str | None) -> dict:
    """Measure all points on all views, and their sizes; what is there already is kept."""
    machines = {point.name: point.config for point in points}
    whole = Task("size of all", repr(DEFAULT), whole_size, ())
    work = [*tasks("sweep", views, machines), *map(size_task, points), whole]
    results, failed = collected(work, folder, scheduler, "sweep")
    rows = [row for result in results.values() for row in result.get("rows", ())]
    order = {point.name: number for number, point in enumerate(points)}
    rows.sort(key=lambda row: (order[row["point"]], row["scene"], row["camera"]))
    between = rest(results)
    facts = {
        point.name: summary(point, rows, results.get(size_name(point), {}), between)
        for point in points
    }
    for name in front({name: found for name, found in facts.items() if complete(found)}):
        facts[name]["front"] = True
    return {"size": views[0].size, "points": facts, "rows": rows, "failed": failed}


def size_name(point: Point) -> str:
    """Name of the task for a machine's size."""
    return f"size {point.name}".replace("/", "-")


def size_task(point: Point) -> Task:
    """A machine's gates and memories."""
    return Task(size_name(point), repr(point.config), machine_size, (point.config,))


def whole_size() -> dict:
    """NAND2-equivalents of all of DEFAULT."""
    return {"nand2": sum(size.nand2 for size in sizes(netlist(DEFAULT), lambda *_: None))}


def rest(found: dict[str, dict]) -> float | None:
    """NAND2-equivalents between DEFAULT's parts; other machines are taken to have as many."""
    parts, whole = found.get("size DEFAULT"), found.get("size of all")
    return whole["nand2"] - parts["nand2"] if parts and whole else None


def machine_size(config: Config) -> dict:
    """NAND2-equivalents of a machine's parts, each synthesised on its own, and its memories."""
    parts = part_gates(config, lambda _: None)
    sizes = [size for made in WHOLE.values() for make in made for size in memories(make(config))]
    kilobytes = sum(words * bits for words, bits in sizes) / 8 / KB
    return {"nand2_by_part": parts, "nand2": sum(parts.values()), "memory_kb": kilobytes}


def summary(point: Point, rows: list[dict], size: dict, between: float | None) -> dict:
    """A point over all views; an exact picture counts for no PSNR. between: gates of the rest."""
    mine = [row for row in rows if row["point"] == point.name]
    facts = {"knob": point.knob, "value": point.value, "fields": point.fields}
    facts |= {name: size.get(name) for name in ("nand2_by_part", "memory_kb")}
    known = "nand2" in size and between is not None
    facts["nand2"] = size["nand2"] + between if known else None
    facts |= {"front": False, "rtl": None, "views": len(mine)}
    if not mine:
        return facts
    decibels = [row["psnr_db"] for row in mine if row["psnr_db"] is not None]
    return facts | {
        "frame_cycles_max": max(row["cycles"]["frame"] for row in mine),
        "fps_min": min(row["fps_at_800mhz"] for row in mine),
        "psnr_db_min": min(decibels, default=None),
        "psnr_db_mean": float(np.mean(decibels)) if decibels else None,
        "max_error_max": max(row["max_error"] for row in mine),
    }


def complete(facts: dict) -> bool:
    """True if all is known by which points are compared."""
    return all(facts.get(name) is not None for name, _ in AXES)


def front(points: dict[str, dict]) -> list[str]:
    """The points that no other one beats: as good in all of `AXES` and better in one."""
    names = list(points)
    places = np.array([[points[name][axis] * sign for axis, sign in AXES] for name in names])
    found = []
    for name, place in zip(names, places, strict=True):
        beats = (places <= place).all(axis=1) & (places < place).any(axis=1)
        if not beats.any():
            found.append(name)
    return found


def confirm(points: list[Point], facts: dict, view: View, folder: Path):
    """Simulate the front's machines on one view, and compare with cycle model and golden model."""
    for point in points:
        found = facts["points"][point.name]
        if not found["front"]:
            continue
        row = confirmed(point.config, view, folder / "parts", point.name, facts["failed"])
        if row is None:
            continue
        found["rtl"] = row
        same = "identical" if row["identical"] else "NOT identical"
        console.print(
            f"{point.name}: {row['cycles']:,} cycles in RTL, {row['model_cycles']:,} by the model, "
            f"{same}", soft_wrap=True,
        )  # fmt: skip
