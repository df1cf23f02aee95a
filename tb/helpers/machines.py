"""Compiled machines and frames for the tests of the whole; compiled once for all of them."""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.golden.pipeline import Frame, render
from splatcore.model.generate import hard_case
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job, Machine, Run
from splatcore.spec.axi import LINE, port_beats, port_bytes
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.memory import CHUNK
from splatcore.spec.packed import PackedModel
from splatcore.spec.work import FEATURE, SLOT
from tb.helpers.point_rows import point_counts

NEEDLES = 100
LENGTHS = 30, 30 * hard_case.WIDTH
THIN = 1e-5


@cache
def machine(config: Config) -> Machine:
    """A compiled machine."""
    return Machine(config)


@cache
def garden(config: Config, gaussians: int) -> PackedModel:
    """A small garden, packed."""
    return pack(generate("garden", gaussians), config)[0]


def view(width: int = 64, height: int = 48, step: float = 0.0) -> Camera:
    """The garden's camera, moved sideways."""
    camera = generated_camera("garden", width, height)
    return replace(camera, translation=camera.translation - [step, 0, 0])


def long_needles() -> hard_case.HardCase:
    """Needles in all directions, up to thousands of pixels long, 1e5 times as long as thick; of
    their covariances' determinants all digits cancel."""
    pixels = np.geomspace(*LENGTHS, NEEDLES)[:, None]
    scale = pixels * hard_case.DEPTH / hard_case.FOCAL * [1, THIN, THIN]
    scene = replace(hard_case.spread(np.random.default_rng(0), NEEDLES), scale=scale)
    camera = hard_case.straight_camera()
    return hard_case.HardCase(scene, camera, "lengths up to 30 times the screen's width")


def counted(config: Config, model: PackedModel, frame: Frame) -> dict[str, int]:
    """Values of the counters that do not depend on time, from the golden model's frame."""
    points, binned = frame.points, frame.binned
    return {f"points_{name}": count for name, count in point_counts(points).items()} | {
        "bin_splats": len(points.index),
        "bin_kept": len(binned.kept),
        "bin_entries": len(binned.entries["key"]),
        "bin_bursts": len(binned.lists.address),
        "preprocessing_write_features": -(-len(binned.kept) * FEATURE // LINE)
        * LINE
        // port_bytes(config),
        "preprocessing_write_lists": (
            -(-config.burst * SLOT // port_bytes(config)) * len(binned.lists.address)
        ),
        "sort_entries": len(binned.entries["key"]),
    }


def attribute_beats(config: Config, model: PackedModel, frame: Frame) -> tuple[int, int]:
    """The port's beats in which attributes are read: at least, at most. A port with larger beats
    reads one of two neighbours once if the second asks for it in time."""
    inside, each = frame.points.inside, model.chunk_beats.astype(int)
    chunk, beats = inside // CHUNK, port_beats(config)
    first = (np.cumsum(each) - each)[chunk] * CHUNK + inside % CHUNK * each[chunk]
    last = first + each[chunk] - 1
    most = (last // beats - first // beats + 1).sum()
    return most - (first[1:] // beats == last[:-1] // beats).sum(), most


def check(config: Config, run: Run, *jobs: Job):
    """All frames of a run are the golden model's, and so are their counters."""
    assert run.done, run.why
    assert not run.report.outside, run.why
    for rendered, job in zip(run.frames, jobs, strict=True):
        frame, told = render(config, *job), rendered.counters
        assert np.array_equal(rendered.pixels, frame.pixels)
        wanted = {name: n for name, n in counted(config, job.model, frame).items() if name in told}
        assert {name: told[name] for name in wanted} == wanted
        least, most = attribute_beats(config, job.model, frame)
        assert least <= told.get("preprocessing_read_attributes", most) <= most
