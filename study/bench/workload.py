"""`splatcore bench work`: the machine's workload by scene and camera.

Culling rates, early termination, utilisation of the processing elements and splats per tile, to
compare with the figures and tables of the paper.
"""

from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import Frame, render
from splatcore.model.formats.camera_file import read_camera, read_cameras
from splatcore.sim.cycles.frame import Cycles, frame_cycles
from splatcore.sim.frame.choose import packed_model
from splatcore.sim.frame.size import shape_of
from splatcore.sim.frame.source import View
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.microprogram import operation_counts, program, projection
from splatcore.spec.schedule import pes, schedule
from splatcore.study.bench.campaign import Task, collected
from splatcore.study.bench.sweep import opened


def every_camera(views: list[View]) -> list[View]:
    """The views, and their scenes from all other cameras of their files."""
    found = {}
    for view in views:
        if not view.camera_text:
            found[view.scene, None] = view
            continue
        name = read_camera(view.camera_text, shape_of(view.size)).name
        found.setdefault((view.scene, name), view)
    for view in {(view.scene, view.size): replace(view, camera="") for view in views}.values():
        file, shape = view.camera_text, shape_of(view.size)
        for camera in read_cameras(file, size=shape) if file else ():
            found.setdefault((view.scene, camera.name), replace(view, camera=camera.name))
    return list(found.values())


def work(config: Config, views: list[View], folder: Path, scheduler: str | None) -> dict:
    """Measure all views by the golden model."""
    tasks = [
        Task(
            f"work {view.name} {view.size}".replace(":", "-"),
            f"work {config!r} {view}", view_work, (config, view),
        )
        for view in views
    ]  # fmt: skip
    results, failed = collected(tasks, folder, scheduler, "work")
    key = itemgetter("scene", "camera")
    density = {" ".join(key(found["row"])): found["density"] for found in results.values()}
    rows = sorted((found["row"] for found in results.values()), key=key)
    return {
        "preset": config.name, "size": views[0].size, "rows": rows, "density": density,
        "operations": operations(config), "failed": failed,
    }  # fmt: skip


def view_work(config: Config, view: View) -> dict:
    """A frame's counts and rates ("row"), and the splats per tile ("density")."""
    source = opened(view.scene, view.reading)
    camera = view.camera_of(source)
    model = packed_model(source, config, camera)
    frame = render(config, model, camera)
    depth = model.position @ camera.rotation[2] + camera.translation[2]
    behind, counts = int((depth <= camera.near).sum()), frame.counts
    cycles = frame_cycles(config, frame)
    projected = counts["projected"]
    row = {
        "scene": Path(view.scene).name, "camera": view.camera or camera.name,
        "gaussians": len(model), "behind": behind, "read": counts["points_read"],
        "projected": projected, "splats": counts["splats"], "entries": counts["group_entries"],
        "tile_pairs": counts["tile_pairs"], "pairs": counts["pairs"],
        "near_rate": _share(behind, len(model)),
        "culling_rate": _share(len(model) - projected, len(model)),
        "early_termination_rate": _share(
            counts["tile_pairs"] - counts["pairs"], counts["tile_pairs"]
        ),
        "pe_utilisation": utilisation(config, model.format.sh_degree, projected, cycles),
        "cycles": cycles.by_name, "counts": counts,
    }  # fmt: skip
    return {"row": row, "density": tile_density(config, frame).tolist()}


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0


def utilisation(config: Config, sh_degree: int, projected: int, cycles: Cycles) -> float:
    """Share of the frame's cycles in which a PE of stage 1 has an operation, mean of all PEs.

    For models with fewer harmonics than the machine's the program without harmonics is counted,
    as the other operations change nothing.
    """
    steps = projection(config)
    if sh_degree < config.sh_degree:
        steps = program(steps.name.replace("_sh", "_flat"))
    used = sum(step.unit == "pe" for step in steps.steps)
    return used * projected / (pes(config, projection(config)) * cycles.frame)


def tile_density(config: Config, frame: Frame) -> np.ndarray:
    """Number of splats per tile, [rows, columns]."""
    height, width = frame.pixels.shape[:2]
    rows, columns = -(-height // TILE), -(-width // TILE)
    across = -(-columns // config.group)
    found = np.zeros((-(-rows // config.group) * config.group, across * config.group), np.int64)
    group, mask = frame.binned.group, frame.binned.entries["mask"].astype(np.int64)
    for tile in range(config.group**2):
        reached = group[mask >> tile & 1 == 1]
        row = reached // across * config.group + tile // config.group
        column = reached % across * config.group + tile % config.group
        np.add.at(found, (row, column), 1)
    return found[:rows, :columns]


def operations(config: Config) -> dict[str, dict[str, float]]:
    """Operations of stage 1 with and without products with zeros, and cycles per Gaussian."""
    found = {}
    for name in ("project", "project_sh", "project_dense", "project_sh_dense"):
        steps, plan = program(name), schedule(config, program(name))
        counts = operation_counts(steps.steps)
        found[name] = counts | {
            "operations": sum(counts.values()), "cycles": plan.interval,
            "pes_busy": plan.utilisation(pes(config, steps)),
        }  # fmt: skip
    return found
