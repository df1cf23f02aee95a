"""`splatcore bench scenes`: cycles and error of many scenes on the machine in RTL simulation.

Three frames are rendered per view, so that both halves are busy. Each result is a file, which is
reused until the machine's Verilog, the packing code, the view or the memory changes.
"""

import time
from collections.abc import Iterator
from dataclasses import asdict
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path

import numpy as np

from splatcore.golden import pipeline
from splatcore.model.formats.camera_file import read_camera
from splatcore.sim.common.cache import with_key
from splatcore.sim.common.output import console, write, write_json
from splatcore.sim.common.sources import code_key
from splatcore.sim.common.table import Column, Table, comma_separated
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.choose import packed
from splatcore.sim.frame.engines import cycles, golden
from splatcore.sim.frame.metric import against, decibels, differences
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.shot import Shot, View
from splatcore.sim.frame.size import shape_of
from splatcore.sim.frame.source import scene_files
from splatcore.sim.machine.diagnosis import diagnose
from splatcore.sim.machine.machine import Machine, Run, machine_source
from splatcore.sim.machine.path import build, simulate
from splatcore.sim.machine.script import Timing
from splatcore.spec.cache import digest
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import CYCLES, SceneRow
from splatcore.study.results.frames import TRAFFIC as TRAFFIC_CAUSES

FRAMES = 3
"""Frames per view: a frame's tiles are rendered while points of the next frame are processed."""

MORE_CAMERAS = {"kitchen.spz": ("kitchen_inside_0", "kitchen_inside_150")}
"""Cameras that are measured in addition to a scene's first."""

MEGABYTE = 1e6

SHOWN = (
    "cycles.preprocessing cycles.rendering cycles.frame cycles.fps_at_800mhz identical "
    "psnr_db_scene psnr_db_machine ssim_machine max_error_machine"
)
"""Keys of columns."""


def views(
    scenes: list[str], cameras: str | None, size: str, quality: str | None = None,
    reading: Reading = AS_STATED,
) -> list[View]:  # fmt: skip
    """The views of scenes, or of all scenes in the shared folder if none is named."""
    found = []
    for scene in scenes or map(str, scene_files()):
        named = cameras.split(",") if cameras else ["", *MORE_CAMERAS.get(Path(scene).name, ())]
        ids = (camera.strip() for camera in named)
        found += [View(scene, i, size, None, quality, reading) for i in ids]
    for view in found:
        if view.camera_text:
            read_camera(view.camera_text, shape_of(view.size))
    return found


def bench_scenes(config: Config, found: list[View], timings: list[Timing], folder: Path) -> bool:
    """Measure the missing views and write tables; return whether all equal the golden model."""
    simulator, rows = Simulator(config), []
    for view, timing in product(found, timings):
        path = folder / f"{view.name.replace(':', '-')}-{view.size}-{timing.name}.json"
        rows.append(simulator.row(view, timing, path))
        console.print(line(rows[-1]), soft_wrap=True)
    write(folder / "scenes.md", markdown(rows).encode())
    write(folder / "scenes.csv", comma_separated([dict(cells(row)) for row in rows]).encode())
    return all(row["identical"] for row in rows)


class Simulator:
    """A machine in RTL simulation, built when the first view has to be simulated."""

    def __init__(self, config: Config):
        self.config, self.source = config, machine_source(config)

    @cached_property
    def machine(self) -> Machine:
        return build(self.config, source=self.source)

    def row(self, view: View, timing: Timing, path: Path) -> dict:
        """A view's result: read from the file if it was a success, else simulated and written."""
        packs = code_key(packed)
        about = [self.source, packs, repr(self.config), view.name, view.size, timing, FRAMES]
        key = digest(about)
        row = with_key(path, key)
        if row is None or not row["identical"]:
            row = {"key": key} | measure(self.machine, view, timing)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, row)
        return row


@lru_cache(maxsize=1)
def expect(config: Config, view: View) -> tuple[Shot, pipeline.Frame]:
    """Open a view and pack its scene; render it by the golden model."""
    shot = view.open(config)
    return shot, golden(shot)


