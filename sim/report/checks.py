"""Whether the paper's numbers go together: arithmetic on what it prints (`sim.common.paper`).

`sim.report.pixels` holds them against our gates and our scenes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from splatcore.hdl.stages import PAPER_ALL, PAPER_MEMORIES
from splatcore.sim.common.paper import (
    ABLATION,
    BUFFER_BYTES,
    BUFFERED,
    CULLED,
    CYCLES_A_POINT,
    CYCLES_AN_ENTRY,
    FPS,
    FPS_A,
    GAUSSIANS,
    LIST,
    LIST_MAX,
    OPERATIONS,
    PES,
    PES_BUSY,
    PIXELS_PER_JOULE,
    REDUCTION,
    SIZE,
    SUB_SORTERS,
    TERMINATED,
    THROUGHPUT,
    TILES,
)
from splatcore.sim.eda.gate_table import PAPER as PAPER_STAGES
from splatcore.sim.power.estimate import PAPER_ALL as PAPER_POWER
from splatcore.sim.report.page import Column, Item, Table, Text
from splatcore.sim.report.results import Results
from splatcore.sim.report.scenes import CYCLES_MAX, MILLION
from splatcore.spec.config import KB, MEMORY_MAX

THOUSAND = 1e3

ROUNDING = 0.005
"""Two numbers that differ by less are the same, as far as they are printed."""

KEY_BYTES = 2
"""Of a depth key of 15 bits in memory."""


@dataclass(frozen=True)
class Check:
    """A number that follows from others, and one that it must equal or not exceed. holds: None if
    there is nothing to hold it against.
    """

    what: str
    paper: str
    ours: str
    value: float
    unit: str
    limit: float | None
    holds: bool | None

    @property
    def row(self) -> list:
        verdict = {True: "consistent", False: "does not fit", None: "not said"}[self.holds]
        return [self.what, self.paper, self.ours, self.value, self.limit, self.unit, verdict]


def equal(what: str, paper: str, value: float, unit: str, printed: float) -> Check:
    """Two of the paper's numbers that should be the same."""
    return Check(what, paper, "", value, unit, printed, abs(value / printed - 1) < ROUNDING)


def within(what: str, paper: str, ours: str, value: float, unit: str, limit: float) -> Check:
    """A need, and what there is."""
    return Check(what, paper, ours, value, unit, limit, value <= limit)


def table(key: str, caption: str, checks: Iterable[Check], sources: tuple[str, ...]) -> Table:
    """A line for each."""
    columns = [
        Column("what"), Column("the paper's inputs"), Column("our inputs"),
        Column("comes out", "", 2), Column("stands against", "", 2), Column("unit"),
        Column("verdict"),
    ]  # fmt: skip
    return Table(key, caption, columns, [check.row for check in checks], sources)


def printed() -> Iterator[Check]:
    """Sums and products that the paper prints."""
    pixels = SIZE[0] * SIZE[1]
    for name, fps in (("B", FPS), ("A", FPS_A)):
        yield equal(
            f"throughput, scene set {name}", f"{fps} frames a second × {SIZE[0]} × {SIZE[1]}",
            fps * pixels / MILLION, "Mpixels/s", THROUGHPUT[name] / MILLION,
        )  # fmt: skip
    yield equal(
        "energy efficiency", f"{THROUGHPUT['B'] / MILLION:g} Mpixels/s, {PAPER_POWER:g} W",
        THROUGHPUT["B"] / PAPER_POWER / MILLION, "Mpixels/J", PIXELS_PER_JOULE / MILLION,
    )  # fmt: skip
    yield equal(
        "gates of all stages", "sum of its table", sum(PAPER_STAGES.values()) / THOUSAND, "k",
        PAPER_ALL / THOUSAND,
    )  # fmt: skip
    yield equal("memories", "sum of its table", sum(PAPER_MEMORIES.values()), "KB", MEMORY_MAX / KB)
    less, all = (OPERATIONS[k]["operations"] for k in ("without zeros", "with zeros"))
    yield equal(
        "operations saved", f"{all} and {less} operations", 100 * (1 - less / all), "%",
        100 * REDUCTION,
    )  # fmt: skip


