"""The command `export`: a scene or packed model as a scene file for other tools."""

from pathlib import Path

import numpy as np

from splatcore.app.cli import describe, options
from splatcore.app.cli.options import listed, option
from splatcore.model.export.loss import UNITS, losses
from splatcore.model.export.writers import WRITERS, find_writer, prepared
from splatcore.model.formats.read import read_scene
from splatcore.sim.common.output import console, progress_bar, whole_file
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.metric import LEVELS, psnr
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import open_camera, open_source
from splatcore.sim.frame.unseen import note_empty
from splatcore.spec.scene import Scene

COLUMNS = (Column("field"), Column("largest error"), Column("rms"), Column("unit"))


@options.command("export")
def export_command(
    view: options.Viewing,
    scene: str = options.SOURCE,
    output: Path = option(..., "FILE", f"Scene file to write: {listed(WRITERS)}."),
) -> dict:
    """Write a scene or packed model as a scene file for other tools.

    The suffix of FILE is the format. A packed model is written as the machine reads it. The file is
    read back, and the table has its errors against the scene or model. With --camera or --size, the
    reference also renders both, and prints the dB between the two pictures.
    """
    writer = find_writer(output)
    with progress_bar(f"reading {scene}") as advance:
        source = open_source(scene, view.reading)
        written, lost = prepared(source.scene or source.model, writer)
        source.note(lost)
        advance(0, None, f"writing {output}")
        with whole_file(output) as part:
            writer.write(part, written)
            stored = read_scene(part)
            size = part.stat().st_size
        found = losses(written, stored)
    facts = {
        "scene": scene, "file": str(output), "format": writer.name, "gaussians": len(written),
        "sh_degree": written.sh_degree, "file_bytes": size,
    } | source.stated  # fmt: skip
    describe.table(facts).print()
    loss_table(found).print()
    facts["losses"] = found
    if view.camera or view.size:
        shot = Shot(source, open_camera(view.camera, view.size, source))
        facts["psnr_db"] = db = picture_loss(shot, stored)
        loss = "equal" if db is None else f"{db:.2f} dB"
        console.print(f"picture of {output} against that of {scene}, by the reference: {loss}")
    return facts


def loss_table(found: dict[str, dict[str, float]]) -> Table:
    """Return a table of the result of `losses`."""
    rows = [
        (name, *(f"{error[key]:.2g}" for key in ("largest", "rms")), UNITS[name])
        for name, error in found.items()
    ]
    return Table("losses", "", COLUMNS, rows)


def picture_loss(shot: Shot, stored: Scene) -> float | None:
    """Return the PSNR in dB of the reference's picture of a stored scene against that of the
    source; None if they are equal."""
    from splatcore.golden.reference import render

    with progress_bar("rendering by the reference") as advance:
        pictures = [
            render(gaussians, shot.camera, shot.convention, advance).pixels
            for gaussians in (stored.gaussians(), shot.source.gaussians)
        ]
    note_empty(shot, {"visible": np.any(pictures[1])})
    return psnr(*(pixels / LEVELS for pixels in pictures))
