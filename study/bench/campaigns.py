"""Campaigns over machines and scenes, with confirmation in RTL simulation.

`bench sweep`: speed against error and gates. `bench ablation`: the gain of each of the paper's
ideas.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from splatcore.eda.gates.machine_gates import netlist, sizes
from splatcore.eda.gates.synth import memories
from splatcore.eda.paper import ABLATION
from splatcore.hdl.raster.quads import SHARE
from splatcore.hdl.stages import WHOLE
from splatcore.sim.common.output import console
from splatcore.sim.frame.shot import View
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import DEFAULT, KB, Config
from splatcore.spec.error import InputError
from splatcore.study.bench.campaign import Task, collected
from splatcore.study.bench.scenes import Simulator
from splatcore.study.bench.sweep import Point, tasks
from splatcore.study.fit.gates import part_gates
from splatcore.study.results.campaigns import Simulated, SweepPoint
from splatcore.study.results.fields import facts

AXES = (
    ("frame_cycles_max", 1), ("frame_cycles_mean", 1), ("nand2", 1), ("psnr_db_machine_mean", -1),
)  # fmt: skip
"""Metrics of the Pareto front: 1 if less is better, −1 if more is better."""


def sweep(points: list[Point], views: list[View], folder: Path, scheduler: str | None) -> dict:
    """Measure all points on all views, and their sizes; reuse existing results."""
    machines = {point.name: point.config for point in points}
    whole = Task("size of all", repr(DEFAULT), whole_size, ())
    work = [*tasks("sweep", views, machines), whole]
    work += [Task(size_name(p), repr(p.config), machine_size, (p.config,)) for p in points]
    results, failed = collected(work, folder, scheduler, "sweep")
    rows = [row for result in results.values() for row in result.get("rows", ())]
    order = {point.name: number for number, point in enumerate(points)}
    rows.sort(key=lambda row: (order[row["point"]], row["scene"], row["camera"]))
    between = rest(results)
    found = {
        point.name: summary(point, rows, results.get(size_name(point), {}), between)
        for point in points
    }
    axes = [axis for axis, _ in AXES]
    complete = {k: f for k, f in found.items() if None not in map(f.get, axes)}
    for name in front(complete):
        found[name]["front"] = True
    return {"size": views[0].size, "points": found, "rows": rows, "failed": failed}


def size_name(point: Point) -> str:
    """Name of the task that measures a machine's size."""
    return f"size {point.name}".replace("/", "-")


def whole_size() -> dict:
    """NAND2-equivalents of all of DEFAULT."""
    return {"nand2": sum(size.nand2 for size in sizes(netlist(DEFAULT), lambda *_: None))}


def rest(found: dict[str, dict]) -> float | None:
    """NAND2-equivalents of DEFAULT outside its parts; other machines are assumed to have as many.

    None if a result is missing.
    """
    parts, whole = found.get("size DEFAULT"), found.get("size of all")
    return whole["nand2"] - parts["nand2"] if parts and whole else None


def machine_size(config: Config) -> dict:
    """NAND2-equivalents of a machine's parts, each synthesised alone, and KB of its memories."""
    parts = part_gates(config, lambda _: None)
    sizes = [size for made in WHOLE.values() for make in made for size in memories(make(config))]
    kilobytes = sum(words * bits for words, bits in sizes) / 8 / KB
    return {"nand2_by_part": parts, "nand2": sum(parts.values()), "memory_kb": kilobytes}


def summary(point: Point, rows: list[dict], size: dict, between: float | None) -> dict:
    """Summary of a point over all views; exact pictures have no PSNR and do not count in it.

    size: of `machine_size`, or empty
    between: NAND2-equivalents of `rest`
    """
    mine = [row for row in rows if row["point"] == point.name]
    known = "nand2" in size and between is not None
    about = {
        "knob": point.knob, "value": point.value, "fields": point.fields, "rtl": None,
        "front": False, "views": len(mine), "nand2": size["nand2"] + between if known else None,
        **{name: size.get(name) for name in ("nand2_by_part", "memory_kb")},
    }  # fmt: skip
    if not mine:
        return facts(SweepPoint(**about))
    cycles = [row["cycles"]["frame"] for row in mine]
    decibels = [row["psnr_db_machine"] for row in mine if row["psnr_db_machine"] is not None]
    return facts(SweepPoint(
        frame_cycles_max=max(cycles), frame_cycles_mean=float(np.exp(np.mean(np.log(cycles)))),
        fps_min=min(row["fps_at_800mhz"] for row in mine),
        psnr_db_machine_min=min(decibels, default=None),
        psnr_db_machine_mean=float(np.mean(decibels)) if decibels else None,
        max_error_machine_max=max(row["max_error_machine"] for row in mine), **about,
    ))  # fmt: skip


