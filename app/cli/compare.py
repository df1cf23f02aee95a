"""The command `compare`: errors of images, or of engines' pictures, against the first one."""

from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from splatcore.app.cli import describe, options, path
from splatcore.app.cli.bench import SchedulerOption
from splatcore.app.cli.options import argument, option
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.frame.metric import (
    LEVELS,
    Compared,
    Difference,
    against,
    difference,
    differences,
)
from splatcore.sim.frame.picture import read_png, write_error_map
from splatcore.sim.frame.reading import Reading
from splatcore.sim.frame.source import (
    ENGINES,
    Source,
    check_fits,
    open_cameras,
    open_source,
)
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

ImagesArgument = argument(
    list[str],
    "A.png|ENGINE B.png|ENGINE …",
    f"The first is the reference for the others. ENGINE: {', '.join(ENGINES)}.",
)
SceneOption = option(
    str | None, "SCENE|MODEL", "Scene or model that engines render.", panel=options.SCENE
)
OutputOption = option(
    Path | None, "MAP.png", "Draw an error map of the second image.", "-o", panel=options.OUTPUT
)

WHOLE = "/"  # key of the pictures of the original scene: no image has this name

MEANING = {"machine": "the packed model", "scene": "the original scene"}
"""Gaussians that the reference renders, by the name of a row of golden or rtl."""

COLUMNS = path.ERRORS | {"SSIM, machine": path.cell("ssim_machine", form=".5f")}
"""Columns of a table of cameras."""


@options.app.command("compare")
def compare_command(
    images: ImagesArgument,
    scene: SceneOption = None,
    camera: options.CameraOption = None,
    cameras: options.CamerasOption = None,
    size: options.SizeOption = None,
    antialiased: options.AntialiasedOption = None,
    axes: options.AxesOption = None,
    near: options.NearOption = None,
    preset: options.PresetOption = "DEFAULT",
    scheduler: SchedulerOption = None,
    output: OutputOption = None,
    json: options.JsonOption = None,
):
    """Compare images with the first one: PSNR, SSIM and maximum error.

    An image is a PNG file, or an engine, which renders --scene from --camera. Next to golden or
    rtl, the reference renders the same packed model ("machine"); if it comes first, they are also
    compared with its picture of the original scene ("scene"). --cameras works with reference golden
    and prints one row per camera, and their minimum, mean and maximum.
    """
    path.check(camera, cameras, scheduler)
    if len(images) < 2:
        raise InputError("compare: needs at least two images")
    config, drawn, mark = find_preset(preset), {}, {}
    reading = Reading(antialiased, axes, near)
    if cameras:
        if images != ["reference", "golden"] or scene is None or output:
            raise InputError("--cameras: needs reference golden --scene SCENE, and no -o")
        source, views = path.open_all(cameras, size, scene, reading, config)
        quality = path.quality_of(source, config, views)
        rows = list(path.along(compared_view, source, views, (config, quality), scheduler))
        write_json(json, path.print_table(source, rows, COLUMNS, "golden against reference"))
        return
    for text in images:
        if text not in ENGINES:
            drawn[text] = read_png(text)
        elif scene is None:
            raise InputError(f"compare {text}: needs --scene, the scene to render")
    if named := [text for text in images if text in ENGINES]:
        with progress_bar(f"reading {scene}"):
            source = open_source(scene, reading)
            (view,) = open_cameras(camera, None, size, source)
        pictures, counts = rendered(named, source, view, config)
        drawn, mark = drawn | pictures, source.stated
        note_empty(source, view, counts or {"visible": True})
    found = compared(images, drawn, config.name, scene, camera, mark)
    truth = (results := [result for result, _ in found])[0].against
    print_errors(images[0], found)
    if mark:
        console.print(describe.antialiased_line(source), soft_wrap=True)
    if output:
        psnr = "identical" if results[0].identical else f"{results[0].psnr_db:.2f} dB"
        title = f"{images[1]} against {truth}: {psnr}"
        write_error_map(output, drawn[images[1]], drawn[images[0]], title)
    write_json(json, results[0] if len(results) == 1 else {"images": [vars(r) for r in results]})


