"""Small results for tests of the report, made from the fields of results; numbers are made up."""

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_args, get_origin

import numpy as np

from splatcore.eda.paper import ABLATION, GATES_ALL, LOGIC, MEMORY_POWER, POWER
from splatcore.sim.frame.picture import write_png
from splatcore.spec.config import CLOCK_HZ
from splatcore.study.accuracy.budget import SUM, TITLES, WHOLES
from splatcore.study.results import campaigns, compression, frames, levels, machines, scale
from splatcore.study.results.fields import about, kind
from splatcore.study.results.known import RESULTS

SIZE = "64x48"

VIEWS = {
    ("vase.ply", "0"): 5_000_000, ("hall.spz", "door"): 2_500_000, ("hall.spz", "roof"): 1_000_000
}  # fmt: skip
"""Cycles per frame by scene and camera."""

VERSION = "1.2.3, commit abcdef0123"

VALUES = {str: "text", bool: True, int: 1000, float: 0.5, list: [], dict: {}}


def sample(schema: type, **own) -> dict:
    """An object with all fields of a result: the given values, examples, or any of their types."""
    assert own.keys() <= {each.name for each in fields(schema)}, own
    return {
        each.name: own[each.name] if each.name in own else of_type(kind(each), about(each))
        for each in fields(schema)
    }


def of_type(inside, found):
    """A value of a field."""
    if is_dataclass(inside):
        return sample(inside)
    if get_origin(inside) is list:
        return [of_type(kind(get_args(inside)[0]), found)]
    if found.keys:
        return dict.fromkeys(found.keys, *(found.examples or (1000,)))
    if get_origin(inside) is dict:
        names = found.examples or ("name",)
        return {name: of_type(kind(get_args(inside)[1]), found) for name in names}
    return found.examples[0] if found.examples else VALUES[inside]


def write(path: Path, value: dict):
    """Write a JSON file, and create its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def halves(frame: int) -> dict:
    """Cycles by stage and half."""
    stages = dict.fromkeys(frames.CYCLES, 1000)
    return stages | {"preprocessing": frame // 2, "rendering": frame, "frame": frame}


def rows(schema: type, **own) -> list[dict]:
    """A row for each view."""
    found = []
    for (scene, camera), frame in VIEWS.items():
        row = sample(schema, scene=scene, camera=camera, cycles=halves(frame), **own)
        found.append(row | {key: CLOCK_HZ / frame for key in row.keys() & {"fps_at_800mhz"}})
    return found


def scenes(folder: Path):
    """One file per view, and the table."""
    traffic = {"read_model": 1_000_000, "write_pixels": 3_000_000}
    for row in rows(frames.SceneRow, traffic_bytes=traffic, size=SIZE, quality=None):
        frame = row["cycles"]["frame"]
        row["model_cycles"] = halves(frame * 99 // 100)
        row["cycles"] = row["cycles"] | {"fps_at_800mhz": CLOCK_HZ / frame}
        name = f"{row['scene']}-{row['camera']}-{SIZE}-lpddr4.json"
        write(folder / "scenes" / name, row)
    (folder / "scenes/scenes.csv").write_text("scene\n")


def quality() -> dict:
    """Three packings of each view."""
    found = [
        row
        for number, asked in enumerate(frames.PACKINGS)
        for row in rows(
            frames.QualityRow, asked=asked, psnr_db_scene=28.0 + 10 * number,
            bytes_per_gaussian=21.75 + 16 * number,
        )
    ]  # fmt: skip
    found.sort(key=lambda row: list(VIEWS).index((row["scene"], row["camera"])))
    return sample(frames.Quality, rows=found) | {"version": VERSION}


def packed() -> dict:
    """Compression of two scenes; a point without a model."""
    curve = sample(compression.Curve)
    curve["points"].append({"target_ratio": 100.0, "note": "no such ratio"})
    steps = sample(compression.Steps)
    del steps["rows"][0]["bytes_each"]  # kept of `curve` alone
    found = {"vase.ply": {"steps": steps, "curve": curve}}
    found["jug.ply"] = {"power": sample(compression.Powers)}
    return sample(compression.Compression, scenes=found)


def budget() -> dict:
    """A view of degree 1, others of degree 3, one part without error."""
    found = []
    for number, (scene, camera) in enumerate(VIEWS):
        parts = {"packing": ["shape", *(f"degree {d + 1}" for d in range(3 if number else 1))]}
        parts |= {"machine": ["depth keys", "8 bits"], "scene": []}
        lines = [
            sample(
                frames.BudgetPart, part=part, of=of,
                psnr_db=None if part == "depth keys" else 60.0 + number,
                max_error=None if part == SUM else 2 / 255,
            )
            for of, own in parts.items() for part in [*own, SUM, TITLES[of]]
        ]  # fmt: skip
        whole = {f"psnr_db_{of}": 50.0 - number for of in WHOLES}
        found.append(sample(frames.BudgetRow, scene=scene, camera=camera, parts=lines, **whole))
    return sample(frames.Budget, rows=found)


def sweep() -> dict:
    """Four machines, one of which could not be synthesised."""
    points, found = {}, []
    for number, (name, knob) in enumerate(
        {"DEFAULT": "preset", "PAPER": "preset", "lanes 128": "lanes", "lanes 16": "lanes"}.items()
    ):
        points[name] = sample(
            campaigns.SweepPoint, knob=knob, value=name.split()[-1],
            nand2=None if name == "lanes 16" else 900e3 + 1e5 * number,
            frame_cycles_max=5_000_000 - 500_000 * number, fps_min=160.0 + number,
            psnr_db_machine_min=54.0 - number,
            psnr_db_machine_mean=57.25 - 20 * (name == "PAPER"),
            front=name in ("DEFAULT", "lanes 128"),
            rtl=sample(campaigns.Simulated, cycles=5_050_000) if name == "DEFAULT" else None,
        )  # fmt: skip
        found += rows(campaigns.SweepRow, point=name)
    return sample(campaigns.Sweep, points=points, rows=found)


def synth() -> dict:
    """Six parts of five stages."""
    parts = {
        name: sample(machines.Gates, stage=stage, count=count, nand2=nand2, speed_nand2=nand2)
        for name, stage, count, nand2 in (
            ("cull", "stage 0", 1, 15e3), ("project", "stage 1", 1, 70e3),
            ("sub_sorter", "stage 2", 2, 80e3), ("evaluate", "stage 3", 4, 64e3),
            ("blend", "stage 3", 4, 384e3), ("axi", "control", 1, 7e3),
        )
    }  # fmt: skip
    nand2 = sum(part["nand2"] for part in parts.values())
    top = sample(machines.Top, nand2=nand2, speed_nand2=nand2, paper_nand2=GATES_ALL, parts=parts)
    return sample(machines.Synth, top=top)


def memories() -> dict:
    """4 KB in one stage."""
    stages = {"sort": [sample(machines.Memory, words=1024, bits=16, count=2)]}
    return sample(machines.Memories, kilobytes=4.0, stages=stages)


def ablation() -> dict:
    """Steps that each take less; one was simulated in RTL."""
    none, near, *more = ABLATION
    steps, found = [none, near, "+ guard band", *more], []
    for scene, camera in VIEWS:
        frame = VIEWS[scene, camera]
        for number, step in enumerate(steps):
            cycles, rtl = frame * (5 - number), frame if number == 4 else None
            found.append(sample(
                campaigns.AblationRow, scene=scene, camera=camera, step=step, rtl_cycles=rtl,
                cycles=halves(cycles), fps_at_800mhz=CLOCK_HZ / cycles, rtl_identical=rtl and True,
            ))  # fmt: skip
    named = [sample(campaigns.AblationStep, name=s, paper_fps=ABLATION.get(s)) for s in steps]
    return sample(campaigns.Ablation, steps=named, rows=found)


def power() -> dict:
    """The paper's stages and memories."""
    logic = sample(machines.Logic, nand2=1e5, switching=1e-4, clock=1e-4, leakage=1e-3)
    paper = {"power_w": POWER, "logic_w": {name: watts for name, (_, watts) in LOGIC.items()}}
    return sample(
        machines.Power, fps=100.0, paper=paper | {"memory_w": dict(MEMORY_POWER.values())},
        stages=dict.fromkeys(LOGIC, logic),
        stage_memories=dict.fromkeys(MEMORY_POWER, sample(machines.Storage)),
    )  # fmt: skip


