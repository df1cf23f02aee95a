"""`splatcore bench scale`: time and memory of commands by the number of Gaussians.

Each command runs in a process of its own on a generated garden, here and, with --against, in
another checkout in turn.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from splatcore.sim.common.output import progress_bar, write
from splatcore.sim.common.plot import COLOURS, MARKERS, STYLE, plain_ticks
from splatcore.sim.common.table import Column, Table
from splatcore.sim.frame.picture import write_figure
from splatcore.study.bench.measured import Checkout
from splatcore.study.results.fields import columns, facts
from splatcore.study.results.scale import GIGA, Cost, Scale, ScaleNeed, ScaleRow

COUNTS = (1_000_000, 2_000_000, 4_000_000, 8_000_000, 12_000_000)
DEGREES = (1, 3)
"""Gaussians and SH degrees of the scenes."""

VIEW = "--camera cameras.json --size"  # and the size

COMMANDS = {
    "info": "info scene.ply",
    "pack compact": f"pack scene.ply --quality compact -o compact.splatcore {VIEW}",
    "pack balanced": f"pack scene.ply --quality balanced -o balanced.splatcore {VIEW}",
    "cycles": f"cycles compact.splatcore {VIEW}",
    "reference": f"render scene.ply -o reference.png {VIEW}",
    "golden": f"render compact.splatcore --engine golden --no-compare -o golden.png {VIEW}",
}
"""Words of each measured command, before the size of the picture."""

WORK = {
    "reading": ("info",),
    "packing": ("pack compact", "pack balanced"),
    "reference": ("reference",),
    "golden": ("golden", "cycles"),
}
"""Commands that show the memory of each kind of work of `spec.need.NEEDS`."""

WARM = 1000  # Gaussians of a first scene that is not measured: it compiles and caches kernels

FIXED = 200_000  # Gaussians of a scene that takes as long as a command without any

SHOWN = "gaussians sh_degree run cost.cpu_seconds cost.wall_seconds cost.peak_bytes"
OTHER = "against.cpu_seconds against.wall_seconds against.peak_bytes cpu_ratio peak_ratio"
"""Keys of columns, and those with --against."""

INCHES, DOTS_PER_INCH = (9.0, 7.0), 120


def bench_scale(
    counts: Sequence[int], degrees: Sequence[int], size: str, other: Path | None, folder: Path,
    most: int | None = None,
) -> dict:  # fmt: skip
    """Measure all scenes; write scale.csv and scale.png, and return the content of scale.json.

    The other checkout is measured on scenes of up to `most` Gaussians, if given.
    """
    checkouts = [Checkout()] + ([Checkout(other.absolute())] if other else [])
    for checkout in checkouts:
        _ = checkout.words  # raises InputError for a folder without one
    rows = list(measured(counts, degrees, size, checkouts, folder, most))
    found = facts(Scale(
        size=size, against=str(other) if other else None, rows=rows, needs=needs(rows),
        failed=[
            {"what": f"{row.run}, {row.gaussians:,} Gaussians of degree {row.sh_degree}",
             "why": row.cost.why}
            for row in rows
            if row.cost.why
        ],
    ))  # fmt: skip
    write(folder / "scale.csv", table(found).comma_separated().encode())
    write_plot(folder / "scale.png", found["rows"])
    return found


def measured(
    counts: Sequence[int], degrees: Sequence[int], size: str, checkouts: list[Checkout],
    folder: Path, most: int | None,
) -> Iterator[ScaleRow]:  # fmt: skip
    """Generate each scene in a temporary folder and yield a row for each command."""
    scenes = [(WARM, degrees[0]), *((count, degree) for degree in degrees for count in counts)]
    before, total = 0, sum(count + FIXED for count, _ in scenes)
    with progress_bar("scale", 100) as advance:
        for number, (count, degree) in enumerate(scenes):
            about = f"{count:,} Gaussians, degree {degree}"
            with TemporaryDirectory(dir=folder.absolute(), prefix=".splatcore") as place:
                names = iter(("scene", *COMMANDS, ""))
                advance(_percent(before, total), 100, f"{about}: {next(names)}")
                both = checkouts[: 1 if most and count > most else None]
                rows = of_scene(Path(place), count, degree, size, both)
                for turn, row in enumerate(rows, 1):
                    done = before + (count + FIXED) * turn / (1 + len(COMMANDS))
                    advance(_percent(done, total), 100, f"{about}: {next(names)}")
                    if number:
                        yield row
            before += count + FIXED


def _percent(done: float, total: int) -> float:
    return round(100 * done / total, 1)


def of_scene(
    place: Path, count: int, degree: int, size: str, checkouts: list[Checkout]
) -> Iterator[ScaleRow]:
    """Generate a scene and run all commands on it in each checkout; yield a row for each.

    If the scene cannot be generated, its row is the only one.
    """
    own = [] if degree == 1 else ["--sh-degree", str(degree)]  # degree 1 is the garden's own
    words = ["scene", "garden", "--count", str(count), *own, "-o", "scene.ply"]
    made = checkouts[0].measured([*words, "--cameras", "cameras.json"], place)
    yield ScaleRow(gaussians=count, sh_degree=degree, run="scene", cost=made)
    if made.why:
        return
    folders = [place / str(number) for number in range(len(checkouts))]
    for folder in folders:
        folder.mkdir()
        for name in ("scene.ply", "cameras.json"):
            (folder / name).symlink_to(place / name)
    for turn, (command, text) in enumerate(COMMANDS.items()):
        order = range(len(checkouts))[:: -1 if turn % 2 else 1]  # neither is always the first
        words = text.split() + ([size] if text.endswith("--size") else [])
        costs = {k: checkouts[k].measured(words, folders[k]) for k in order}
        row = ScaleRow(gaussians=count, sh_degree=degree, run=command, cost=costs[0])
        if len(checkouts) > 1:
            row.against = costs[1]
            row.cpu_ratio = ratio(costs, "cpu_seconds")
            row.peak_ratio = ratio(costs, "peak_bytes")
        yield row


def ratio(costs: dict[int, Cost], name: str) -> float | None:
    """Return a cost of this checkout over the other's; None if one of the commands failed."""
    ours, theirs = (getattr(costs[k], name) for k in (0, 1))
    failed = costs[0].why or costs[1].why
    return None if failed or ours is None or not theirs else round(ours / theirs, 4)


