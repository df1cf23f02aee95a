"""The command `pack`: a scene as a packed model for the machine."""

from dataclasses import asdict, replace
from functools import partial

from rich.table import Table

from splatcore.app.cli import describe, options
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import (
    console,
    progress_bar,
    write,
    write_json,
)
from splatcore.sim.common.table import new_table
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import open_cameras, open_source
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

PSNR_MAX = 100.0  # more than 8-bit pictures can show

QualityOption = options.option(
    str | None,
    "NAME",
    "small (11.5 bytes per Gaussian; for scenes fine-tuned to it), compact (22), balanced (up to "
    f"38) or faithful (up to 54). {options.SMALLEST} in every view.",
    "--quality",
    panel=options.MACHINE,
)
PsnrOption = options.option(
    float | None,
    "DB",
    "Smallest model with at least DB against the scene, chosen chunk by chunk.",
    panel=options.MACHINE,
)
ShDegreeOption = options.option(
    int | None, "N", "Keep harmonics up to this degree.", min=0, max=3, panel=options.MACHINE
)


@options.app.command("pack")
def pack_command(
    scene: options.SceneArgument,
    output: options.ModelOption,
    view: options.Cameras,
    quality: QualityOption = None,
    psnr: PsnrOption = None,
    sh_degree: ShDegreeOption = None,
    preset: options.PresetOption = "DEFAULT",
    plain: options.PlainOption = False,
    json: options.JsonOption = None,
):
    """Pack a scene into a model for the machine, and measure the loss.

    dB: the reference renderer's pictures of the packed model against those of the scene, in the
    worst view. In the table, only one part of the scene is packed at a time.

    "bytes" is the size in memory, "file bytes" the size of the coded file. For a file to be loaded
    directly into DRAM, use --plain.
    """
    config = find_preset(preset)
    check_wanted(quality, psnr)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, view.reading)
        original = source.unpacked
        views = open_cameras(view.camera, view.cameras, view.size, source)
    from splatcore.sim.frame.budget import bytes_by_part, psnr_by_part
    from splatcore.sim.frame.choose import Views, choose, smallest

    if sh_degree is not None:
        config = replace(config, sh_degree=min(sh_degree, config.sh_degree))
    with progress_bar("rendering the scene") as advance:
        progress = partial(advance, 0, None)
        seen = Views.of(original, views)
        for camera, picture in zip(views, seen.pictures, strict=True):
            note_empty(Shot(source, camera), {"visible": picture.any()})
        if psnr is not None:
            packed = smallest(original, config, seen, psnr, progress)
        else:
            packed = choose(original, config, seen, quality, progress=progress)
        losses = psnr_by_part(original, packed.model, seen, progress)
    parts = bytes_by_part(packed.model)
    for line in packed.report.notes:
        source.note(line)
    facts = asdict(packed.report) | source.stated | {
        "preset": config.name, "quality": packed.quality, "views": len(views),
        "psnr_db_packing": packed.psnr_db,
    }  # fmt: skip
    data = file_bytes(packed.model, plain)
    size = {"file_bytes": len(data)}
    write(output, data)
    console.print(describe.table({"model": str(output)} | size | facts))
    console.print(parts_table(parts, losses))
    if psnr is not None and packed.psnr_db is not None and packed.psnr_db < psnr:
        console.print(f"{psnr:g} dB: not reached; the best is {packed.psnr_db:.2f} dB")
    write_json(json, facts | size | {"bytes_by_part": parts, "psnr_db_packing_by_part": losses})


def check_wanted(quality: str | None, psnr: float | None):
    """Raise InputError for an unknown quality, a PSNR out of range, or both options together."""
    if quality is not None:
        check_known("--quality", QUALITIES, quality)
        if psnr is not None:
            raise InputError("use --psnr or --quality, not both")
    if psnr is not None and not 0 < psnr <= PSNR_MAX:
        raise InputError(f"--psnr {psnr:g}: is not in 0 … {PSNR_MAX:g} dB")


def parts_table(parts: dict[str, float], losses: dict[str, float | None]) -> Table:
    """Return a table of bytes per Gaussian and dB by part."""
    table = new_table("part", ("bytes per Gaussian", "dB, packing"))
    for name in dict.fromkeys((*parts, *losses)):
        db, size = losses.get(name), parts.get(name, 0)
        shown = "equal" if db is None else f"{db:.1f}"
        label = name if size or db is None else f"{name} (dropped)"
        table.add_row(label, f"{size:.2f}", shown if name in losses else "")
    return table
