"""Bytes and error of a packed model, by part."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.pack.stored import stored_scene
from splatcore.sim.frame.choose import SAME_DB, Progress, Views
from splatcore.spec.camera import Camera
from splatcore.spec.colour import LAYOUTS, SHIFT_BITS, coefficient_count
from splatcore.spec.memory import CHUNK, CHUNK_HEADER
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene, sh_count


def bytes_by_part(model: PackedModel) -> dict[str, float]:
    """Bytes per Gaussian of each part of a model, including "codebooks" and "unused" bytes."""
    count, format = max(len(model), 1), model.format
    record = dict(format.stored_record.fields)
    width = {name: field.width for name, field in record.items()}
    shape = sum(bits for name, bits in width.items() if name[0] == "l" or name == "exponent")
    colour = sum(b for name, b in width.items() if name.startswith(("colour", "red", "gr", "bl")))
    bits = {
        "chunk headers": len(model.chunk_beats) * CHUNK_HEADER.width / count,
        "positions": format.position_record.width,
        "shape": shape,
        "opacity": width["opacity"],
        "colour": colour,
    }
    degrees = {f"degree {d}": 0.0 for d in range(1, format.sh_degree + 1)}
    if format.codebooks and format.sh_degree:
        degrees["degree 1"] = sum(b for name, b in width.items() if name.startswith("sh"))
    layouts = np.repeat(model.chunks["harmonics"], CHUNK)[: len(model)]
    gaussians = np.bincount(layouts, minlength=len(LAYOUTS))
    for layout, number in zip(LAYOUTS, gaussians, strict=True):
        for d in range(1, min(layout.degree, format.sh_degree) + 1):
            own = SHIFT_BITS + 3 * coefficient_count(d) * layout.bits[d - 1]
            degrees[f"degree {d}"] += own * number / count
    bits |= degrees
    found = {name: value / 8 for name, value in bits.items()}
    found["unused"] = model.bytes_per_gaussian - sum(found.values())
    return found | {"codebooks": format.codebook_bytes / count}


def part_by_part(scene: Scene, model: PackedModel) -> Iterator[tuple[str, Gaussians]]:
    """Yield each part's name and the scene's Gaussians with only that part packed."""
    stored = stored_scene(scene, model.format).scene
    exact, packed = stored.gaussians(), model.gaussians()
    yield "positions", replace(exact, position=packed.position)
    yield "shape", replace(exact, factor=packed.factor)
    yield "opacity", replace(exact, opacity=packed.opacity)
    for degree in range(scene.sh_degree + 1):
        sh, own = np.array(exact.sh, np.float64), slice(degree**2, sh_count(degree))
        sh[:, own] = packed.sh[:, own] if own.stop <= packed.sh.shape[1] else 0
        yield f"degree {degree}" if degree else "colour", replace(exact, sh=sh)


def psnr_by_part(
    scene: Scene, model: PackedModel, cameras: Sequence[Camera] | Views, progress: Progress = str
) -> dict[str, float | None]:
    """PSNR in dB of the scene with one part at a time packed, against the scene as trained.

    Pictures are the reference's. Returns the worst view's PSNR by part; None for equal pictures.
    """
    views, found = Views.of(scene, cameras), {}
    for name, gaussians in part_by_part(scene, model):
        progress(f"error of {name}")
        db = views.psnr_db(gaussians)
        found[name] = None if db == SAME_DB else db
    return found
