"""The report's section on the sweep: speed, PSNR and gates of machines with one change each."""

from collections.abc import Iterator
from dataclasses import replace

from splatcore.eda.paper import FPS, GATES_ALL
from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError
from splatcore.study.report.page import MILLION, THOUSAND, Card, Figure, Item
from splatcore.study.report.results import Facts, Results
from splatcore.study.report.scenes import AGAINST_RTL, CYCLES_MAX, VIEW
from splatcore.study.report.sweep_plot import knobs, plane
from splatcore.study.results.campaigns import SweepPoint, SweepRow
from splatcore.study.results.fields import columns, with_names

BASES = ("DEFAULT", "PAPER")  # points that are also listed scene by scene

SHOWN = (
    "knob value nand2 memory_kb frame_cycles_max fps_min psnr_db_machine_min psnr_db_machine_mean "
    "max_error_machine_max front"
)
BY_SCENE = "cycles.frame fps_at_800mhz psnr_db_machine psnr_db_scene max_error_machine"
"""Keys of columns."""


def swept(results: Results) -> tuple[Facts, Facts]:
    """The sweep and its points."""
    facts = results.facts("sweep")
    if not facts["points"]:
        raise InputError(f"{facts.file}: holds no point")
    return facts, facts["points"]


def summary(results: Results) -> Iterator[Item]:
    """Card comparing DEFAULT's PSNR with the paper's number formats; table of all points."""
    _, points = swept(results)
    own, paper = (points.get(name, {}).get("psnr_db_machine_mean") for name in BASES)
    if own is not None and paper is not None:
        yield Card(
            "Gain of each idea", f"{own - paper:+.1f} dB",
            f"mean PSNR (machine: against the same packed model) of DEFAULT's number formats "
            f"({own:.1f} dB) over the paper's ({paper:.1f} dB)",
        )  # fmt: skip
    yield Table.of(
        "sweep",
        "All machines of the sweep. Cycles and frames per second: of the slowest scene. PSNR and "
        "largest error per channel: over all scenes, 8-bit pictures against the float64 reference "
        "on the same packed model (machine). Front: on the Pareto front of cycles (slowest scene "
        "and mean), mean PSNR and gates.",
        [Column("machine"), *columns(SweepPoint, SHOWN)], with_names("machine", points),
        frozenset(n for n, name in enumerate(points) if name in BASES),
    )  # fmt: skip


FRONT = (
    "PSNR: against the reference on the same packed model (machine). One marker and colour per "
    "changed field. Filled and named: machines on the Pareto front of cycles, PSNR and gates; "
    "open: another machine is better. Dotted: the front of this plot's two axes."
)


def cycles_and_picture(results: Results) -> Iterator[Item]:
    """Plot of mean PSNR over cycles of the slowest scene."""
    facts, points = swept(results)
    yield plane(
        "cycles-psnr",
        f"Mean PSNR over cycles per frame of the slowest scene, {facts['size']}; up and left is "
        f"better. {FRONT} Dashed: the paper's {FPS} frames per second.",
        points, "cycles", "psnr", cycles=CYCLES_MAX / MILLION,
    )  # fmt: skip


def gates_and_the_rest(results: Results) -> Iterator[Item]:
    """Plots of PSNR and of speed over gates."""
    facts, points = swept(results)
    if all(point["nand2"] is None for point in points.values()):
        raise InputError(f"{facts.file}: no point has gates")
    gates = GATES_ALL / THOUSAND
    yield plane(
        "gates-psnr",
        "PSNR over gates: the marker is the mean of all scenes, the line below it reaches down to "
        f"the lowest. {FRONT} Dashed: the paper's gates.",
        points, "gates", "psnr", gates=gates,
    )  # fmt: skip
    yield plane(
        "fps-gates",
        f"Frames per second of the slowest scene over gates, {facts['size']}; up and left is "
        f"better. {FRONT} Dashed: the paper's gates and frames per second.",
        points, "gates", "fps", gates=gates, fps=FPS,
    )  # fmt: skip


def one_by_one(results: Results) -> Iterator[Item]:
    """Small plots for each knob."""
    _, points = swept(results)
    yield Figure(
        "knobs",
        "One field changed at a time, from left to right: cycles per frame of the slowest scene, "
        "PSNR (machine; marker: mean of all scenes, line: down to the lowest), gates. Dashed: "
        "DEFAULT.",
        "A row of three dot plots for each changed field.",
        knobs("knobs", points),
    )


def by_scene(results: Results) -> Iterator[Item]:
    """DEFAULT and PAPER scene by scene."""
    facts, _ = swept(results)
    views: dict[tuple[str, str], dict[str, Facts]] = {}
    for row in results.of_scenes(facts["rows"]):
        if row["point"] in BASES:
            views.setdefault((row["scene"], row["camera"]), {})[row["point"]] = row
    if not views:
        raise InputError(f"{facts.file}: rows has none of {', '.join(BASES)}")
    shown = [*VIEW]
    for base in BASES:
        cells = columns(SweepRow, BY_SCENE)
        cells[0] = cells[0].called(f"{base}: frame")
        shown += [replace(cell, get=f"{base}.{cell.get}", maybe=True) for cell in cells]
    yield Table.of(
        "sweep-scenes",
        f"DEFAULT and PAPER scene by scene, {facts['size']}, by cycle model and golden model. PSNR "
        "against the reference on the same packed model (machine) and on the scene as trained "
        "(scene).",
        shown,
        ({"scene": scene, "camera": camera} | rows for (scene, camera), rows in views.items()),
    )


def confirmed(results: Results) -> Iterator[Item]:
    """Table of the points that were simulated in RTL."""
    _, points = swept(results)
    found = {name: point["rtl"] for name, point in points.items() if point.get("rtl")}
    if not found:
        return
    yield Table.of(
        "sweep-rtl",
        "Machines of the sweep simulated in RTL: cycles per frame by the cycle model and in RTL. "
        "Identical: every bit of the picture equals the golden model's.",
        [Column("machine"), *VIEW, Column("size"), *AGAINST_RTL],
        with_names("machine", found),
    )  # fmt: skip


BLOCKS = (summary, cycles_and_picture, gates_and_the_rest, one_by_one, confirmed, by_scene)
