"""Commands that make and judge pictures: render, compare."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from splatcore.golden import pipeline
from splatcore.golden.reference import Frame, render
from splatcore.sim.cli.options import (
    CameraOption,
    JsonOption,
    PresetOption,
    SizeOption,
    SourceArgument,
    app,
)
from splatcore.sim.cli.render_rtl import (
    ErrorMapOption,
    FramesOption,
    Request,
    TileOption,
    TimingOption,
    WavesOption,
    WindowOption,
    render_rtl,
)
from splatcore.sim.common import describe
from splatcore.sim.common.metric import difference
from splatcore.sim.common.output import check_writable, console, progress_bar
from splatcore.sim.common.picture import read_png, write_error_map, write_heat_map, write_png
from splatcore.sim.common.result import Result, write_json
from splatcore.sim.common.source import (
    ENGINES,
    Source,
    check_engine,
    open_camera,
    open_source,
    packed_model,
)
from splatcore.sim.machine.engines import background_codes, rtl_pixels
from splatcore.sim.machine.path import check_fits
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import ORIGINAL, SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from splatcore.spec.scene import Gaussians


@app.command("render")
def render_command(
    scene: SourceArgument,
    output: Annotated[Path, typer.Option("-o", metavar="OUT.png", help="Where to write it.")],
    camera: CameraOption = None,
    size: SizeOption = None,
    engine: Annotated[str, typer.Option(help=f"{', '.join(ENGINES)}.")] = "reference",
    preset: PresetOption = "DEFAULT",
    original: Annotated[
        bool, typer.Option("--original", help="3σ tile bounds, as the original renderer has them.")
    ] = False,
    background: Annotated[
        str, typer.Option(metavar="R,G,B", help="Background colour, each 0 … 1.")
    ] = "0,0,0",
    heat_map: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the lengths of the tiles' lists.")
    ] = None,
    frames: FramesOption = 1,
    timing: TimingOption = "lpddr4",
    error_map: ErrorMapOption = None,
    waves: WavesOption = None,
    window: WindowOption = None,
    tile: TileOption = None,
    json: JsonOption = None,
):
    """Render one frame and count the work in it.

    --engine rtl simulates the hardware, compares with the golden model and with the reference on
    the packed model, and tells cycles; exit status 1 if a pixel is not the golden model's.
    """
    check_engine(engine)
    request = Request(frames, timing, error_map, waves, window, tile)
    request.check(engine, output)
    check_writable(output, heat_map, json)
    config = find_preset(preset)
    convention = replace(ORIGINAL if original else SPLATCORE, background=parse_colour(background))
    begin = time.perf_counter()
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        view = open_camera(camera, size, source)
    if engine != "reference" and (original or heat_map):
        raise InputError(f"--engine {engine}: no --original, no --heat-map")
    if engine == "rtl":
        colour = convention.background
        return render_rtl(source, view, camera, config, colour, request, output, json)
    if engine == "golden":
        frame = render_golden(source, view, config, convention.background)
    else:
        frame = render_frame(source.gaussians, view, convention, "rendering")
    result = Result(
        engine, config.name, source.name, camera or view.name, (view.width, view.height),
        round(time.perf_counter() - begin, 3), frame.counts,
    )  # fmt: skip
    write_png(output, frame.pixels)
    if heat_map and isinstance(frame, Frame):
        write_heat_map(heat_map, frame.tile_list, f"{source.name}, camera {view.name}")
    console.print(describe.table({"image": str(output), "seconds": result.seconds} | frame.counts))
    write_json(json, result)


@app.command("compare")
def compare_command(
    images: Annotated[
        list[str],
        typer.Argument(metavar="A.png|ENGINE B.png|ENGINE …", help="The first is compared with."),
    ],
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE|MODEL", help="What the engines render.")
    ] = None,
    camera: CameraOption = None,
    size: SizeOption = None,
    preset: PresetOption = "DEFAULT",
    output: Annotated[
        Path | None,
        typer.Option("-o", metavar="MAP.png", help="Draw an error map of the second image."),
    ] = None,
    json: JsonOption = None,
):
    """PSNR, SSIM and maximum error of images against the first one, and an error map.

    Instead of a PNG file an engine may be named; it renders --scene from --camera. Beside golden
    or rtl the reference renders the same packed model.
    """
    if len(images) < 2:
        raise InputError("compare: needs two images or more")
    check_writable(output, json)
    config = find_preset(preset)
    packed = bool({"golden", "rtl"} & set(images))
    pictures = [picture(text, scene, camera, size, config, packed) for text in images]
    results = []
    table = Table("image", "PSNR dB", "SSIM", "max error", title=f"against {images[0]}")
    for text, pixels in zip(images[1:], pictures[1:], strict=True):
        metrics = difference(pixels, pictures[0], text)
        table.add_row(
            text,
            "identical" if metrics.identical else f"{metrics.psnr_db:.2f}",
            "–" if metrics.ssim is None else f"{metrics.ssim:.5f}",
            f"{metrics.max_error:.4f} ({round(metrics.max_error * 255)} of 255)",
        )
        shape = (pixels.shape[1], pixels.shape[0])
        result = Result(text, config.name, scene, camera, shape).with_difference(metrics)
        results.append(result)
    console.print(table)
    if output:
        psnr = "identical" if results[0].identical else f"{results[0].psnr_db:.2f} dB"
        title = f"{images[1]} against {images[0]}: {psnr}"
        write_error_map(output, pictures[1], pictures[0], title)
    write_json(json, results[0] if len(results) == 1 else {"images": [vars(r) for r in results]})


def picture(
    text: str, scene: str | None, camera: str | None, size: str | None, config: Config, packed: bool
) -> np.ndarray:
    """The pixels of a PNG file, or what an engine renders; the reference of the packed model?"""
    if text not in ENGINES:
        return read_png(text)
    check_engine(text)
    if scene is None:
        raise InputError(f"compare {text}: --scene says nothing about what to render")
    source: Source = open_source(scene)
    view = open_camera(camera, size, source)
    if text == "golden":
        return render_golden(source, view, config, SPLATCORE.background).pixels
    if text == "rtl":
        return rtl_pixels(config, packed_model(source, config), view, SPLATCORE.background)
    gaussians = packed_model(source, config).gaussians() if packed else source.gaussians
    return render_frame(gaussians, view, SPLATCORE, text).pixels


def render_golden(
    source: Source, camera: Camera, config: Config, background: tuple[float, float, float]
) -> pipeline.Frame:
    """The twin's frame; a scene is packed first. InputError for an image that is too large."""
    check_fits(config, camera)
    with progress_bar("packing"):
        model = packed_model(source, config)
    with progress_bar("rendering"):
        return pipeline.render(config, model, camera, background_codes(config, background))


def render_frame(gaussians: Gaussians, camera: Camera, convention: Convention, label: str) -> Frame:
    """The reference renderer's frame, with a progress bar over its tiles."""
    with progress_bar(label) as advance:
        return render(gaussians, camera, convention, advance)


def parse_colour(text: str) -> tuple[float, float, float]:
    """Three numbers 0 … 1 between commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--background '{text}': is not three numbers R,G,B") from None
    if not all(0 <= value <= 1 for value in (red, green, blue)):
        raise InputError(f"--background '{text}': is not within 0 … 1")
    return red, green, blue
