"""A path of cameras, and simulation of its frames with a progress bar."""

import time

import numpy as np

from splatcore.model.cameras.orbit import moved
from splatcore.sim.common.output import progress_bar
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.script import Timing
from splatcore.sim.rtl.build import COMPILING
from splatcore.sim.rtl.convert import ELABORATED
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.progress import shown_by
from splatcore.spec.work import pixel_bytes

STEP = np.radians(0.25)
"""Angle per frame of a path: half a turn takes 12 seconds at 60 frames per second."""


def orbit(camera: Camera, points: np.ndarray, frames: int) -> list[Camera]:
    """Cameras on a circle around a camera's `target`.

    points: [N, 3] of the scene, world space
    frames: number of cameras, the given one included
    """
    from scipy.spatial.transform import Rotation  # takes half a second

    axis, centre = camera.rotation[1], target(camera, points)
    turns = (Rotation.from_rotvec(k * STEP * axis).as_matrix() for k in range(1, frames))
    return [camera, *(moved(camera, centre, turn, 1.0) for turn in turns)]


def target(camera: Camera, points: np.ndarray) -> np.ndarray:
    """The point [3] in front of a camera at the median depth of the points [N, 3] that it sees; at
    depth 1 if it sees none."""
    x, y, z = (points @ camera.rotation.T + camera.translation).T
    across, down = camera.tan_half_fov
    seen = (z > camera.near) & (np.abs(x) < across * z) & (np.abs(y) < down * z)
    return camera.position + camera.rotation[2] * (np.median(z[seen]) if seen.any() else 1.0)


WHOLE = {ELABORATED: 17.0, COMPILING: 2.25}
"""Time from nothing to a program, in times until a phase begins."""

SPEED = 3e6
"""Cycles simulated in the time from nothing to a program: each follows the computer's speed and the
machine's size."""


def build(
    config: Config,
    trace: str = "",
    source: str | None = None,
    cycles: int | None = None,
    saves: bool = False,
) -> Machine:
    """Compile the machine, or find it in the cache.

    source: its Verilog, if already known
    cycles: that will be simulated; the progress bar then has an estimate of all the time it takes
    saves: whether runs can be saved
    """
    label, begin = f"building the machine {config.name}", time.perf_counter()
    with progress_bar(f"{label} (takes minutes the first time)") as advance:

        def estimate(done: float, total: float | None, phase: str):
            if phase in WHOLE and cycles is not None:
                whole = WHOLE[phase] * (time.perf_counter() - begin)
                advance(0, None, f"building {config.name}: about {whole:.0f} s, then {cycles:,} "
                        f"cycles in {cycles * whole / SPEED:.0f} s")  # fmt: skip

        with shown_by(estimate):
            return Machine(config, source, trace, saves=saves)


def simulate(machine: Machine, jobs: list[Job], timing: Timing, label: str, **options) -> Run:
    """Run frames with a progress bar that shows the tiles written and the cycles per second."""
    begin, tile = [], TILE**2 * pixel_bytes(jobs[0].rgba)
    with progress_bar(label) as advance:

        def progress(cycles: int, written: int, total: int):
            now = time.perf_counter(), cycles
            seconds, done = np.subtract(now, begin[0] if begin else now)
            begin[:] = begin or [now]
            rate = done / max(seconds, 1e-9)
            text = f"{label}: {rate / 1000:.0f}k cycles/s, tiles"
            advance(written // tile, -(-total // tile), text)

        return machine.run(jobs, timing, progress, **options)