def compared(
    images: list[str], drawn: dict, preset: str, scene: str | None, camera: str | None, mark: dict
) -> list[tuple[Compared, dict[str, Difference]]]:
    """Return the metrics of each image against the first one: for JSON, and by name for the table.

    drawn: the images, uint8 [H, W, 3], by name
    mark: `Source.stated` of the scene that engines rendered; empty without a scene
    """
    first = images[0]
    packed = bool({"golden", "rtl"} & set(images))
    truth = f"{first} on the packed model" if first == "reference" and packed else first
    results = []
    for text in images[1:]:
        pixels, found = drawn[text], {}
        metrics = difference(pixels, drawn[first], text)
        if first == "reference" and text in ("golden", "rtl"):
            found = differences(pixels, {"machine": drawn[first]} | drawn[WHOLE])
        about = text, preset, scene, camera, (pixels.shape[1], pixels.shape[0]), truth
        facts = asdict(metrics) | against(found) | mark
        result = Compared(*about, **facts, identical=metrics.identical)
        results.append((result, found or {truth: metrics}))
    return results


def print_errors(first: str, found: list[tuple[Compared, dict[str, Difference]]]):
    """Print the result of `compared`.

    first: the image that the others are compared with
    """
    headings = "image", "against", "PSNR dB", "SSIM", "max error"
    table = Table(*headings, title=f"against {first}")
    for result, rows in found:
        for name, one in rows.items():
            table.add_row(result.engine, name, *cells(one))
    console.print(table)
    if names := [name for name in MEANING if any(name in rows for _, rows in found)]:
        lines = (f"{name}: reference on {MEANING[name]}" for name in names)
        console.print("; ".join(lines), soft_wrap=True)


def compared_view(source: Source, view: Camera, config: Config, quality: str | None) -> dict:
    """Worker: compare golden with reference; return a row with counts and packing."""
    from splatcore.sim.frame.choose import packing

    images = ["reference", "golden"]
    drawn, counts = rendered(images, source, view, config, quality)
    mark = source.stated
    [(result, _)] = compared(images, drawn, config.name, source.name, view.name, mark)
    exact = {"machine": drawn["reference"]} | drawn[WHOLE]
    return vars(result) | {"counts": counts, "packing": packing(source, exact)}


def cells(metrics: Difference) -> tuple[str, str, str]:
    """Return PSNR, SSIM and maximum error as texts of the table."""
    return (
        "identical" if metrics.identical else f"{metrics.psnr_db:.2f}",
        "–" if metrics.ssim is None else f"{metrics.ssim:.5f}",
        f"{metrics.max_error:.4f} ({round(metrics.max_error * LEVELS)} of {LEVELS})",
    )


def rendered(
    engines: list[str], source: Source, view: Camera, config: Config, quality: str | None = None
) -> tuple[dict, dict]:
    """Render a source by engines; return the pictures by engine, and the counts.

    With golden or rtl, the reference renders the packed model, and the key `WHOLE` holds {"scene":
    its picture of the original scene}, or {} for a source that is a packed model.
    """
    from splatcore.sim.frame.choose import packed_model
    from splatcore.sim.frame.engines import golden_of, reference, rtl_pixels, truths

    if engines == ["reference"] * len(engines):
        frame = reference(source.gaussians, view)
        return {"reference": frame.pixels}, frame.counts
    check_fits(config, view.width, view.height)
    with progress_bar("packing"):
        model = packed_model(source, config, view, quality)
    pictures, counts = {}, {}
    if "reference" in engines:
        exact = truths(source, model, view)
        pictures["reference"] = exact.pop("machine")
        pictures[WHOLE] = exact
    if "golden" in engines:
        frame = golden_of(source, view, config, SPLATCORE.background, quality)
        pictures["golden"], counts = frame.pixels, frame.counts
    if "rtl" in engines:
        pictures["rtl"] = rtl_pixels(config, model, view, SPLATCORE.background)
    return pictures, counts