def needs(rows: Sequence[ScaleRow]) -> list[ScaleNeed]:
    """Fit the memory of each kind of work to the largest peak of its commands by scene.

    Scenes of one degree give no bytes per coefficient (0), and scenes of one count no base (0).
    """
    found = []
    for work, commands in WORK.items():
        peaks: dict[tuple[int, int], int] = {}
        for row in rows:
            if row.run in commands and row.cost.peak_bytes and not row.cost.why:
                key = row.gaussians, (row.sh_degree + 1) ** 2
                peaks[key] = max(peaks.get(key, 0), row.cost.peak_bytes)
        if not peaks:
            continue
        counts, coefficients = np.array(list(peaks)).T
        terms = np.array([np.ones(len(counts)), counts, counts * coefficients]).T
        used = [len(set(counts)) > 1, True, len(set(coefficients)) > 1]
        fitted = np.zeros(3)
        weights = 1 / counts[:, None]  # of large scenes too, the relative error counts
        values = np.array(list(peaks.values())) * weights[:, 0]
        fitted[used] = np.linalg.lstsq((terms * weights)[:, used], values, rcond=None)[0]
        base, gaussian, coefficient = (round(float(value), 1) for value in fitted)
        found.append(ScaleNeed(work=work, base=base, gaussian=gaussian, coefficient=coefficient))
    return found


def table(found: dict) -> Table:
    """The table of all commands: of both checkouts and their ratios, if there are two."""
    shown = columns(ScaleRow, SHOWN)
    if found["against"]:
        other = columns(ScaleRow, OTHER)
        shown += [each.called(f"{each.name}, against") for each in other[:3]] + other[3:]
    shown += [Column("failure", get=failure)]
    about = f"pictures of {found['size']}"
    return Table.of("scale", about, shown, found["rows"])


def failure(row: dict) -> str:
    """Why a command failed, in this checkout and in the other one."""
    other = row.get("against", {}).get("why")
    return "; ".join(filter(None, (row["cost"]["why"], other and f"against: {other}")))


def needs_table(found: dict) -> Table:
    """The table of memory by kind of work."""
    shown = columns(ScaleNeed, "work base gaussian coefficient")
    return Table.of("needs", "memory of each kind of work", shown, found["needs"])


def write_plot(path: Path, rows: list[dict]):
    """Plot CPU seconds and peak memory over the number of Gaussians, a column per SH degree.

    Solid lines: this checkout; dashed ones: the other.
    """
    degrees = sorted({row["sh_degree"] for row in rows})
    with matplotlib.rc_context(STYLE):
        figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
        grid = figure.subplots(2, len(degrees), sharex=True, sharey="row", squeeze=False)
        for column, degree in enumerate(degrees):
            grid[0][column].set_title(f"SH degree {degree}")
            grid[1][column].set_xlabel("millions of Gaussians")
            for line, (key, per) in enumerate((("cpu_seconds", 1), ("peak_bytes", GIGA))):
                mine = [row for row in rows if row["sh_degree"] == degree]
                draw(grid[line][column], mine, key, per)
        for axes, label in zip(grid[:, 0], ("CPU seconds", "peak memory, GB"), strict=True):
            axes.set_ylabel(label)
        if any("against" in row for row in rows):
            figure.suptitle("this checkout: solid, filled; the other: dashed, hollow")
        handles, labels = grid[0][0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
        write_figure(path, figure)


def draw(axes, rows: list[dict], key: str, per: float):
    """Draw a cost of each command over the number of Gaussians, on logarithmic axes."""
    for number, command in enumerate(("scene", *COMMANDS)):
        for which, dash, fill in (("cost", "-", None), ("against", "--", "none")):
            points = [
                (row["gaussians"] / 1e6, row[which][key] / per)
                for row in rows
                if row["run"] == command and which in row
                if not row[which]["why"] and row[which][key]
            ]
            if points:
                axes.plot(
                    *zip(*points, strict=True), dash, color=COLOURS[number],
                    marker=MARKERS[number], markerfacecolor=fill or COLOURS[number],
                    label="_" * bool(fill) + command,
                )  # fmt: skip
    if axes.lines:
        axes.set_xscale("log")
        axes.set_yscale("log")
        plain_ticks(axes.xaxis, (1, 2, 4, 8))
        plain_ticks(axes.yaxis, (1, 2, 5))
