"""Narrower depth keys: error of pictures in the order of these keys, on exact inputs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from splatcore.golden.exact import features_of
from splatcore.golden.raster import Entries, rasterize
from splatcore.golden.reference import Splats
from splatcore.sim.common.output import progress_bar
from splatcore.sim.common.table import Column, Table, shown
from splatcore.sim.frame.metric import psnr
from splatcore.sim.frame.picture import write_figure
from splatcore.sim.frame.shot import View
from splatcore.spec.config import DEFAULT
from splatcore.study.accuracy.raster import EXACT_TITLE, exact_view

FRACTIONS = (10, 12, 14, 16, 18, 20)  # fraction bits of depths whose full codes are the keys
REBASED = (15, 18)  # bits of keys relative to the nearest entry of each group
WINDOWED = 16  # fraction bits of the depth codes that relative keys are taken from
FRAME_BITS = 15  # bits of keys relative to the nearest splat of the frame

Keys = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(depths of all splats [M], the entries' splats [N], their groups [N]) → keys of entries [N]."""


def depth_codes(depth: np.ndarray, fraction: int = WINDOWED) -> np.ndarray:
    """Encode depths as floats with `fraction` fraction bits; codes rise with depth."""
    return replace(DEFAULT.depth, fraction=fraction).encode(depth).astype(np.int64)


def window(codes: np.ndarray, part: np.ndarray, bits: int) -> np.ndarray:
    """Codes [N] minus the minimum of their part, shifted right until the part fits `bits` bits.

    part: [N] sorted, number of the part that each code belongs to
    """
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    counts = np.diff(starts, append=len(codes))
    steps = codes - np.repeat(np.minimum.reduceat(codes, starts), counts)
    _, length = np.frexp(np.maximum.reduceat(steps, starts))  # of the largest, in bits
    return steps >> np.repeat(np.maximum(length.astype(np.int64) - bits, 0), counts)


def whole(fraction: int) -> Keys:
    """Keys that are full codes with `fraction` fraction bits."""
    return lambda depth, splat, group: depth_codes(depth, fraction)[splat]


def rebased(bits: int) -> Keys:
    """Keys of `bits` bits relative to the nearest entry of each group."""
    return lambda depth, splat, group: window(depth_codes(depth)[splat], group, bits)


def of_the_frame(bits: int) -> Keys:
    """Keys of `bits` bits relative to the nearest splat of the frame."""
    return lambda depth, splat, group: window(depth_codes(depth), np.zeros_like(depth), bits)[splat]


EXACT_ORDER = "exact depth"

WAYS: dict[str, Keys] = (
    {EXACT_ORDER: lambda depth, splat, group: depth[splat]}
    | {f"{fraction} fraction bits": whole(fraction) for fraction in FRACTIONS}
    | {f"{bits} bits, by group": rebased(bits) for bits in REBASED}
    | {f"{FRAME_BITS} bits, by frame": of_the_frame(FRAME_BITS)}
)
"""Ways to make keys, by name."""


def reordered(keys: Keys, splats: Splats, entries: Entries) -> tuple[Entries, float]:
    """Sort entries by keys; return them and the share of neighbours that changed places.

    Entries with equal keys stay in the order of their Gaussians, in which they reach the sorter.
    """
    group = np.repeat(np.arange(len(entries.start) - 1), np.diff(entries.start))
    splat = entries.splat.astype(np.int64)
    key = keys(splats.depth, splat, group)
    order = np.lexsort((splats.index[splat], key, group))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    changed = (place[1:] < place[:-1]).sum()  # never across groups, which stay in order
    share = float(changed / max((group[1:] == group[:-1]).sum(), 1))
    return Entries(entries.start, entries.splat[order], entries.mask[order]), share


def sort_errors(views: dict[str, View]) -> dict:
    """Measure all `WAYS` on all views.

    Returns {way: {"scenes": {scene: {psnr_db_float64, max_error_float64, changed_places}}}}.
    """
    found = {name: {"scenes": {}} for name in WAYS}
    total = len(views) * len(WAYS)
    with progress_bar("ordering", total) as advance:
        for number, (title, view) in enumerate(views.items()):
            splats, entries, image = exact_view(view)
            features = features_of(DEFAULT, splats)
            for done, (name, keys) in enumerate(WAYS.items()):
                advance(number * len(WAYS) + done, total)
                there, share = reordered(keys, splats, entries)
                pixels = rasterize(DEFAULT, features, there, image.shape[1::-1]).pixels / 255
                found[name]["scenes"][title] = {
                    "psnr_db_float64": psnr(pixels, image),
                    "max_error_float64": float(np.abs(pixels - image).max()),
                    "changed_places": share,
                }
    return found


def sort_table(found: dict) -> Table:
    """Table of PSNR of 8-bit pictures, largest error in steps of 1/255 and changed neighbours."""
    scenes = found[EXACT_ORDER]["scenes"]
    columns = [Column("keys"), *(Column(f"{s}\ndB, max, changed", digits=1) for s in scenes)]
    rows = [[name, *map(_errors, facts["scenes"].values())] for name, facts in found.items()]
    return Table("sort", EXACT_TITLE, columns, rows)


def _errors(result: dict) -> str:
    """The errors of a scene as text."""
    psnr_db = shown(result["psnr_db_float64"], ".2f", none="exact")
    largest = result["max_error_float64"] * 255
    return f"{psnr_db}, {largest:.1f}, {result['changed_places']:.2%}"


def write_sort_plot(path: str | Path, found: dict):
    """Plot the PSNR lost against the exact order and the changed neighbours, for each way."""
    figure = Figure((13, 5.5), 150, layout="constrained")
    axes = figure.subplots(1, 2)
    exact = found[EXACT_ORDER]["scenes"]
    names = [name for name in found if name != EXACT_ORDER]
    for number, scene in enumerate(exact):
        results = [found[name]["scenes"][scene] for name in names]
        lost = [
            (exact[scene]["psnr_db_float64"] or np.nan) - (result["psnr_db_float64"] or np.nan)
            for result in results
        ]
        shares = [result["changed_places"] or np.nan for result in results]  # 0: no point
        for part, values in zip(axes, (lost, shares), strict=True):
            part.plot(names, values, marker="o", color=f"C{number % 10}", label=scene)
    axes[0].set_title("PSNR lost against the exact order, dB, 8-bit output")
    axes[1].set_title("Share of neighbouring entries that changed places")
    axes[1].set_yscale("log")
    axes[0].legend(frameon=False)
    for part in axes:
        part.tick_params("x", rotation=40)
        part.grid(alpha=0.3)
    figure.suptitle("Order by depth keys of fewer bits, on exact inputs")
    write_figure(path, figure)