def front(points: dict[str, dict], axes: tuple[tuple[str, int], ...] = AXES) -> list[str]:
    """The Pareto front: points that no other point equals in all axes and beats in one."""
    places = np.array([[point[axis] * sign for axis, sign in axes] for point in points.values()])
    beaten = (((places <= one).all(1) & (places < one).any(1)).any() for one in places)
    return [name for name, worse in zip(points, beaten, strict=True) if not worse]


def confirm(points: list[Point], facts: dict, view: View, folder: Path):
    """Simulate the front's machines in RTL on one view; compare with cycle and golden model."""
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


STEPS = {
    "none": {
        "culling": "none", "skip_zeros": False, "early_termination": False, "faint": (), "pes": 6,
        "port": 128,
    },
    "+ near-plane culling": {"culling": "near"},
    "+ guard band": {"culling": "all"},
    "+ zero skipping": {"skip_zeros": True},
    "+ early termination": {"early_termination": True},
    "+ nothing too faint": {"faint": DEFAULT.faint},
    "+ nine PEs": {"pes": 9},
    "+ port of 256 bits": {"port": DEFAULT.port},
    "+ fourteen PEs": {"pes": DEFAULT.pes},
}  # fmt: skip
"""Fields that each step changes in the step before. Names as in the paper's ablation, followed by
steps of Splatcore's own.

The paper does not say whether culling includes Gaussians outside the image; near-plane culling
and guard band are separate steps here.
"""


def ablation_steps(config: Config) -> dict[str, dict]:
    """`STEPS`; of a machine in quads, with as many lanes by block until the last step."""
    if config.lanes == "block":
        return STEPS
    block = {"lanes": "block", "rasterizers": config.rasterizers // SHARE}
    quads = {name: getattr(config, name) for name in block}
    return STEPS | {"none": STEPS["none"] | block, "+ lanes in quads": quads}


def ablation_machines(config: Config) -> dict[str, Config]:
    """The machines of all steps; the last has all features on."""
    found, changes = {}, {}
    for name, change in ablation_steps(config).items():
        changes |= change
        found[name] = replace(config, name=f"{config.name}-{len(found)}", **changes)
    return found


def ablation(
    config: Config, views: list[View], folder: Path, scheduler: str | None, rtl: list[View]
) -> dict:
    """Measure every step on all views by golden and cycle model.

    rtl: views that are also simulated in RTL
    """
    steps = ablation_machines(config)
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
    described = [
        {"name": name, "fields": change, "paper_fps": ABLATION.get(name)}
        for name, change in ablation_steps(config).items()
    ]  # fmt: skip
    about = {"preset": config.name, "size": views[0].size, "quality": views[0].quality}
    return about | {"steps": described, "rows": rows, "failed": failed}


def confirmed(
    config: Config, view: View, folder: Path, name: str, failed: list[dict[str, str]]
) -> dict | None:
    """Simulate a view in RTL: cycles, cycles by the cycle model, equality with the golden model.

    The result is kept in the folder until the machine's Verilog changes. A view that fails in
    simulation (returns None) or has a wrong picture is added to `failed`.
    """
    title = f"rtl {name} {view.name}"
    path = folder / f"{title} {view.size}.json".replace(":", "-").replace("/", "-")
    try:
        row = Simulator(config).row(view, LPDDR4, path)
        if "cycles" not in row:
            raise InputError(f"{config.name}: {row['ended']}")
    except InputError as error:
        failed.append({"what": title, "why": str(error)})
        return None
    if not row["identical"]:
        failed.append({"what": title, "why": "the picture is not the golden model's"})
    return facts(Simulated(
        scene=row["scene"], camera=row["camera"], size=row["size"], identical=row["identical"],
        cycles=row["cycles"]["frame"], model_cycles=row["model_cycles"]["frame"],
    ))  # fmt: skip
