"""Facts about a scene or a packed model, as `splatcore info` prints them."""

import os

import numpy as np

from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.source import Source
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.levels import heights
from splatcore.spec.memory import chunk_count, chunk_sizes
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import batches

PERCENTILES = (0, 1, 50, 99, 100)
NEEDLE_RATIO, FLAKE_RATIO = 1000.0, 1000.0
"""Longest over second-longest axis above which a Gaussian is called a needle; second-longest over
shortest above which it is called a flake."""


def describe(source: Source) -> dict:
    """Return facts by name: numbers, or lists of numbers (at the `PERCENTILES`)."""
    if source.model is not None:
        return _describe_model(source)
    scene = source.scene
    facts = {"scene": source.name, "gaussians": len(scene), "sh_degree": scene.sh_degree}
    arrays = [scene.position, scene.scale, scene.opacity]
    if not np.isfinite([(array.min(), array.max()) for array in arrays if array.size]).all():
        finite = np.isfinite(scene.position).all(1) & np.isfinite(scene.scale).all(1)
        finite &= np.isfinite(scene.opacity)
        arrays = [array[finite] for array in arrays]
    facts |= source.stated | _ranges(*arrays) | _shapes(*arrays[1:])
    del facts["near"]
    facts["notes"] = facts.pop("notes")  # at the end of the table
    return facts


def _ranges(position: np.ndarray, scale: np.ndarray, opacity: np.ndarray) -> dict:
    """Return extents and ranges of finite Gaussians."""
    if not len(position):
        return {}
    return {
        "lowest_corner": _rounded([column.min() for column in position.T]),
        "highest_corner": _rounded([column.max() for column in position.T]),
        "middle_98_percent": [*map(_rounded, np.percentile(position, (1, 99), axis=0))],
        "scale_percentiles": _rounded(np.percentile(scale, PERCENTILES)),
        "opacity_percentiles": _rounded(np.percentile(opacity, PERCENTILES)),
    }


def _shapes(scale: np.ndarray, opacity: np.ndarray) -> dict:
    """Return the numbers of finite Gaussians of unusual shape, and of transparent ones."""
    needles = flakes = 0
    with np.errstate(over="ignore"):
        for rows in batches(len(scale)):
            shortest, middle, longest = np.sort(scale[rows], axis=1).T
            needles += int((longest > NEEDLE_RATIO * middle).sum())
            flakes += int((middle > FLAKE_RATIO * shortest).sum())
    transparent = int((opacity < ALPHA_MIN).sum())
    return {"needles": needles, "flakes": flakes, "transparent": transparent}


def _describe_model(source: Source) -> dict:
    model = source.model
    facts = {
        "model": source.name,
        "gaussians": len(model),
        "chunks": chunk_count(len(model)),
        "sh_degree": model.format.sh_degree,
        **source.stated,
        "positions": model.format.position,
        "bytes": len(model.image),
        "file_bytes": os.path.getsize(source.name),
        "codebook_bytes": model.format.codebook_bytes,
        "bytes_per_gaussian": round(model.bytes_per_gaussian, 3),
        **levels(model),
    } | dict.fromkeys(("lowest_corner", "highest_corner", "opacity_percentiles"))
    del facts["near"]
    if len(model):
        facts["lowest_corner"] = _rounded(model.position.min(0))
        facts["highest_corner"] = _rounded(model.position.max(0))
        facts["opacity_percentiles"] = _rounded(np.percentile(model.opacity, PERCENTILES))
    return facts


def levels(model: PackedModel) -> dict[str, list[int]]:
    """Return chunks and Gaussians of each level of detail, the finest first; empty without."""
    if not model.levels:
        return {}
    height, sizes = heights(model.levels), chunk_sizes(model.count)
    chunks, gaussians = np.bincount(height), np.bincount(height, sizes)
    return {"level_chunks": chunks.tolist(), "level_gaussians": gaussians.astype(int).tolist()}


def _rounded(values: np.ndarray) -> list[float]:
    """Round to five significant digits."""
    return [float(f"{value:.5g}") for value in np.ravel(values)]


def table(facts: dict, notes: bool = False) -> Table:
    """Return facts as a table of two columns without headings.

    notes: with the notes, which commands otherwise print as lines of their own
    """
    if "antialiased" in facts:
        reason = facts["antialiased_by"]
        hidden = ("antialiased_by",) if notes else ("antialiased_by", "notes")
        facts = {n: value for n, value in facts.items() if n not in hidden}
        facts["antialiased"] = antialiased(facts["antialiased"], reason)
    rows = [(name.replace("_", " "), _text(value)) for name, value in facts.items()]
    return Table("facts", "", [Column(""), Column("")], rows)


def antialiased(value: bool, reason: str) -> str:
    """Return "yes" or "no", opacities compensated or not, with the reason."""
    return f"{'yes' if value else 'no'} ({reason})"


def antialiased_line(source: Source) -> str:
    """Return a line on a source: opacities compensated or not, with the reason."""
    found = source.stated
    return f"antialiased: {antialiased(found['antialiased'], found['antialiased_by'])}"


def _text(value) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    if isinstance(value, (list, tuple)):
        if value and isinstance(value[0], str):
            return "\n".join(value)  # notes have commas of their own
        return ", ".join(map(_text, value)) or "none"
    return str(value)
