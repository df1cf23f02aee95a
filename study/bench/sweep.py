"""Campaign tasks: cycles and errors of many machines on one view.

Pictures are the golden model's, compared with the float64 reference on the same packed model and
on the scene as trained. Cycles are the cycle model's. Machines that differ only in speed share a
picture.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from splatcore.golden.pipeline import render
from splatcore.model.pack.pack import packing_key
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.metric import against
from splatcore.sim.frame.shot import Shot, View, judge
from splatcore.sim.frame.source import opened
from splatcore.spec.config import CLOCK_HZ, DEFAULT, Config
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
    shot = packed_by(view, PACKERS.setdefault(packing_key(first), first))
    frame = render(first, shot.model, shot.camera)
    facts = against(judge(frame, shot)) | {
        "counts": frame.counts | {"front": len(frame.points.front)},
    }
    about, rows = {"scene": Path(view.scene).name, "camera": view.camera or shot.camera.name}, []
    for label, config in machines.items():
        cycles = frame_cycles(config, frame)
        speed = {"cycles": cycles.by_name, "fps_at_800mhz": CLOCK_HZ / cycles.frame}
        rows.append({"point": label} | about | speed | facts)
    return {"rows": rows}


PACKERS: dict[tuple, Config] = {}
"""A machine that stands for all that pack alike, by `packing_key`."""


@lru_cache(maxsize=8)
def packed_by(view: View, machine: Config) -> Shot:
    """A view's frame, whose packed model and pictures of the reference the process keeps."""
    return view.open(machine, opened(view.scene, view.reading))
