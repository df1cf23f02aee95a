"""Random frames on several machines in RTL, each compared with the golden model's.

A run depends on (seed, number) only: a machine, memory, one or two models, and consecutive frames,
two of them in flight.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import render
from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack, qualities_of
from splatcore.sim.machine.counted import counted
from splatcore.sim.machine.machine import Job, Run
from splatcore.sim.machine.script import Timing
from splatcore.sim.soak import draw
from splatcore.sim.soak.machines import MACHINES, graded, machine
from splatcore.spec.config import Config
from splatcore.spec.scene import Scene, joined

FRAMES = 8
"""Frames per run."""

MODELS_MAX = 2
GROUPED = 30  # drawn scenes in one, so that it has several groups of chunks, with levels
CYCLES_MAX = 100_000_000  # of a run, after which it counts as hung


@dataclass(frozen=True, eq=False)
class Drawn:
    """Inputs of a run.

    scenes, qualities: of its models
    used: number of each frame's model
    """

    machine: str
    scenes: list[Scene]
    qualities: list[str]
    used: list[int]
    jobs: list[Job]
    timing: Timing

    @property
    def config(self) -> Config:
        return MACHINES[self.machine]


def drawn(seed: int, number: int) -> Drawn:
    """Draw run `number`: machines take turns, everything else is random."""
    rng = np.random.default_rng([seed, number])
    name = list(MACHINES)[number % len(MACHINES)]
    config = MACHINES[name]
    count = 1 + int(rng.integers(MODELS_MAX))
    parts = GROUPED if graded(config) else 1
    scenes = [joined([draw.scene(rng) for _ in range(parts)]) for _ in range(count)]
    known = qualities_of(config)
    qualities = [str(rng.choice(known)) for _ in scenes]
    models = [
        pack(scene, config, quality=quality)[0]
        for scene, quality in zip(scenes, qualities, strict=True)
    ]
    if graded(config):
        models = [with_levels(m, config)[0] if rng.integers(4) else m for m in models]
    used = [int(k) for k in rng.integers(count, size=FRAMES)]
    codes = 1 << config.colour_fraction
    jobs = [
        Job(
            models[k], draw.camera(rng, config), tuple(map(int, rng.integers(codes, size=3))),
            config.rgba and bool(rng.integers(2)),
        )
        for k in used
    ]  # fmt: skip
    return Drawn(name, scenes, qualities, used, jobs, draw.timing(rng))


def frame_run(seed: int, number: int) -> dict:
    """Simulate run `number`; return its machine, frames, cycles and, in "wrong", a difference."""
    made = drawn(seed, number)
    try:
        run = machine(made.config).run(made.jobs, made.timing, cycles_max=CYCLES_MAX)
        wrong = differences(made, run)
        cycles = run.report.cycles
    except AssertionError as error:  # an assertion of the hardware
        wrong, cycles = str(error), 0
    counts = {"frames": len(made.jobs), "cycles": cycles}
    return {"machine": made.machine, "number": number, **counts, "wrong": wrong}


def differences(made: Drawn, run: Run) -> str:
    """The first difference from the golden model as text; empty if there is none."""
    if not run.done:
        return run.why
    if run.report.outside:
        return f"access outside the memory areas: {run.why}"
    for k, (job, rendered) in enumerate(zip(made.jobs, run.frames, strict=True)):
        golden = render(made.config, *job)
        if count := int((rendered.pixels != golden.pixels).any(axis=-1).sum()):
            return f"frame {k}: {count} of {job.camera.width * job.camera.height} pixels differ"
        counters = rendered.counters
        for name, right in counted(made.config, job.model, golden).items():
            if name in counters and counters[name] != right:
                return f"frame {k}: counter {name} is {counters[name]}, not {right}"
    return ""


def keep(folder: Path, seed: int, number: int):
    """Write the inputs of a run: a scene file per model, the cameras of all frames, run.txt."""
    made = drawn(seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    for k, scene in enumerate(made.scenes):
        write_ply(folder / f"scene{k}-{made.qualities[k]}.ply", scene)
    cameras = [job.camera for job in made.jobs]
    (folder / "cameras.json").write_text(cameras_json(cameras))
    lines = [f"machine {made.machine}", f"memory {made.timing}"]
    lines += [
        f"frame {k}: scene {scene}, background {job.background}, alpha {job.rgba}"
        for k, (scene, job) in enumerate(zip(made.used, made.jobs, strict=True))
    ]
    (folder / "run.txt").write_text("\n".join(lines) + "\n")
