"""A path of cameras, and simulation of its frames with a progress bar."""

import time

import numpy as np

from splatcore.model.cameras.orbit import moved
from splatcore.sim.common.output import progress_bar
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.script import Timing
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
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


def build(config: Config, trace: str = "", source: str | None = None) -> Machine:
    """Compile the machine, or find it in the cache. source: its Verilog, if already known."""
    with progress_bar(f"building the machine {config.name} (takes minutes the first time)"):
        return Machine(config, source, trace)


def simulate(machine: Machine, jobs: list[Job], timing: Timing, label: str, **options) -> Run:
    """Run frames with a progress bar that shows the tiles written and the cycles per second."""
    begin, tile = time.perf_counter(), TILE**2 * pixel_bytes(jobs[0].rgba)
    with progress_bar(label) as advance:

        def progress(cycles: int, written: int, total: int):
            rate = cycles / (time.perf_counter() - begin)
            text = f"{label}: {rate / 1000:.0f}k cycles/s, tiles"
            advance(written // tile, -(-total // tile), text)

        return machine.run(jobs, timing, progress, **options)
