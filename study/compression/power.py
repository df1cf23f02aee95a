"""ESTIMATE of power after each step of compression (see `eda.power`).

Each step's scene is packed for the machine and rendered in RTL simulation, which counts switching
and checks the picture against the golden model.
"""

from collections.abc import Iterator

from splatcore.eda.cells.liberty import Library
from splatcore.eda.paper import FPS
from splatcore.eda.power.activity import counts_of
from splatcore.eda.power.cells import machine_gates
from splatcore.eda.power.clocks import clocked
from splatcore.eda.power.estimate import Estimate, estimate
from splatcore.model.compress.checkpoint import Step
from splatcore.model.formats.photographs import Target
from splatcore.model.pack.pack import pack
from splatcore.model.pack.quality import COMPACT, STEPPED
from splatcore.sim.common.output import progress_bar
from splatcore.sim.machine.machine import Job
from splatcore.spec.config import Config
from splatcore.spec.memory import COMPACT_DEGREE
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from splatcore.study.compression.run import Run


def powers(run: Run, view: Target, cells: tuple[Library, float] | None) -> dict:
    """Measure all steps of a run: the view, the library, and `rows_of`.

    cells: a library and its process in nm, if power is to be estimated in cells
    """
    camera = view.camera
    named = {"library": cells[0].name, "process_nm": cells[1]} if cells else {}
    rows = list(rows_of(run, view, cells))
    return {"view": view.name, "size": [camera.width, camera.height], **named, "rows": rows}


def rows_of(run: Run, view: Target, cells: tuple[Library, float] | None) -> Iterator[dict]:
    """Yield a row per step of a finished run: model, cycles and bytes per frame of `view`, W.

    Power is at the paper's frames per second, or at the machine's maximum if that is lower.
    Raises InputError if the machine's picture is not the golden model's.
    """
    config = run.config
    with progress_bar("synthesising the machine") as advance:
        plain = machine_gates(config, None, None, advance)
        mapped = cells and machine_gates(config, *cells, advance)
    for step in run.checkpoints.steps:
        model = as_read(run.checkpoints.load(step), config)
        label = f"{run.subject.name}: power of {step.name}"
        counts = counts_of(config, Job(model, view.camera), None, label)
        clocks = clocked(config, counts.registers)
        found = estimate(counts, plain, clocks, config.energy)
        fps = min(FPS, found.fps_max)
        row = about(step, model) | {"cycles": found.cycles, "fps_at_800mhz": found.fps_max}
        row |= {"fps": fps, "traffic_bytes": sum(counts.traffic.values())} | watts(found, fps)
        if mapped:
            row["cells_w"] = estimate(counts, mapped, clocks, config.energy).power(fps)
        yield row


def as_read(left: Scene | PackedModel, config: Config) -> PackedModel:
    """A step's result as a packed model, with all remaining harmonics that the machine renders."""
    if isinstance(left, PackedModel):
        return left
    degree = min(left.sh_degree, config.sh_degree)
    return pack(left, config, quality=STEPPED[0] if degree > COMPACT_DEGREE else COMPACT)[0]


def about(step: Step, model: PackedModel) -> dict:
    """The step, and the size of its model in memory."""
    facts = {"step": step.name, "kind": step.kind, "gaussians": len(model)}
    return facts | {"sh_degree": model.format.sh_degree, "bytes": len(model.image)}


def watts(found: Estimate, fps: float) -> dict:
    """W of the chip, of its leakage and of DRAM; J per frame of the chip."""
    power = found.power(fps)
    return {
        "power_w": power, "leakage_w": found.leakage, "dram_w": sum(found.dram.values()) * fps,
        "frame_j": power / fps,
    }  # fmt: skip
