"""The command `compare`: errors of images, or of engines' pictures, against the first one."""

from dataclasses import asdict
from pathlib import Path

from splatcore.app.cli import describe, options, path
from splatcore.app.cli.options import argument, listed, option
from splatcore.sim.common.output import console
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.metric import (
    LEVELS,
    Compared,
    Difference,
    against,
    difference,
    differences,
)
from splatcore.sim.frame.picture import read_png, write_error_map
from splatcore.sim.frame.shot import ENGINES, Shot
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.config import Config
from splatcore.spec.error import InputError

MACHINES = {"golden", "rtl"}

MEANING = {"machine": "the packed model", "scene": "the original scene"}
"""Gaussians that the reference renders, by the name of a row of golden or rtl."""

COLUMNS = [*path.ERRORS, Column("SSIM, machine", digits=5, get="ssim_machine")]
"""Columns of a table of cameras."""


ERRORS = (
    Column("image"),
    Column("against"),
    Column("PSNR dB", digits=2, get="psnr_db", none="identical"),
    Column("SSIM", digits=5, get="ssim"),
    Column(
        "max error",
        digits=4,
        get=lambda row: f"{row['max_error']:.4f} ({round(row['max_error'] * LEVELS)} of {LEVELS})",
    ),
)
"""Columns of a table of images."""


@options.command("compare")
def compare_command(
    view: options.Cameras,
    images: list[str] = argument(
        ...,
        "A.png|ENGINE B.png|ENGINE …",
        f"The first is the reference for the others. ENGINE: {listed(ENGINES)}.",
    ),
    scene: str | None = option(
        None, "SCENE|MODEL", "Scene or model that engines render.", panel=options.SCENE
    ),
    config: Config = options.PRESET,
    scheduler: str | None = options.SCHEDULER,
    output: Path | None = option(None, "MAP.png", "Draw an error map of the second image."),
) -> dict:
    """Compare images with the first one: PSNR, SSIM and maximum error.

    An image is a PNG file, or an engine, which renders --scene from --camera. Next to golden or
    rtl, the reference renders the same packed model ("machine"); if it comes first, they are also
    compared with its picture of the original scene ("scene"). --cameras works with reference golden
    and prints one row per camera, and their minimum, mean and maximum.
    """
    path.check(view, scheduler)
    if len(images) < 2:
        raise InputError("compare: needs at least two images")
    drawn, shot = {}, None
    if view.cameras:
        if images != ["reference", "golden"] or scene is None or output:
            raise InputError("--cameras: needs reference golden --scene SCENE, and no -o")
        shots = path.open_all(scene, view, True, config=config)
        rows = list(path.along(compared_view, shots, scheduler=scheduler))
        return path.print_table(shots[0], rows, COLUMNS, "golden against reference")
    for text in images:
        if text not in ENGINES:
            drawn[text] = read_png(text)
        elif scene is None:
            raise InputError(f"compare {text}: needs --scene, the scene to render")
    if named := [text for text in images if text in ENGINES]:
        shot = view.open(scene, config=config)
        pictures, counts = rendered(named, shot)
        drawn |= pictures
        note_empty(shot, counts or {"visible": True})
    found = compared(images, drawn, config.name, scene, view.camera, shot)
    truth = (results := [result for result, _ in found])[0].against
    print_errors(images[0], found)
    if shot:
        console.print(describe.antialiased_line(shot.source))
    if output:
        psnr = "identical" if results[0].identical else f"{results[0].psnr_db:.2f} dB"
        title = f"{images[1]} against {truth}: {psnr}"
        write_error_map(output, drawn[images[1]], drawn[images[0]], title)
    return results[0] if len(results) == 1 else {"images": [vars(r) for r in results]}


def compared(
    images: list[str], drawn: dict, preset: str, scene: str | None, camera: str | None,
    shot: Shot | None,
) -> list[tuple[Compared, dict[str, Difference]]]:  # fmt: skip
    """Return the metrics of each image against the first one: for JSON, and by name for the table.

    drawn: the images, uint8 [H, W, 3], by name
    shot: the frame that engines rendered
    """
    first = images[0]
    packed = first == "reference" and MACHINES & {*images}
    truth = f"{first} on the packed model" if packed else first
    mark, results = shot.source.stated if shot else {}, []
    for text in images[1:]:
        pixels, found = drawn[text], {}
        metrics = difference(pixels, drawn[first], text)
        if first == "reference" and text in MACHINES:
            found = differences(pixels, shot.truths)
        about = text, preset, scene, camera, (pixels.shape[1], pixels.shape[0]), truth
        facts = asdict(metrics) | against(found) | mark
        result = Compared(*about, **facts, identical=metrics.identical)
        results.append((result, found or {truth: metrics}))
    return results


def print_errors(first: str, found: list[tuple[Compared, dict[str, Difference]]]):
    """Print the result of `compared`.

    first: the image that the others are compared with
    """
    rows = [
        vars(one) | {"image": result.engine, "against": name}
        for result, some in found
        for name, one in some.items()
    ]
    Table.of("compare", f"against {first}", ERRORS, rows).print()
    if names := [name for name in MEANING if any(name in rows for _, rows in found)]:
        lines = (f"{name}: reference on {MEANING[name]}" for name in names)
        console.print("; ".join(lines))


def compared_view(shot: Shot) -> dict:
    """Worker: compare golden with reference; return a row with counts and packing."""
    images = ["reference", "golden"]
    drawn, counts = rendered(images, shot)
    [(result, _)] = compared(
        images, drawn, shot.config.name, shot.source.name, shot.camera.name, shot
    )
    return vars(result) | {"counts": counts, "packing": shot.packing}


def rendered(images: list[str], shot: Shot) -> tuple[dict, dict]:
    """Render a frame by engines; return the pictures by engine, and the counts.

    With golden or rtl, the reference renders the packed model.
    """
    from splatcore.sim.frame.engines import ENGINES, reference

    if not MACHINES & {*images}:
        frame = reference(shot)
        return {"reference": frame.pixels}, frame.counts
    shot.check_fits()
    pictures, counts = {}, {}
    for name in dict.fromkeys(images):
        if name == "reference":
            pictures[name] = shot.reference
            continue
        frame = ENGINES[name](shot)
        pictures[name] = frame.pixels
        counts |= frame.counts if name == "golden" else {}
    return pictures, counts