def hard(preset: str, engine: str) -> dict:
    case = sample(frames.HardCase, passed=preset != "PAPER")
    return sample(frames.Hard, preset=preset, engine=engine, cases={"needles": case})


def fitted(folder: Path):
    """A machine found by `fit`, which is not among the results."""
    view = halves(1_000_000) | {"fps": 800.0, "psnr_db_machine": None, "max_error_machine": 0.0}
    field = {"default": 4, "chosen": 1, "reason": "no smaller value exists"}
    write(folder / "fit/small.json", {
        "scene": "vase.ply", "fps": 60.0, "psnr_db_machine": 50.0, "fields": {"rasterizers": field},
        "views": {"vase.ply:0": view},
    })  # fmt: skip


def everything(folder: Path):
    """All results of a report."""
    scenes(folder)
    made = {
        "quality": quality(), "compression": packed(), "budget": budget(), "sweep": sweep(),
        "synth": synth(), "memories": memories(), "ablation": ablation(), "power": power(),
        "hard": hard("DEFAULT", "golden"), "hard-rtl": hard("TINY", "rtl"),
        "hard-paper": hard("PAPER", "golden"), "fpga-tiny": sample(machines.Fpga, preset="TINY"),
        "fpga": sample(machines.Fpga), "fpga-whole": sample(machines.WholeFpga, preset="FPGA"),
        "scale": sample(scale.Scale), "levels": sample(levels.Levels),
    }  # fmt: skip
    made["fpga-whole"]["seeds"] *= 2
    for name, found in made.items():
        write(folder / RESULTS[name].file, found)
    noise = np.random.default_rng(0).integers(0, 256, (600, 800, 3), np.uint8)
    for picture in ("hard/hard-cases.png", "scale/scale.png", "levels/levels.png"):
        write_png(folder / picture, noise)
    fitted(folder)
