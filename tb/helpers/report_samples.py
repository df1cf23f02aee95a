"""Small results for tests of the report, in the formats of its commands; numbers are made up."""

import json
from pathlib import Path

import numpy as np

from splatcore.eda.paper import ABLATION, GATES_ALL, LOGIC, MEMORY_POWER, POWER
from splatcore.sim.frame.picture import write_png
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.stages import NAMES
from splatcore.study.accuracy.budget import SUM, TITLES, WHOLES

SIZE = "64x48"

VIEWS = {
    ("vase.ply", "0"): 5_000_000, ("hall.spz", "door"): 2_500_000, ("hall.spz", "roof"): 1_000_000
}  # fmt: skip
"""Cycles per frame by scene and camera."""

VERSION = "1.2.3, commit abcdef0123"

COUNTS = {
    "points_read": 900, "projected": 700, "splats": 600, "group_entries": 1000,
    "tile_pairs": 2_000_000, "pairs": 1_500_000, "visited": 8_000_000, "contributions": 90_000_000,
}  # fmt: skip


def write(path: Path, value: dict):
    """Write a JSON file, and create its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def halves(frame: int) -> dict:
    """Cycles by stage and half."""
    stages = dict.fromkeys(NAMES, 1000)
    return stages | {"preprocessing": frame // 2, "rendering": frame, "frame": frame}


def of_view(scene: str, camera: str, frame: int) -> dict:
    """Keys of rows of all campaigns."""
    return {
        "scene": scene, "camera": camera, "cycles": halves(frame),
        "fps_at_800mhz": CLOCK_HZ / frame, "psnr_db_machine": 55.5, "psnr_db_scene": 44.5,
        "ssim_machine": 0.999, "max_error_machine": 2 / 255, "counts": COUNTS,
    }  # fmt: skip


def scenes(folder: Path):
    """`bench scenes`: one file per view, and the table."""
    for (scene, camera), frame in VIEWS.items():
        row = of_view(scene, camera, frame)
        row["cycles"]["fps_at_800mhz"] = row.pop("fps_at_800mhz")
        write(folder / "scenes" / f"{scene}-{camera}-{SIZE}-lpddr4.json", row | {
            "key": "k", "size": SIZE, "preset": "DEFAULT", "timing": {"name": "lpddr4"},
            "identical": True, "difference": "", "ended": "done",
            "model_cycles": halves(frame * 99 // 100),
            "traffic_bytes": {"read_model": 1_000_000, "write_pixels": 3_000_000},
        })  # fmt: skip
    (folder / "scenes/scenes.csv").write_text("scene\n")


def packings(folder: Path):
    """`bench quality` and `bench compression`: three packings of each view, a scene's steps."""
    rows = []
    for (scene, camera), frame in VIEWS.items():
        for number, asked in enumerate(("compact", "balanced", "faithful")):
            row = of_view(scene, camera, frame) | {
                "asked": asked, "gaussians": 1000, "sh_degree": number + 1, "bytes": 50_000,
                "bytes_per_gaussian": 21.75 + 16 * number, "model_bytes": 40_000,
            }  # fmt: skip
            row |= {f"{key}_packing": 0.5 for key in ("psnr_db", "ssim", "max_error")}
            rows.append(row | {"psnr_db_scene": 28.0 + 10 * number, "ssim_scene": 0.9,
                               "max_error_scene": 0.25})  # fmt: skip
    facts = {"preset": "DEFAULT", "size": SIZE, "failed": [], "version": VERSION}
    write(folder / "quality/quality.json", facts | {"rows": rows})
    model = {"gaussians": 500, "sh_degree": 1, "bytes": 20_000, "ratio": 12.5, "psnr_db": 30.0,
             "psnr_db_min": 28.0, "ssim": 0.95, "max_error": 0.3}  # fmt: skip
    work = {"tile_pairs": 10, "pairs": 5, "fps_at_800mhz": 100.0}
    step = model | {"step": "packed", "kind": "pack", "seconds": 1.5, "work": work}
    point = {"target_ratio": 100.0, "note": "no such ratio"}
    power = {"step": "packed", "kind": "pack", "gaussians": 500, "sh_degree": 1, "bytes": 20_000,
             "cycles": 9000, "fps_at_800mhz": 88_888.8, "fps": 129, "traffic_bytes": 30_000,
             "power_w": 0.25, "leakage_w": 0.025, "frame_j": 0.002, "dram_w": 0.5}  # fmt: skip
    curve = [model | {"target_ratio": None, "psnr_db_beside_mean": 29.0}, point]
    write(folder / "compression/compression.json", facts | {
        "degree": None, "quality": None, "beside": 1.0, "scenes": {
            "vase.ply": {"steps": {"rows": [step]}, "curve": {"points": curve}},
            "jug.ply": {"power": {"rows": [power]}},
        },
    })  # fmt: skip


