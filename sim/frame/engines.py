"""Engines that render a frame: the golden model, the float64 reference, the simulated machine."""

import numpy as np

from splatcore.golden import pipeline
from splatcore.golden.reference import Frame, render
from splatcore.sim.common.output import progress_bar
from splatcore.sim.frame.choose import packed_model
from splatcore.sim.frame.source import Source, check_fits
from splatcore.sim.machine.machine import Job, Run
from splatcore.sim.machine.path import build, simulate
from splatcore.sim.machine.script import IDEAL
from splatcore.spec.camera import Camera
from splatcore.spec.colour import background_codes
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.convention import SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians


def cycles(run: Run) -> dict[str, int | float | None]:
    """Cycles of the halves and of a frame, and frames per second.

    A run of several frames counts those that overlap with the next frame's first half; a single
    frame takes as long as its slower half, which had the memory for itself.
    """
    first, second = run.preprocessing_cycles, run.rendering_cycles
    single = max(first[0], second[0])
    frame = round(float(np.mean(run.frame_cycles))) if run.frame_cycles else single
    halves = {"preprocessing": first[0], "rendering": second[0]}
    return halves | {"frame": frame, "fps_at_800mhz": round(CLOCK_HZ / frame, 1)}


def golden(config: Config, job: Job) -> pipeline.Frame:
    """Render a frame by the golden model."""
    with progress_bar("rendering by the golden model"):
        return pipeline.render(config, *job)


def golden_of(
    source: Source, camera: Camera, config: Config, background, quality: str | None = None
) -> pipeline.Frame:
    """Render a view of a source by the golden model; a scene is packed first.

    quality: of packing
    Raises InputError if the image is too large.
    """
    check_fits(config, camera.width, camera.height)
    with progress_bar("packing"):
        model = packed_model(source, config, camera, quality)
    return golden(config, Job(model, camera, background_codes(config, background)))


def reference(
    gaussians: Gaussians, view: Camera, convention: Convention = SPLATCORE, label: str = "rendering"
) -> Frame:
    """Render a frame by the float64 reference, with a progress bar over its tiles."""
    with progress_bar(f"{label} by the reference") as advance:
        return render(gaussians, view, convention, advance)


def truths(
    source: Source, model: PackedModel, view: Camera, convention: Convention = SPLATCORE
) -> dict[str, np.ndarray]:
    """The reference's 8-bit pictures for comparison with a machine's.

    Returns them by name: "machine", of the packed model; "scene", of the scene, if the source is a
    scene. Pictures that packing has rendered are used again.
    """
    kept = [p for p in source.packed.values() if p.model is model and p.camera is view]
    if kept and convention == SPLATCORE:
        return {"machine": kept[0].drawn, "scene": kept[0].exact}
    shown = {"machine": (model.gaussians(), "rendering the model")}
    if source.scene is not None:
        shown["scene"] = source.gaussians, "rendering the scene"
    return {
        name: reference(g, view, convention, label).pixels for name, (g, label) in shown.items()
    }


def rtl_pixels(config: Config, model: PackedModel, view: Camera, background) -> np.ndarray:
    """Simulate a single frame; its pixels. Raises InputError if the run fails."""
    check_fits(config, view.width, view.height)
    job = Job(model, view, background_codes(config, background))
    run = simulate(build(config), [job], IDEAL, "simulating")
    if not run.done:
        raise InputError(f"rtl: {run.why}")
    return run.frames[0].pixels
