"""The command `render`: one frame by one of the engines."""

import time
from dataclasses import replace
from pathlib import Path

from splatcore.sim.cli import options
from splatcore.sim.cli import render_rtl as rtl
from splatcore.sim.cli.options import option
from splatcore.sim.common import describe
from splatcore.sim.common.metric import Result, against, differences, told
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.picture import write_heat_map, write_png
from splatcore.sim.common.source import (
    ENGINES,
    Source,
    check_known,
    note_unseen,
    open_camera,
    open_source,
)
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import ORIGINAL, SPLATCORE, Convention
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

OutputOption = option(Path, "OUT.png", "Where to write it.", "-o")
OriginalOption = option(
    bool, None, "3σ tile bounds, as the original renderer has them.", "--original"
)
BackgroundOption = option(str, "R,G,B", "Background colour, each 0 … 1.")
CompareOption = option(
    bool, None, "golden: compare with the reference, which takes longer than the picture.",
    "--compare/--no-compare",
)  # fmt: skip
HeatMapOption = option(Path | None, "FILE.png", "Draw the lengths of the tiles' lists.")


@options.app.command("render")
def render_command(
    scene: options.SourceArgument,
    output: OutputOption,
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    engine: options.EngineOption = "reference",
    preset: options.PresetOption = "DEFAULT",
    original: OriginalOption = False,
    background: BackgroundOption = "0,0,0",
    heat_map: HeatMapOption = None,
    compare: CompareOption = True,
    frames: rtl.FramesOption = 1,
    timing: rtl.TimingOption = "lpddr4",
    error_map: rtl.ErrorMapOption = None,
    waves: rtl.WavesOption = None,
    window: rtl.WindowOption = None,
    tile: rtl.TileOption = None,
    json: options.JsonOption = None,
):
    """Render one frame and count the work in it.

    A machine's picture (golden, rtl) is compared with the reference's of the same packed model
    ("machine") and of the scene as it is ("scene"). --engine rtl simulates the hardware, compares
    with the golden model, too, and tells cycles; exit status 1 if a pixel is not that model's.
    """
    check_engine(engine, bool(original or heat_map), compare)
    request = rtl.Request(frames, timing, error_map, waves, window, tile)
    request.check(engine, output)
    config = find_preset(preset)
    convention = replace(ORIGINAL if original else SPLATCORE, background=parse_colour(background))
    begin = time.perf_counter()
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        view = open_camera(camera, size, source)
    from splatcore.sim.machine.engines import truths
    from splatcore.sim.packing.choose import packed_model, packing, packing_line

    if engine == "rtl":
        colour = convention.background
        return rtl.render_rtl(source, view, camera, config, colour, request, output, json)
    frame = drawn(engine, source, view, config, convention)
    seconds, found = round(time.perf_counter() - begin, 3), {}
    write_png(output, frame.pixels)
    if engine == "golden" and compare:
        model = packed_model(source, config, view)
        found = differences(frame.pixels, truths(source, model, view, convention))
    result = Result(
        engine, config.name, source.name, camera or view.name, (view.width, view.height), seconds,
        frame.counts, packing=packing(source), **against(found),
    )  # fmt: skip
    if result.packing:
        console.print(packing_line(source), soft_wrap=True)
    if found:
        console.print(f"against the reference: {told(found)}", soft_wrap=True)
    if heat_map:
        write_heat_map(heat_map, frame.tile_list, f"{source.name}, camera {view.name}")
    console.print(describe.table({"image": str(output), "seconds": result.seconds} | frame.counts))
    write_json(json, result)


def drawn(engine: str, source: Source, view: Camera, config: Config, convention: Convention):
    """The frame of the golden model or of the reference; it is said if it shows nothing."""
    from splatcore.sim.machine.engines import golden_of, reference

    if engine == "golden":
        frame = golden_of(source, view, config, convention.background)
    else:
        frame = reference(source.gaussians, view, convention)
    note_unseen(source.name, view, frame.counts)
    return frame


def check_engine(engine: str, of_reference: bool, compare: bool):
    """InputError for an engine that is unknown, or that goes without an option that is given."""
    check_known("--engine", ENGINES, engine)
    if engine != "reference" and of_reference:
        raise InputError(f"--engine {engine}: no --original, no --heat-map")
    if engine != "golden" and not compare:
        raise InputError(f"--engine {engine}: no --no-compare")


def parse_colour(text: str) -> tuple[float, float, float]:
    """Three numbers 0 … 1 between commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--background '{text}': is not three numbers R,G,B") from None
    if not all(0 <= value <= 1 for value in (red, green, blue)):
        raise InputError(f"--background '{text}': is not within 0 … 1")
    return red, green, blue