def ablation() -> Iterator[Check]:
    """Its steps' gains against the reciprocals of what is left of the work that a step saves."""
    less, all = (OPERATIONS[k]["operations"] for k in ("without zeros", "with zeros"))
    left = {
        "+ near-plane culling": (f"1 / (1 − {CULLED:g})", 1 / (1 - CULLED)),
        "+ zero skipping": (f"{all} / {less} operations", all / less),
        "+ early termination": (f"1 / (1 − {TERMINATED:g})", 1 / (1 - TERMINATED)),
    }
    steps = list(ABLATION.items())
    for (_, before), (name, after) in pairwise(steps):
        text, value = left[name]
        yield equal(f"gain, {name}", text, value, "×", after / before)


def points() -> Iterator[Check]:
    """What stages 0 and 1 have to do in a frame at its rate."""
    frame = f"{FPS} frames a second, {GAUSSIANS:,} Gaussians (Stump)"
    yield within(
        "stage 0: cycles of a frame", f"{CYCLES_A_POINT} cycles a point, {frame}", "",
        GAUSSIANS * CYCLES_A_POINT / MILLION, "M cycles", CYCLES_MAX / MILLION,
    )  # fmt: skip
    there = CYCLES_MAX / (GAUSSIANS * (1 - CULLED))
    counts = OPERATIONS["without zeros"]
    array = f"{PES} PEs busy {PES_BUSY:.1%}"
    text = f"{array}; {CULLED:.0%} culled, {frame}"
    for name, operations in (
        ("if a PE multiplies and adds at once", counts["multiply"]),
        ("if it does one operation at a time", counts["operations"]),
    ):
        yield within(
            f"stage 1: cycles of a Gaussian, {name}", f"{operations} operations on {text}", "",
            operations / (PES * PES_BUSY), "cycles", there,
        )  # fmt: skip


def sorting() -> Iterator[Check]:
    """What stage 2 has to do, and its buffers."""
    pairs = TILES * LIST / MILLION
    need = f"{TILES:,} tiles × {LIST:,} Gaussians"
    rate = f"{SUB_SORTERS} sub-sorters × 1 entry per"
    for name, cycles, ours in (
        ("entries out", CYCLES_AN_ENTRY, ""),
        ("entries in and out", CYCLES_AN_ENTRY + 1, "one more cycle to load an entry"),
    ):
        yield within(
            f"stage 2: {name}", f"{need}; {rate} {CYCLES_AN_ENTRY} cycles, {FPS} frames a second",
            ours, pairs, "M entries", SUB_SORTERS * CYCLES_MAX / cycles / MILLION,
        )  # fmt: skip
    keys = PAPER_MEMORIES["sort"] * KB / 2 - SUB_SORTERS * BUFFER_BYTES
    yield within(
        "stage 2: a long list beside three usual ones",
        f"{LIST_MAX:,} Gaussians in a tile, {BUFFERED:,} of them in its sub-sorter's buffers; "
        f"shared: {keys / KB:g} KB for keys",
        f"{KEY_BYTES} bytes a key", LIST_MAX - BUFFERED, "entries", keys / KEY_BYTES,
    )  # fmt: skip


def itself(_: Results) -> Iterator[Item]:
    """The paper's numbers against each other: needs no result of ours."""
    yield Text(
        (
            "Each line takes numbers from the paper (and from us where it says so), and holds "
            "what follows from them against what it prints or what there is. Consistent means no "
            "more than that: both numbers can be true.",
        ),
        "Where the paper's numbers hold, and where they cannot",
    )  # fmt: skip
    checks = [*printed(), *points(), *sorting()]
    yield table("checks", "The paper's numbers against each other.", checks, ())
    gains = list(ablation())
    yield table("checks-ablation", "Its ablation against its rates.", gains, ())
    first, second, third = (check.value for check in gains)
    most, all_gains = max(first * second, third), first * second * third
    if all(check.holds for check in gains):
        yield Text(
            (
                "Each gain of its ablation is the reciprocal of the share of work that one stage "
                "is left with. That is first-order arithmetic, as the paper says, not a "
                "measurement: culling and zero skipping shorten the points' half of a frame, early "
                "termination the tiles', and with both halves at work at once, as its frame-level "
                "pipeline has them, only the longer one sets the frame rate. All three together "
                f"then gain at most {most:.1f} ×, as much as those of one half, not "
                f"{all_gains:.1f} ×.",
            )
        )


BLOCKS = (itself,)
