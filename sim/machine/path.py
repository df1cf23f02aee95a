"""A path of cameras, and machines that render it behind a progress bar."""

import time

import numpy as np

from splatcore.model.cameras.orbit import moved
from splatcore.sim.common.output import progress_bar
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.sim.machine.script import Timing
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.work import PIXEL

STEP = np.radians(0.25)
"""Angle from a frame of a path to the next: half a turn takes 12 seconds at 60 frames a second."""


def orbit(camera: Camera, points: np.ndarray, frames: int) -> list[Camera]:
    """Cameras on a circle around what a camera looks at: its `target` among points [N, 3]."""
    from scipy.spatial.transform import Rotation  # takes half a second

    axis, centre = camera.rotation[1], target(camera, points)
    turns = (Rotation.from_rotvec(k * STEP * axis).as_matrix() for k in range(1, frames))
    return [camera, *(moved(camera, centre, turn, 1.0) for turn in turns)]


def target(camera: Camera, points: np.ndarray) -> np.ndarray:
    """The place [3] in front of a camera that is as deep as the points [N, 3] that it sees, on the
    average (median), 1 if there are none."""
    x, y, z = (points @ camera.rotation.T + camera.translation).T
    across, down = camera.tan_half_fov
    seen = (z > camera.near) & (np.abs(x) < across * z) & (np.abs(y) < down * z)
    return camera.position + camera.rotation[2] * (np.median(z[seen]) if seen.any() else 1.0)


def build(config: Config, trace: str = "", source: str | None = None) -> Machine:
    """The machine, compiled unless it is there. source: its Verilog, if that is known."""
    with progress_bar(f"building the machine {config.name}, which takes minutes when it is new"):
        return Machine(config, source, trace)


def simulate(machine: Machine, jobs: list[Job], timing: Timing, label: str, **options) -> Run:
    """Run frames behind a bar that tells how many tiles are written, and how fast it goes."""
    begin, tile = time.perf_counter(), TILE**2 * PIXEL
    with progress_bar(label) as advance:

        def tell(cycles: int, written: int, total: int):
            rate = cycles / (time.perf_counter() - begin)
            text = f"{label}: {rate / 1000:.0f}k cycles/s, tiles"
            advance(written // tile, -(-total // tile), text)

        return machine.run(jobs, timing, tell, **options)