def measure(machine: Machine, view: View, timing: Timing) -> dict:
    """Simulate a view and return its result."""
    config = machine.config
    shot, frame = expect(config, view)
    begin = time.perf_counter()
    run = simulate(machine, [shot.job] * FRAMES, timing, f"{view.name}, {timing.name}")
    row = {
        "scene": Path(view.scene).name, "camera": view.camera or shot.camera.name,
        "quality": view.quality, "bytes_per_gaussian": shot.model.bytes_per_gaussian,
        "size": view.size, "preset": config.name, "timing": asdict(timing),
        "seconds": round(time.perf_counter() - begin, 1), "simulated_cycles": run.report.cycles,
        "identical": False, "ended": run.why,
    }  # fmt: skip
    if not run.done:
        return row
    return row | judge(config, run, frame, shot.truths)


def judge(config: Config, run: Run, golden: pipeline.Frame, truths: dict[str, np.ndarray]) -> dict:
    """Cycles, error and traffic of a finished run.

    golden: the golden model's frame
    truths: pictures of the reference by name, as in `Shot.truths`
    """
    wrong = [diagnose(config, run, k, golden) for k in range(len(run.frames))]
    frame = run.frame_cycles[-1]
    taken = {"frame": frame, "fps_at_800mhz": round(CLOCK_HZ / frame, 1)}
    return {
        "identical": not any(wrong),
        "difference": str(next((text for text in wrong if text), "")),
        **against(differences(run.frames[-1].pixels, truths)),
        "cycles": cycles(run) | taken | {"rendering_alone": run.rendering_cycles[-1]},
        "model_cycles": frame_cycles(config, golden).by_name,
        "traffic_bytes": run.frames[-1].traffic, "counters": run.frames[-1].counters,
        "counts": golden.counts,
    }  # fmt: skip


def line(row: dict) -> str:
    """A result as a line of text."""
    text = f"{row['scene']} {row['camera']}, {row['timing']['name']}: "
    if "cycles" not in row:
        return text + row["ended"]
    found = row["cycles"]
    same = "identical" if row["identical"] else f"NOT identical: {row['difference']}"
    return text + (
        f"{found['frame']:,} cycles, {found['fps_at_800mhz']:.1f} FPS, {same}, "
        f"dB: machine {decibels(row, 'machine')}, scene {decibels(row, 'scene')}, "
        f"{row['seconds']:.0f} s"
    )


def cells(row: dict) -> Iterator[tuple[str, object]]:
    """A result as (column, value) pairs."""
    yield from ((name, row[name]) for name in ("scene", "camera", "size"))
    yield "timing", row["timing"]["name"]
    yield "identical", "yes" if row["identical"] else "no"
    if "cycles" not in row:
        return
    metrics = ("psnr_db_", "ssim_", "max_error_")
    yield from ((name, value) for name, value in row.items() if name.startswith(metrics))
    yield from row["cycles"].items()
    yield from ((f"model_{name}", value) for name, value in row["model_cycles"].items())
    yield from ((f"mb_{cause}", n / MEGABYTE) for cause, n in row["traffic_bytes"].items())


def title(row: dict) -> str:
    """A result's view, memory and packing."""
    packing = f", {row['quality']}" if row["quality"] else ""
    return f"{row['scene']} {row['camera']}, {row['timing']['name']}{packing}"


TRAFFIC = Column(
    "traffic", "MB", 1, get=lambda row: sum(row["traffic_bytes"].values()) / MEGABYTE
)  # fmt: skip


def tables(rows: list[dict]) -> Iterator[Table]:
    """Yield tables: cycles and error, the cycle model's stages, traffic by cause."""

    def columns_of(keys: str) -> list[Column]:
        return [Column("view", get=title), *columns(SceneRow, keys)]

    yield Table.of(
        "frames",
        "Frames in RTL; the picture against the float64 reference on the scene as trained (scene) "
        "and on the same packed model (machine):",
        [*columns_of(SHOWN), TRAFFIC], rows,
    )  # fmt: skip
    for key, caption, keys in (
        ("model_cycles", "Cycles by the cycle model:", CYCLES),
        ("traffic_bytes", "DRAM traffic per frame, by cause:", TRAFFIC_CAUSES),
    ):
        yield Table.of(key, caption, columns_of(" ".join(f"{key}.{name}" for name in keys)), rows)


def markdown(rows: list[dict]) -> str:
    """The tables of finished views, and lines of the others."""
    parts = [table.markdown() for table in tables([row for row in rows if "cycles" in row])]
    if failed := [f"- {line(row)}" for row in rows if "cycles" not in row]:
        parts += ["Failed:", "\n".join(failed)]
    return "\n\n".join(parts) + "\n"
