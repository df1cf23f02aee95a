"""The command `bench differentiable`: seconds of the CPU's differentiable renderer."""

from statistics import median
from time import perf_counter

import numpy as np

from splatcore.app.cli.bench import bench
from splatcore.app.cli.options import SCENE, JsonOption, option
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.sim.common.output import console, write_json
from splatcore.sim.frame.size import parse_size
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import Gaussians
from splatcore.study.compression.run import check_installed

COUNT, SIZE = 100_000, "960x540"  # Gaussians and pixels for which `BOUND` holds

BOUND = 1.5
"""Upper bound in seconds of forward and backward together, with COUNT Gaussians at SIZE on two
cores."""


GaussiansOption = option(int, "N", "Number of Gaussians in the generated garden.")
SizeOption = option(str, "WxH", "Pixels of the picture.", "--size", panel=SCENE)
RepeatOption = option(int, "N", "Number of runs; the medians are printed.")


@bench.command("differentiable")
def differentiable_command(
    gaussians: GaussiansOption = COUNT,
    size: SizeOption = SIZE,
    repeat: RepeatOption = 5,
    json: JsonOption = None,
):
    """Time the differentiable renderer on the CPU.

    Renders the generated garden in float32, forward and backward. A first run, which compiles, is
    not measured.
    """
    width, height = parse_size(size)
    if repeat < 1:
        raise InputError(f"--repeat {repeat}: must be at least 1")
    try:
        scene = generate("garden", gaussians)
    except InputError as error:
        raise InputError(f"--gaussians: {error}") from None
    check_installed()
    facts = measure(scene.gaussians(), generated_camera("garden", width, height), repeat)
    together = facts["forward_seconds"] + facts["backward_seconds"]
    console.print(
        f"{gaussians:,} Gaussians at {width}×{height}: {facts['visible']:,} visible, "
        f"{facts['pairs']:,} pairs with a tile; threads: {facts['threads']}\n"
        f"forward  {facts['forward_seconds']:.3f} s\n"
        f"backward {facts['backward_seconds']:.3f} s\n"
        f"together {together:.3f} s (bound: {BOUND} s for {COUNT:,} at {SIZE} on two cores)",
        soft_wrap=True,
    )
    write_json(json, {"gaussians": gaussians, "size": [width, height], **facts})


def measure(gaussians: Gaussians, camera: Camera, repeat: int) -> dict:
    """Return median seconds of forward and backward in float32, and counts of the picture."""
    import torch
    from numba import get_num_threads

    from splatcore.model.gradients.differentiable import render

    arrays = gaussians.position, gaussians.factor, gaussians.opacity, gaussians.sh
    leaves = [torch.tensor(a, dtype=torch.float32, requires_grad=True) for a in arrays]
    seconds = []
    for _ in range(1 + repeat):
        for leaf in leaves:
            leaf.grad = None
        start = perf_counter()
        found = render(*leaves, camera)
        middle = perf_counter()
        found.image.abs().mean().backward()
        seconds.append((middle - start, perf_counter() - middle))
    forward, backward = (median(part) for part in zip(*seconds[1:], strict=True))
    return {
        "repeat": repeat, "forward_seconds": forward, "backward_seconds": backward,
        "threads": get_num_threads(), "visible": len(found.visible),
        "pairs": pairs(gaussians, camera),
    }  # fmt: skip


def pairs(gaussians: Gaussians, camera: Camera) -> int:
    """Count the pairs of a visible splat and a tile that it reaches, as the renderer does."""
    from numba import get_num_threads

    from splatcore.model.gradients import rendering_points, rendering_tiles

    arrays = gaussians.position, gaussians.factor, gaussians.opacity, gaussians.sh
    arrays = [np.ascontiguousarray(array, np.float32) for array in arrays]
    arrays.append(np.zeros((len(gaussians), 2), np.float32))
    splats = np.empty((len(gaussians), rendering_points.HIGH + 1), np.float32)
    depth = np.empty(len(gaussians))
    view = rendering_points.view_numbers(camera)
    rendering_points.project(*arrays, view, get_num_threads(), splats, depth)
    lists = rendering_tiles.tile_lists(splats[depth > 0], camera.width, camera.height)
    return len(lists[2])
