"""Campaign tasks: cycles and errors of many machines on one view.

Pictures are the golden model's, compared with the float64 reference on the same packed model and
on the scene as trained. Cycles are the cycle model's. Machines that differ only in speed share a
picture.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import render
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.choose import packed_model
from splatcore.sim.frame.engines import truths
from splatcore.sim.frame.metric import against, differences
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.source import Source, View, open_source
from splatcore.spec.config import CLOCK_HZ, DEFAULT, Config
from splatcore.spec.packed import PackedModel
from splatcore.study.bench.campaign import Task

SPEED = (
    "name", "pe_arrays", "pes", "skip_zeros", "multiply_latency", "add_latency", "unary_latency",
    "projection_slots", "sub_sorter", "sub_sorters", "sub_sorter_entries",
    "merge_ways", "rasterizers", "port", "energy",
)  # fmt: skip
"""Fields of `Config` that change neither pixels nor counts of work."""


def picture_of(config: Config) -> Config:
    """The machine that represents all machines with the same pictures."""
    return replace(config, **{name: getattr(DEFAULT, name) for name in SPEED})


def tasks(name: str, views: list[View], machines: dict[str, Config]) -> list[Task]:
    """Tasks of a campaign, one per view and distinct picture. name: of the campaign."""
    pictures: dict[Config, dict[str, Config]] = {}
    for label, config in machines.items():
        pictures.setdefault(picture_of(config), {})[label] = config
    found = []
    for view in views:
        for some in pictures.values():
            about = f"{name} {view} {[(label, repr(config)) for label, config in some.items()]}"
            title = f"{view.name} {view.size} {next(iter(some))}".replace("/", "-")
            found.append(Task(title.replace(":", "-"), about, measure, (view, some)))
    return found


def measure(view: View, machines: dict[str, Config]) -> dict:
    """Measure machines with the same picture on a view: {"rows": [one row per machine]}."""
    first = next(iter(machines.values()))
    source = opened(view.scene, view.reading)
    camera = view.camera_of(source)
    model = packed_model(source, first, camera, view.quality)
    frame = render(first, model, camera)
    facts = against(differences(frame.pixels, exact(view, model))) | {
        "counts": frame.counts | {"front": len(frame.points.front)},
    }
    about, rows = {"scene": Path(view.scene).name, "camera": view.camera or camera.name}, []
    for label, config in machines.items():
        cycles = frame_cycles(config, frame)
        speed = {"cycles": cycles.by_name, "fps_at_800mhz": CLOCK_HZ / cycles.frame}
        rows.append({"point": label} | about | speed | facts)
    return {"rows": rows}


@lru_cache(maxsize=1)
def opened(scene: str, reading: Reading = AS_STATED) -> Source:
    """Open a scene; the process keeps the last one open."""
    return open_source(scene, reading)


@lru_cache(maxsize=8)
def exact(view: View, model: PackedModel) -> dict[str, np.ndarray]:
    """The reference's 8-bit pictures of a model and of its scene."""
    source = opened(view.scene, view.reading)
    return truths(source, model, view.camera_of(source))
