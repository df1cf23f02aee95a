"""`splatcore bench quality`: size against error of a scene's packed models.

Each view is packed in all qualities of `UNLEARNED` and for several target PSNRs. Errors are between
8-bit pictures. "scene": golden model against the reference on the scene as trained. "machine":
golden model against the reference on the packed model. "packing": reference on the packed model
against the reference on the scene as trained.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from splatcore.golden.pipeline import Frame, render
from splatcore.model.pack.quality import UNLEARNED
from splatcore.sim.common.plot import COLOURS, MARKERS
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.budget import bytes_by_part, psnr_by_part
from splatcore.sim.frame.choose import Judged, Views, choose, smallest
from splatcore.sim.frame.picture import write_figure, write_png
from splatcore.sim.frame.shot import View
from splatcore.spec.config import Config
from splatcore.spec.memory import ATTRIBUTE_BITS, CHUNK_HEADER
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from splatcore.study.bench.campaign import rows_of_views
from splatcore.study.results.fields import facts
from splatcore.study.results.frames import QualityRow

INCHES, DOTS_PER_INCH = (9.0, 5.5), 120

HOLLOW = {"linestyle": "none", "markerfacecolor": "none", "markersize": 9}


def quality(
    config: Config, views: list[View], targets: list[float], folder: Path, scheduler: str | None
) -> dict:
    """Measure all views, reuse existing results, and write pictures and a plot."""
    rows, failed = rows_of_views(
        "quality", measure, views, folder, scheduler, config, targets, folder
    )
    write_plot(folder / "quality.png", rows)
    return {"preset": config.name, "size": views[0].size, "rows": rows, "failed": failed}


def measure(view: View, config: Config, targets: list[float], folder: Path) -> dict:
    """Measure a view: {"rows": [one row per model]}. Writes its pictures."""
    shot = view.open(config)
    scene, camera = shot.source.unpacked, shot.camera
    seen = Views.of(scene, [camera])
    stem = f"{Path(view.scene).name.split('.')[0]}{f'-{view.camera}' if view.camera else ''}"
    write_png(folder / f"{stem}-scene.png", seen.pictures[0])
    rows = []
    for asked, packed in models(config, scene, seen, targets):
        model = packed.model
        frame = render(config, model, camera)
        if asked in UNLEARNED:
            write_png(folder / f"{stem}-{asked}.png", frame.pixels)
        rows.append(QualityRow(
            scene=Path(view.scene).name, camera=view.camera or camera.name, asked=asked,
            gaussians=len(model), sh_degree=model.format.sh_degree, bytes=len(model.image),
            bytes_per_gaussian=model.bytes_per_gaussian, bytes_by_part=bytes_by_part(model),
            psnr_db_packing_by_part=psnr_by_part(scene, model, seen),
            cycles=frame_cycles(config, frame).by_name, model_bytes=read_bytes(frame, model),
            **packed.metrics(frame.pixels),
        ))  # fmt: skip
    return {"rows": facts(rows)}


def models(
    config: Config, scene: Scene, seen: Views, targets: list[float]
) -> Iterator[tuple[str, Judged]]:
    """Yield each quality or target, and the model packed for it."""
    for name in UNLEARNED:
        yield name, choose(scene, config, seen, name)
    for target in targets:
        yield f"{target:g} dB", smallest(scene, config, seen, target)


def read_bytes(frame: Frame, model: PackedModel) -> int:
    """Bytes of the model that a frame reads, without codebooks and padding of beats.

    Headers of all chunks, positions of all chunks that are not skipped, attributes of all
    projected Gaussians.
    """
    points = frame.points
    position = model.format.position_record.width * len(points.points) // 8
    _, beats = model.attribute_bursts(points.inside)
    attributes = beats.sum() * ATTRIBUTE_BITS // 8
    return int(len(model.chunk_beats) * CHUNK_HEADER.size + position + attributes)


def write_plot(path: Path, rows: list[dict]):
    """Plot PSNR against the scene as trained over bytes per Gaussian.

    Per view: a line through the smallest models for the target PSNRs, and hollow markers for the
    qualities of `UNLEARNED`.
    """
    figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots()
    views = list(dict.fromkeys((row["scene"], row["camera"]) for row in rows))
    for k, (scene, camera) in enumerate(views):
        mine = [row for row in rows if (row["scene"], row["camera"]) == (scene, camera)]
        style = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
        label = f"{scene.split('.')[0]} {camera}"
        for named, look in ((False, {"label": label}), (True, HOLLOW)):
            places = sorted(
                (row["bytes_per_gaussian"], row["psnr_db_scene"] or np.nan)
                for row in mine
                if (row["asked"] in UNLEARNED) == named
            )
            axes.plot(*np.array(places).reshape(-1, 2).T, **style, **look)
    axes.set_xlabel("bytes per Gaussian")
    axes.set_ylabel("PSNR, golden model against the scene as trained, dB")
    axes.grid(alpha=0.3)
    if views:
        axes.legend(fontsize=8)
    write_figure(path, figure)
