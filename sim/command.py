"""The command line `splatcore`."""

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from golden.reference import Frame, render
from model.camera_file import cameras_json
from model.generate import GENERATORS, generate, generated_camera
from model.pack import STEPS, pack
from model.ply import write_ply
from sim import describe
from sim.metric import difference
from sim.output import check_writable, console, messages, progress_bar, whole_file, write
from sim.picture import read_png, write_error_map, write_heat_map, write_png
from sim.result import Result, write_json
from sim.source import ENGINES, Source, check_engine, open_camera, open_scene, open_source
from spec.camera import Camera
from spec.config import preset as find_preset
from spec.convention import ORIGINAL, SPLATCORE, Convention
from spec.error import InputError
from spec.scene import Gaussians

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help="""Splatcore: an open hardware accelerator for 3D Gaussian Splatting.

    SCENE is a scene file (3DGS PLY, compressed PLY, SPZ, .splat, SOG), a packed model where that
    makes sense, or the name of a generated scene (see `splatcore scene --help`).

    Start with:  splatcore render garden -o garden.png
    """,
)

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene file or generated scene.")
]
SourceArgument = Annotated[
    str, typer.Argument(metavar="SCENE|MODEL", help="Scene file, generated scene or packed model.")
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="FILE[:ID]",
        help="INRIA cameras.json, transforms.json or COLMAP sparse/0; the first camera without "
        "ID. Default: a sensible view of the scene.",
    ),
]
SizeOption = Annotated[
    str | None,
    typer.Option("--size", metavar="WxH", help="Pixels; the camera's intrinsics are scaled."),
]
PresetOption = Annotated[
    str, typer.Option("--preset", metavar="NAME", help="Machine: DEFAULT, PAPER or TINY.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write results (see docs/json.md).")
]


@app.command(
    "scene",
    help="Generate a scene and write it as a 3DGS PLY.\n\nNAME is `garden`, the embedded default, "
    "or one of the hard cases: " + ", ".join(name for name in GENERATORS if name != "garden") + ".",
)
def scene_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Which scene.")],
    output: Annotated[Path, typer.Option("-o", metavar="FILE.ply", help="Where to write it.")],
    count: Annotated[int | None, typer.Option(help="Number of Gaussians.")] = None,
    seed: Annotated[int, typer.Option(help="Same seed, same scene.")] = 0,
    cameras: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write the scene's own view, too.")
    ] = None,
):
    check_writable(output, cameras)
    with progress_bar(f"generating {name}"):
        scene = generate(name, count, seed)
        with whole_file(output) as part:
            write_ply(part, scene)
        if cameras:
            write(cameras, cameras_json([generated_camera(name)]).encode())
    console.print(f"{output}: {len(scene)} Gaussians, SH degree {scene.sh_degree}")


@app.command("info")
def info_command(scene: SourceArgument, json: JsonOption = None):
    """Say what a scene or packed model holds: counts, extents, ranges, anything odd."""
    check_writable(json)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        facts = describe.describe(source)
    console.print(describe.table(facts))
    write_json(json, facts)


@app.command("pack")
def pack_command(
    scene: SceneArgument,
    output: Annotated[Path, typer.Option("-o", metavar="MODEL", help="Where to write it.")],
    sh_degree: Annotated[
        int | None, typer.Option(min=0, max=1, help="Keep harmonics up to this degree.")
    ] = None,
    preset: PresetOption = "DEFAULT",
    camera: CameraOption = None,
    size: SizeOption = None,
    json: JsonOption = None,
):
    """Pack a scene into the model that the machine reads, and say what that loses.

    The loss is the reference renderer's picture of the packed model against its picture of the
    scene, from one view: with the scene's harmonics cut to the packed degree, and with all.
    """
    check_writable(output, json)
    config = find_preset(preset)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        original = open_scene(scene) if source.scene is None else source.scene
        view = open_camera(camera, size, source)
    with progress_bar("packing", len(STEPS)) as advance:
        model, report = pack(
            original,
            config,
            sh_degree,
            lambda step: advance(STEPS.index(step), len(STEPS), f"packing: {step}"),
        )
    pictures = [
        render_frame(gaussians, view, SPLATCORE, label).pixels
        for label, gaussians in (
            ("packed model", model.gaussians()),
            ("scene, same degree", original.with_sh_degree(report.sh_degree).gaussians()),
            ("scene", original.gaussians()),
        )
    ]
    loss = difference(pictures[0], pictures[1])
    facts = report.as_dict() | {
        "preset": config.name,
        "psnr_db": loss.psnr_db,
        "ssim": loss.ssim,
        "max_error": loss.max_error,
        "psnr_db_all_harmonics": difference(pictures[0], pictures[2]).psnr_db,
    }
    write(output, model.image.tobytes())
    console.print(describe.table({"model": str(output)} | facts))
    write_json(json, facts)


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
    json: JsonOption = None,
):
    """Render one frame and count the work in it."""
    check_engine(engine)
    check_writable(output, heat_map, json)
    config = find_preset(preset)
    convention = replace(ORIGINAL if original else SPLATCORE, background=parse_colour(background))
    begin = time.perf_counter()
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        view = open_camera(camera, size, source)
    frame = render_frame(source.gaussians(), view, convention, "rendering")
    result = Result(
        engine, config.name, source.name, camera or view.name, (view.width, view.height),
        round(time.perf_counter() - begin, 3), frame.counts,
    )  # fmt: skip
    write_png(output, frame.pixels)
    if heat_map:
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

    Instead of a PNG file an engine may be named; it renders --scene from --camera.
    """
    if len(images) < 2:
        raise InputError("compare: needs two images or more")
    check_writable(output, json)
    config = find_preset(preset)
    pictures = [picture(text, scene, camera, size) for text in images]
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


def picture(text: str, scene: str | None, camera: str | None, size: str | None) -> np.ndarray:
    """The pixels of a PNG file, or what an engine renders."""
    if text not in ENGINES:
        return read_png(text)
    check_engine(text)
    if scene is None:
        raise InputError(f"compare {text}: --scene says nothing about what to render")
    source: Source = open_source(scene)
    view = open_camera(camera, size, source)
    return render_frame(source.gaussians(), view, SPLATCORE, text).pixels


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


def main(arguments: list[str] | None = None):
    """Run the command line; bad input is one line on standard error and exit status 2."""
    try:
        app(arguments)
    except InputError as error:
        messages.print(f"error: {error}", markup=False, soft_wrap=True)
        sys.exit(2)
    except MemoryError:
        messages.print("error: memory exhausted; a smaller --size needs less", markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
