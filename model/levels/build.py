"""A packed model with levels of detail (`spec.levels`), from one without.

The finest level is the model itself, with its grid, exponents and codebooks. Each further level
merges groups of four chunks to two, until one group is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from splatcore.model.compress.prune import area
from splatcore.model.export.unpacked import unpacked
from splatcore.model.levels.interleaved import interleaved
from splatcore.model.levels.merging import coarser
from splatcore.model.pack.chunk import Chunks, divided
from splatcore.model.pack.codebook import Codebook, assigned
from splatcore.model.pack.factor import elements, lower_triangular
from splatcore.model.pack.layout import Whole, lay_out, rows_of
from splatcore.model.pack.pack import appearance, largest_element, quantised
from splatcore.model.pack.stored import Stored
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.levels import PER_GROUP
from splatcore.spec.memory import CHUNK, chunk_count
from splatcore.spec.packed import PackedModel
from splatcore.spec.progress import report as report_progress
from splatcore.spec.scene import Scene, joined
from splatcore.spec.threads import in_threads, shared

MERGED = 2 * PER_GROUP
"""Chunks that become `PER_GROUP` coarser ones; a rest joins the group before."""

SIZE = PER_GROUP * CHUNK  # Gaussians of a group

BATCH = 64  # groups that a thread merges at a time


@dataclass(frozen=True, eq=False)
class Level:
    """A coarser level: G groups, whose Gaussians are stored group by group."""

    scene: Scene  # [G · SIZE]
    weight: np.ndarray  # [G · SIZE]
    error: np.ndarray  # [G] scene units
    low: np.ndarray  # [G, 3] lowest corner of the centres in the subtree, scene units
    high: np.ndarray  # [G, 3] highest corner
    children: np.ndarray  # [G + 1] first child of each group: a group, or a finest chunk
    harmonics: np.ndarray  # [G] layout of its chunks, an index of `spec.colour.LAYOUTS`


def with_levels(model: PackedModel, config: Config) -> tuple[PackedModel, int]:
    """Add coarser levels to a model.

    config: the machine
    Returns the model with all levels, and the number of coarser Gaussians whose size was clipped.
    Raises InputError if the machine renders no levels, or the model has levels already.
    """
    if not config.levels:
        raise InputError(f"{model.name}: preset {config.name} renders no levels of detail")
    if model.levels:
        raise InputError(f"{model.name}: has levels of detail already")
    levels, packed, clipped = [], [model], 0
    if chunk_count(model.count) >= MERGED:
        levels.append(first_level(model))
        while len(levels[-1].error) > 1:
            levels.append(next_level(levels[-1]))
    for done, level in enumerate(levels):
        report_progress("levels", done, len(levels))
        coarse, number = packed_like(model, level, config)
        packed.append(coarse)
        clipped += number
    places = [(level.children, level.error, level.low, level.high) for level in levels]
    return interleaved(packed, places), clipped


def first_level(model: PackedModel) -> Level:
    """Merge a model's own chunks."""

    def members(rows: slice) -> tuple[Scene, np.ndarray]:
        scene = unpacked(model, rows)
        return scene, area(scene.scale) * scene.opacity

    count = chunk_count(model.count)
    starts = np.minimum(np.arange(count + 1) * CHUNK, model.count)
    return merged(members, starts, MERGED, model.chunks["harmonics"])


def next_level(finer: Level) -> Level:
    """Merge the groups of a level; errors are at least those of the groups below."""
    starts = np.arange(len(finer.error) + 1) * SIZE
    children = MERGED // PER_GROUP
    found = merged(
        lambda rows: (finer.scene[rows], finer.weight[rows]), starts, children, finer.harmonics
    )
    first = found.children[:-1]
    return replace(
        found,
        error=np.maximum(found.error, np.maximum.reduceat(finer.error, first)),
        low=np.minimum.reduceat(finer.low, first),
        high=np.maximum.reduceat(finer.high, first),
    )


def merged(
    members: Callable[[slice], tuple[Scene, np.ndarray]],
    starts: np.ndarray,
    children: int,
    harmonics: np.ndarray,
) -> Level:
    """Merge Gaussians by groups of `children` chunks or groups; a rest joins the last group.

    members: called with slices of Gaussians; returns them and their weights
    starts: [M + 1] first Gaussian of each child
    harmonics: [M] layout of each child
    """
    groups = max((len(starts) - 1) // children, 1)
    first = np.append(np.arange(groups) * children, len(starts) - 1)
    begin = starts[first]

    def merge(some: slice) -> tuple:
        own = begin[some.start : some.stop + 1]
        scene, weight = members(slice(own[0], own[-1]))
        group = np.repeat(np.arange(len(own) - 1), np.diff(own))
        low = np.minimum.reduceat(scene.position, own[:-1] - own[0])
        high = np.maximum.reduceat(scene.position, own[:-1] - own[0])
        scene, weight, error = coarser(scene, weight, group, SIZE)
        return replace(scene, sh=scene.sh.astype(np.float32)), weight, error, low, high

    slices = [slice(k, min(k + BATCH, groups)) for k in range(0, groups, BATCH)]
    scenes, *arrays = zip(*shared(merge, slices), strict=True)
    middle = np.array([np.sort(harmonics[a:b])[(b - a) // 2] for a, b in pairwise(first)])
    return Level(joined(scenes), *map(np.concatenate, arrays), first, middle)


def packed_like(model: PackedModel, level: Level, config: Config) -> tuple[PackedModel, int]:
    """Pack a level with a model's grid, exponents and codebooks; return it as a model without
    levels, and the number of Gaussians whose size was clipped."""
    format, scene = model.format, level.scene
    exponents = {name: model.value(f"{name}_exponent") for name in ("position", "factor")}
    grid = np.rint(np.ldexp(scene.position, -exponents["position"])).astype(np.int64)
    within, codes, *fields = divided(grid, format.stored_bits)
    padding = np.zeros(len(scene), bool)
    chunks = Chunks(within, padding, exponents["position"], *fields, format.stored_bits, codes)
    most = np.ldexp(largest_element(config, format), exponents["factor"])
    position, share = scene.position[within], np.ones(len(scene))
    stored = Stored(scene, within, position, share, chunks, 0, 0, 0, 0, most)
    lower = np.empty((len(scene), 6))

    def factors(rows: slice):
        lower[rows] = elements(lower_triangular(stored.factor(rows)))

    for _ in in_threads(factors, len(scene)):
        pass
    harmonics = np.repeat(level.harmonics, PER_GROUP).astype(np.int64)
    whole = Whole(
        format, len(scene), harmonics, model.exponents, exponents["position"],
        exponents["factor"], codebooks(model, stored), model.antialiased,
    )  # fmt: skip
    parts = in_threads(lambda rows: rows_of(quantised(stored, lower, rows, whole)), len(scene))
    clipped = int((scene.scale > most).any(1).sum())
    return PackedModel(lay_out(whole, parts, model.name), model.name), clipped


def codebooks(model: PackedModel, stored: Stored) -> tuple[Codebook, ...]:
    """A model's codebooks with the entries nearest to other Gaussians; () if it has none."""
    format, found = model.format, []
    if not format.codebooks:
        return ()
    vectors = appearance(stored.sh(slice(None), format.sh_degree))
    for degree in range(2):
        _, stages, values = model.codebook(degree)
        ends = np.cumsum([1 << bits for bits in stages], dtype=np.int64)
        entries = np.split(values, ends[:-1]) if stages else []
        exponent = model.exponents[degree]
        index = assigned(vectors[degree], exponent, entries)
        found.append(Codebook(exponent, entries, index))
    return tuple(found)
