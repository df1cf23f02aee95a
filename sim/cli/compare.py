"""The command `compare`: errors of images, or of engines' images, against the first."""

from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from splatcore.sim.cli import options
from splatcore.sim.cli.options import argument, option
from splatcore.sim.common.metric import (
    LEVELS,
    Compared,
    Difference,
    against,
    difference,
    differences,
)
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.picture import read_png, write_error_map
from splatcore.sim.common.source import ENGINES, check_fits, note_unseen, open_camera, open_source
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ImagesArgument = argument(list[str], "A.png|ENGINE B.png|ENGINE …", "The first is compared with.")
SceneOption = option(str | None, "SCENE|MODEL", "What the engines render.")
OutputOption = option(Path | None, "MAP.png", "Draw an error map of the second image.", "-o")

WHOLE = "/"  # no image's name


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
    or rtl the reference renders the same packed model (machine); if it comes first, they are also
    compared with its picture of the scene as it is (scene).
    """
    if len(images) < 2:
        raise InputError("compare: needs two images or more")
    config, drawn = find_preset(preset), {}
    for text in images:
        if text not in ENGINES:
            drawn[text] = read_png(text)
        elif scene is None:
            raise InputError(f"compare {text}: --scene says nothing about what to render")
    if named := [text for text in images if text in ENGINES]:
        drawn |= rendered(named, scene, camera, size, config)
    first = images[0]
    packed = bool({"golden", "rtl"} & set(images))
    truth = f"{first} on the packed model" if first == "reference" and packed else first
    results = []
    table = Table("image", "against", "PSNR dB", "SSIM", "max error", title=f"against {truth}")
    for text in images[1:]:
        pixels, found = drawn[text], {}
        metrics = difference(pixels, drawn[first], text)
        if first == "reference" and text in ("golden", "rtl"):
            found = differences(pixels, {"machine": drawn[first]} | drawn[WHOLE])
        for name, one in (found or {first: metrics}).items():
            table.add_row(text, name, *cells(one))
        about = text, config.name, scene, camera, (pixels.shape[1], pixels.shape[0]), truth
        facts = asdict(metrics) | against(found)
        results.append(Compared(*about, **facts, identical=metrics.identical))
    console.print(table)
    if output:
        psnr = "identical" if results[0].identical else f"{results[0].psnr_db:.2f} dB"
        write_error_map(
            output, drawn[images[1]], drawn[first], f"{images[1]} against {truth}: {psnr}"
        )
    write_json(json, results[0] if len(results) == 1 else {"images": [vars(r) for r in results]})


def cells(metrics: Difference) -> tuple[str, str, str]:
    """PSNR, SSIM and largest error in the table."""
    return (
        "identical" if metrics.identical else f"{metrics.psnr_db:.2f}",
        "–" if metrics.ssim is None else f"{metrics.ssim:.5f}",
        f"{metrics.max_error:.4f} ({round(metrics.max_error * LEVELS)} of {LEVELS})",
    )


def rendered(
    engines: list[str], scene: str, camera: str | None, size: str | None, config: Config
) -> dict:
    """What engines render of a scene; beside golden or rtl the reference renders the model, and
    `WHOLE` is the scene as it is: {"scene": picture}, if it is one."""
    with progress_bar(f"reading {scene}"):
        source = open_source(scene)
        view = open_camera(camera, size, source)
    from splatcore.sim.machine.engines import golden_of, reference, rtl_pixels, truths
    from splatcore.sim.packing.choose import packed_model

    if engines == ["reference"] * len(engines):
        frame = reference(source.gaussians, view)
        note_unseen(source.name, view, frame.counts)
        return {"reference": frame.pixels}
    check_fits(config, view.width, view.height)
    with progress_bar("packing"):
        model = packed_model(source, config, view)
    pictures = {}
    if "reference" in engines:
        exact = truths(source, model, view)
        pictures["reference"] = exact.pop("machine")
        pictures[WHOLE] = exact
    if "golden" in engines:
        frame = golden_of(source, view, config, SPLATCORE.background)
        note_unseen(source.name, view, frame.counts)
        pictures["golden"] = frame.pixels
    if "rtl" in engines:
        pictures["rtl"] = rtl_pixels(config, model, view, SPLATCORE.background)
    return pictures
