"""Commands about scenes and models: scene, info, pack."""

from pathlib import Path
from typing import Annotated

import typer

from splatcore.model.formats.camera_file import cameras_json
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import GENERATORS, generate, generated_camera
from splatcore.model.pack.pack import STEPS, pack
from splatcore.sim.cli.image import render_frame
from splatcore.sim.cli.options import (
    CameraOption,
    JsonOption,
    PresetOption,
    SceneArgument,
    SizeOption,
    SourceArgument,
    app,
)
from splatcore.sim.common import describe
from splatcore.sim.common.metric import difference
from splatcore.sim.common.output import check_writable, console, progress_bar, whole_file, write
from splatcore.sim.common.result import write_json
from splatcore.sim.common.source import open_camera, open_source
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset


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
        if source.scene is None:
            raise InputError(f"{scene}: is a packed model already, not a scene")
        original = source.scene
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
            ("scene", source.gaussians),
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