def budget(folder: Path):
    """`error --stage all`: a view of degree 1, others of degree 3, one part without error."""
    rows = []
    for number, (scene, camera) in enumerate(VIEWS):
        parts = {"packing": ["shape", *(f"degree {d + 1}" for d in range(3 if number else 1))]}
        parts |= {"machine": ["depth keys", "8 bits"], "scene": []}
        found = [
            {"part": part, "of": of, "psnr_db": None if part == "depth keys" else 60.0 + number,
             "max_error": None if part == SUM else 2 / 255, "share": 0.25}
            for of, own in parts.items() for part in [*own, SUM, TITLES[of]]
        ]  # fmt: skip
        whole = {f"psnr_db_{of}": 50.0 - number for of in WHOLES}
        rows.append({
            "scene": scene, "camera": camera, "size": [64, 48], "quality": "faithful",
            "bytes_per_gaussian": 53.75, "parts": found, **whole,
        })  # fmt: skip
    write(folder / "budget.json", {"preset": "DEFAULT", "size": SIZE, "rows": rows})


def sweep(folder: Path):
    """`bench sweep`: four machines, one of which could not be synthesised."""
    points, rows = {}, []
    for number, (name, knob, value) in enumerate((
        ("DEFAULT", "preset", "DEFAULT"), ("PAPER", "preset", "PAPER"),
        ("lanes 128", "lanes", "128"), ("lanes 16", "lanes", "16"),
    )):  # fmt: skip
        points[name] = {
            "knob": knob, "value": value, "fields": {}, "nand2_by_part": None, "memory_kb": 119.5,
            "nand2": None if name == "lanes 16" else 900e3 + 1e5 * number, "views": 2,
            "frame_cycles_max": 5_000_000 - 500_000 * number, "frame_cycles_mean": 4e6,
            "fps_min": 160.0 + number,
            "psnr_db_machine_min": 54.0 - number,
            "psnr_db_machine_mean": 57.25 - 20 * (name == "PAPER"), "max_error_machine_max": 0.5,
            "front": name in ("DEFAULT", "lanes 128"), "rtl": None,
        }  # fmt: skip
        rows += [{"point": name, **of_view(*view, frame)} for view, frame in VIEWS.items()]
    points["DEFAULT"]["rtl"] = {
        "scene": "vase.ply", "camera": "0", "size": SIZE, "cycles": 5_050_000,
        "model_cycles": 5_000_000, "identical": True,
    }  # fmt: skip
    facts = {"size": SIZE, "points": points, "rows": rows, "failed": []}
    write(folder / "sweep/sweep.json", facts)


def machine(folder: Path):
    """`synth`, `memories`."""
    parts = {
        name: {"stage": stage, "count": count, "nand2": nand2, "depth": 50,
               "speed_nand2": nand2, "speed_depth": 30, "flip_flops": 1, "memories": []}
        for name, stage, count, nand2 in (
            ("cull", "stage 0", 1, 15e3), ("project", "stage 1", 1, 70e3),
            ("sub_sorter", "stage 2", 2, 80e3), ("evaluate", "stage 3", 4, 64e3),
            ("blend", "stage 3", 4, 384e3), ("axi", "control", 1, 7e3),
        )
    }  # fmt: skip
    nand2 = sum(part["nand2"] for part in parts.values())
    top = {"nand2": nand2, "speed_nand2": nand2, "paper_nand2": GATES_ALL, "parts": parts}
    write(folder / "synth.json", {"preset": "DEFAULT", "top": top})
    stages = {"sort": [{"words": 1024, "bits": 16, "count": 2}]}
    facts = {"preset": "DEFAULT", "kilobytes": 4.0, "stages": stages}
    write(folder / "memories.json", facts)


