"""Engines that render a frame: the float64 reference, the golden model, the simulated machine."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden import reference as exact
from splatcore.sim.frame.shot import Shot
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.error import InputError

if TYPE_CHECKING:  # it imports Amaranth
    from splatcore.sim.machine.machine import Rendered, Run


class Frame(Protocol):
    """A rendered frame: its 8-bit picture [H, W, 3], or [H, W, 4] with premultiplied colour."""

    pixels: np.ndarray


def reference(shot: Shot) -> exact.Frame:
    """Render the source as it is, a scene or a model, by the float64 reference."""
    shot.source.check_need("reference", shot.source.drawn)
    with shot.bar("rendering by the reference") as advance:
        return exact.render(shot.source.drawn, shot.camera, shot.convention, advance, shot.rgba)


def golden(shot: Shot) -> pipeline.Frame:
    """Render the packed model by the golden model; InputError for a picture that is too large."""
    shot.check_fits()
    shot.source.check_need("golden", shot.model)
    frame, label = shot.frame, "rendering by the golden model"
    with shot.bar(label) as advance:

        def progress(step: str):
            count = len(pipeline.STEPS)
            advance(pipeline.STEPS.index(step), count, f"{label}: {step}")

        return pipeline.render(shot.config, *frame, progress=progress)


def rtl(shot: Shot) -> "Rendered":
    """Simulate the packed model's frame with an ideal memory; InputError if the run fails."""
    from splatcore.sim.machine.path import build, simulate
    from splatcore.sim.machine.script import IDEAL

    shot.check_fits()
    run = simulate(build(shot.config), [shot.job], IDEAL, "simulating")
    if not run.done:
        raise InputError(f"rtl: {run.why}")
    return run.frames[0]


ENGINES: dict[str, Callable[[Shot], Frame]] = {
    "reference": reference, "golden": golden, "rtl": rtl
}  # fmt: skip


def cycles(run: "Run") -> dict[str, int | float | None]:
    """Cycles of the halves and of a frame, and frames per second.

    A run of several frames counts those that overlap with the next frame's first half; a single
    frame takes as long as its slower half, which had the memory for itself.
    """
    first, second = run.preprocessing_cycles, run.rendering_cycles
    single = max(first[0], second[0])
    frame = round(float(np.mean(run.frame_cycles))) if run.frame_cycles else single
    halves = {"preprocessing": first[0], "rendering": second[0]}
    return halves | {"frame": frame, "fps_at_800mhz": round(CLOCK_HZ / frame, 1)}
