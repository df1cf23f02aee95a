"""The command `pack`: a scene as a packed model for the machine."""

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from splatcore.app.cli import describe, options
from splatcore.app.cli.options import option
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.pack.quality import QUALITIES
from splatcore.sim.common.choice import check_known
from splatcore.sim.common.output import (
    console,
    progress_bar,
    write,
)
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import open_cameras, open_source
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.scene import LARGE

if TYPE_CHECKING:  # it imports numba
    from splatcore.sim.frame.choose import Judged

PSNR_MAX = 100.0  # more than 8-bit pictures can show


@dataclass(frozen=True)
class Wanted:
    """The options of packing. Raises InputError for an unknown quality, a PSNR out of range, or
    both options together."""

    quality: str | None = option(
        None,
        "NAME",
        "small (11.5 bytes per Gaussian; for scenes fine-tuned to it), compact (22), balanced "
        f"(up to 38) or faithful (up to 54). {options.SMALLEST} in every view.",
        panel=options.MACHINE,
    )
    psnr: float | None = option(
        None,
        "DB",
        "Smallest model with at least DB against the scene, chosen chunk by chunk.",
        panel=options.MACHINE,
    )
    sh_degree: int | None = option(
        None, "N", "Keep harmonics up to this degree.", min=0, max=3, panel=options.MACHINE
    )
    levels: bool = option(
        False,
        None,
        "Add coarser levels of detail, for --lod-pixels; the machine must render them.",
        panel=options.MACHINE,
    )
    parts: bool = option(
        False,
        None,
        f"Measure the dB of each part of scenes of over {LARGE:,} Gaussians, too: one more "
        "rendering of the scene per part and view.",
        panel=options.MACHINE,
    )

    def __post_init__(self):
        quality, psnr = self.quality, self.psnr
        if quality is not None:
            check_known("--quality", QUALITIES, quality)
            if psnr is not None:
                raise InputError("use --psnr or --quality, not both")
        if psnr is not None and not 0 < psnr <= PSNR_MAX:
            raise InputError(f"--psnr {psnr:g}: is not in 0 … {PSNR_MAX:g} dB")

    def check(self, config: Config):
        """Raise InputError if the machine renders no levels but they are wanted."""
        if self.levels and not config.levels:
            raise InputError(f"--levels: preset {config.name} renders no levels of detail")


@options.command("pack")
def pack_command(
    view: options.Cameras,
    wanted: Wanted,
    scene: str = options.ONE_SCENE,
    output: Path = options.MODEL,
    config: Config = options.PRESET,
    plain: bool = options.PLAIN,
) -> dict:
    """Pack a scene into a model for the machine, and measure the loss.

    dB: the reference renderer's pictures of the packed model against those of the scene, in the
    worst view. In the table, only one part of the scene is packed at a time.

    "bytes" is the size in memory, "file bytes" the size of the coded file. For a file to be loaded
    directly into DRAM, use --plain.
    """
    psnr = wanted.psnr
    wanted.check(config)
    with progress_bar(f"reading {scene}"):
        source = open_source(scene, view.reading)
        original = source.unpacked
        views = open_cameras(view.camera, view.cameras, view.size, source)
    source.check_need("packing", original)
    from splatcore.sim.frame.budget import bytes_by_part, psnr_by_part
    from splatcore.sim.frame.choose import Views, choose, smallest

    if wanted.sh_degree is not None:
        config = replace(config, sh_degree=min(wanted.sh_degree, config.sh_degree))
    with progress_bar("rendering the scene") as advance:
        progress = partial(advance, 0, None)
        seen = Views.of(original, views)
        for camera, picture in zip(views, seen.pictures, strict=True):
            note_empty(Shot(source, camera), {"visible": picture.any()})
        if psnr is not None:
            packed = smallest(original, config, seen, psnr, progress)
        else:
            packed = choose(original, config, seen, wanted.quality, progress=progress)
        losses = {}
        if wanted.parts or len(original) <= LARGE:
            losses = psnr_by_part(original, packed.model, seen, progress)
    parts = bytes_by_part(packed.model)
    if wanted.levels:
        packed = with_coarser(packed, config)
    for line in packed.report.notes:
        source.note(line)
    facts = asdict(packed.report) | source.stated | {
        "preset": config.name, "quality": packed.quality, "views": len(views),
        "psnr_db_packing": packed.psnr_db,
    } | describe.levels(packed.model)  # fmt: skip
    if not wanted.levels:
        del facts["coarse_clipped"]
    with progress_bar(f"writing {output}"):
        data = file_bytes(packed.model, plain)
        write(output, data)
    size = {"file_bytes": len(data)}
    describe.table({"model": str(output)} | size | facts).print()
    parts_table(parts, losses).print()
    if psnr is not None and packed.psnr_db is not None and packed.psnr_db < psnr:
        console.print(f"{psnr:g} dB: not reached; the best is {packed.psnr_db:.2f} dB")
    return facts | size | {"bytes_by_part": parts, "psnr_db_packing_by_part": losses}


def with_coarser(packed: "Judged", config: Config) -> "Judged":
    """Return the packed scene with coarser levels of detail."""
    from splatcore.model.levels.build import with_levels

    with progress_bar("merging levels of detail"):
        model, clipped = with_levels(packed.model, config)
    return replace(packed, model=model, report=packed.report.with_levels(model, clipped))


def parts_table(parts: dict[str, float], losses: dict[str, float | None]) -> Table:
    """Return a table of bytes per Gaussian and dB by part."""
    columns = (
        Column("part"),
        Column("bytes per Gaussian", digits=2),
        Column("dB, packing", digits=1),
    )
    rows = []
    for name in dict.fromkeys((*parts, *losses)):
        db, size = losses.get(name), parts.get(name, 0)
        label = name if size or db is None else f"{name} (dropped)"
        rows.append((label, size, ("equal" if db is None else db) if name in losses else ""))
    return Table("parts", "", columns, rows)
