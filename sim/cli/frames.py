"""Frames by the golden model and by the reference, with a progress bar."""

from splatcore.golden import pipeline
from splatcore.golden.reference import Frame, render
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.source import Source, packed_model
from splatcore.sim.machine.engines import background_codes
from splatcore.sim.machine.path import check_fits
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import Convention
from splatcore.spec.scene import Gaussians


def render_golden(
    source: Source, camera: Camera, config: Config, background: tuple[float, float, float]
) -> pipeline.Frame:
    """The golden model's frame; a scene is packed first. InputError for too large an image."""
    check_fits(config, camera)
    with progress_bar("packing"):
        model = packed_model(source, config)
    with progress_bar("rendering"):
        return pipeline.render(config, model, camera, background_codes(config, background))


def render_frame(gaussians: Gaussians, camera: Camera, convention: Convention, label: str) -> Frame:
    """The reference renderer's frame, with a progress bar over its tiles."""
    with progress_bar(label) as advance:
        return render(gaussians, camera, convention, advance)
