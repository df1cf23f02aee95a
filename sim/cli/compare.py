"""The command `compare`: errors of images, or of engines' images, against the first."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.table import Table

from splatcore.sim.cli import options
from splatcore.sim.cli.options import argument, option
from splatcore.sim.common.metric import Compared, difference
from splatcore.sim.common.output import console, write_json
from splatcore.sim.common.picture import read_png, write_error_map
from splatcore.sim.common.source import (
    ENGINES,
    Source,
    open_camera,
    open_source,
)
from splatcore.sim.machine.engines import golden_of, reference, rtl_pixels
from splatcore.sim.packing.choose import packed_model
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ImagesArgument = argument(list[str], "A.png|ENGINE B.png|ENGINE …", "The first is compared with.")
SceneOption = option(str | None, "SCENE|MODEL", "What the engines render.")
OutputOption = option(Path | None, "MAP.png", "Draw an error map of the second image.", "-o")


@options.app.command("compare")
def compare_command(
    images: ImagesArgument,
    scene: SceneOption = None,
    camera: options.CameraOption = None,
    size: options.SizeOption = None,
    preset: options.PresetOption = "DEFAULT",
    output: OutputOption = None,
    json: options.JsonOption = None,
):
    """PSNR, SSIM and maximum error of images against the first one, and an error map.

    Instead of a PNG file an engine may be named; it renders --scene from --camera. Beside golden
    or rtl the reference renders the same packed model (dB of the machine).
    """
    if len(images) < 2:
        raise InputError("compare: needs two images or more")
    config = find_preset(preset)
    packed = bool({"golden", "rtl"} & set(images))
    pictures = [picture(text, scene, camera, size, config, packed) for text in images]
    first = images[0]
    if first == "reference" and packed:
        first += " on the packed model"
    results = []
    table = Table("image", "PSNR dB", "SSIM", "max error", title=f"against {first}")
    for text, pixels in zip(images[1:], pictures[1:], strict=True):
        metrics = difference(pixels, pictures[0], text)
        table.add_row(
            text,
            "identical" if metrics.identical else f"{metrics.psnr_db:.2f}",
            "–" if metrics.ssim is None else f"{metrics.ssim:.5f}",
            f"{metrics.max_error:.4f} ({round(metrics.max_error * 255)} of 255)",
        )
        shape = (pixels.shape[1], pixels.shape[0])
        about = text, config.name, scene, camera, shape, first
        results.append(Compared(*about, **asdict(metrics), identical=metrics.identical))
    console.print(table)
    if output:
        psnr = "identical" if results[0].identical else f"{results[0].psnr_db:.2f} dB"
        title = f"{images[1]} against {first}: {psnr}"
        write_error_map(output, pictures[1], pictures[0], title)
    write_json(json, results[0] if len(results) == 1 else {"images": [vars(r) for r in results]})


def picture(
    text: str, scene: str | None, camera: str | None, size: str | None, config: Config, packed: bool
) -> np.ndarray:
    """The pixels of a PNG file, or what an engine renders; the reference of the packed model?"""
    if text not in ENGINES:
        return read_png(text)
    if scene is None:
        raise InputError(f"compare {text}: --scene says nothing about what to render")
    source: Source = open_source(scene)
    view = open_camera(camera, size, source)
    if text == "golden":
        return golden_of(source, view, config, SPLATCORE.background).pixels
    if text == "rtl":
        return rtl_pixels(config, packed_model(source, config, view), view, SPLATCORE.background)
    gaussians = packed_model(source, config, view).gaussians() if packed else source.gaussians
    return reference(gaussians, view).pixels