def campaigns(folder: Path):
    """`bench ablation`."""
    none, near, *more = ABLATION
    steps, rows = [none, near, "+ guard band", *more], []
    for (scene, camera), frame in VIEWS.items():
        for number, step in enumerate(steps):
            row = {"step": step, **of_view(scene, camera, frame * (5 - number))}
            rtl = frame if number == 4 else None
            rows.append(row | {"rtl_cycles": rtl, "rtl_identical": rtl and True})
    table = [{"name": step, "fields": {}, "paper_fps": ABLATION.get(step)} for step in steps]
    facts = {"preset": "DEFAULT", "size": SIZE, "failed": []}
    write(folder / "ablation/ablation.json", facts | {"steps": table, "rows": rows})


def others(folder: Path):
    """`power`, `hard`, `fpga`, `fit`."""
    logic = {"nand2": 1e5, "flip_flops": 1e3, "activity": 0.05, "switching": 1e-4, "clock": 1e-4,
             "leakage": 1e-3}  # fmt: skip
    memory = {"kilobits": 10, "reads": 1, "writes": 1, "access": 1e-5, "leakage": 1e-4}
    write(folder / "power.json", {
        "preset": "DEFAULT", "scene": "vase.ply", "camera": "0", "size": [64, 48], "fps": 100.0,
        "power_w": 0.125, "dram_w": 0.05, "pixels_per_j": 1e9,
        "stages": dict.fromkeys(LOGIC, logic),
        "stage_memories": dict.fromkeys(MEMORY_POWER, memory),
        "paper": {
            "power_w": POWER,
            "logic_w": {name: watts for name, (_, watts) in LOGIC.items()},
            "memory_w": dict(MEMORY_POWER.values()),
        },
    })  # fmt: skip
    for name, preset, engine in (
        ("hard", "DEFAULT", "golden"), ("hard-rtl", "TINY", "rtl"),
        ("hard-paper", "PAPER", "golden"),
    ):  # fmt: skip
        case = {"about": "thin & <long>", "bound": "≥ 52 dB", "psnr_db_machine": 56.78,
                "max_error_machine": 2 / 255, "passed": preset != "PAPER"}  # fmt: skip
        facts = {"preset": preset, "engine": engine, "cases": {"needles": case}}
        write(folder / name / "hard.json", facts)
    noise = np.random.default_rng(0).integers(0, 256, (600, 800, 3), np.uint8)
    write_png(folder / "hard" / "hard-cases.png", noise)
    for name, preset in (("fpga-tiny", "TINY"), ("fpga", "DEFAULT")):
        part = {
            "luts": 1234, "flip_flops": 55, "multipliers": 2, "block_rams": 0, "fmax_mhz": 98.7,
            "begin": "a", "end": "b", "logic": 1.0, "routing": 2.0,
        }  # fmt: skip
        facts = {
            "preset": preset,
            "device": "85k",
            "speed": "6",
            "parts": {"array": part},
            "failed": {},
        }
        write(folder / f"{name}.json", facts)
    whole = {"parts": {"whole": part}, "seeds": [part | {"fmax_mhz": 43.2}, part]}
    write(folder / "fpga-whole.json", facts | {"preset": "FPGA", "speed": "8"} | whole)
    view = halves(1_000_000) | {"fps": 800.0, "psnr_db_machine": None, "max_error_machine": 0.0}
    field = {"default": 4, "chosen": 1, "reason": "no smaller value exists"}
    write(folder / "fit/small.json", {
        "scene": "vase.ply", "fps": 60.0, "psnr_db_machine": 50.0, "fields": {"rasterizers": field},
        "views": {"vase.ply:0": view},
    })  # fmt: skip


def everything(folder: Path):
    """All results of a report."""
    for make in (scenes, packings, budget, sweep, machine, campaigns, others):
        make(folder)
