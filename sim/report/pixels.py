"""The paper's lists against the gates of its stage 3 and against our scenes' work.

What it prints (`sim.common.paper`), the size of our lanes (`synth`), pixels visited on our
scenes (`bench scenes`) and the lengths of their tiles' lists (`bench work`).
"""

from collections.abc import Iterator

from splatcore.hdl.stages import PAPER_GATES
from splatcore.sim.common.paper import BUFFERED, FPS, LIST, SUB_SORTER_ENTRIES, TERMINATED, TILES
from splatcore.sim.report.checks import THOUSAND, table, within
from splatcore.sim.report.page import Column, Item, Table, Text
from splatcore.sim.report.results import Results
from splatcore.sim.report.scenes import CYCLES_MAX, of_memory, of_views, views
from splatcore.sim.report.work import densest
from splatcore.spec.convention import BLOCK, TILE

PIXELS = TILE * TILE


def lane(results: Results) -> tuple[float, int]:
    """NAND2-equivalents of one of our lanes with its share of E, and how many lanes there are."""
    top = results.facts("synth")["top"]
    parts = [top["parts"][name] for name in ("evaluate", "blend")]
    lanes = parts[1]["count"] * BLOCK * BLOCK
    return sum(part["nand2"] for part in parts) / lanes, lanes


def pixel_work(results: Results) -> Iterator[Item]:
    """The pixels that its lists ask for, against the lanes that its stage 3 has room for."""
    size, lanes = lane(results)
    room, gates = PAPER_GATES["raster"] / size, PAPER_GATES["raster"] / THOUSAND
    ours = f"{size:,.0f} NAND2 a lane (evaluate and blend, {lanes} lanes)"
    checks = []
    for length in (SUB_SORTER_ENTRIES, LIST):
        for name, share in (("all", 1.0), (f"less {TERMINATED:.1%} by early end", 1 - TERMINATED)):
            evaluations = TILES * length * PIXELS * share / CYCLES_MAX
            text = (
                f"{TILES:,} tiles × {length:,} Gaussians × {PIXELS} pixels, {FPS} frames a second"
            )
            checks.append(within(
                f"stage 3: lists of {length:,}, {name}", f"{text}; {gates:g} k gates", ours,
                evaluations, "pixels a cycle", room,
            ))  # fmt: skip
    yield table(
        "checks-pixels",
        "Pixels that stage 3 would have to evaluate in a cycle, against lanes of our size that its "
        f"gates have room for. {SUB_SORTER_ENTRIES} Gaussians are what a sub-sorter holds, "
        f"{LIST:,} what most tiles of bicycle have by its figure; its frame rate is an average.",
        checks,
        ("synth",),
    )
    least, most = min(c.value for c in checks), max(c.value for c in checks)
    raster = PAPER_GATES["raster"]
    yield Text((
        f"The paper's stage 3 has {gates:g} k gates. A lane of ours (exponent, T·alpha and three "
        f"colours, fixed point) takes {size / THOUSAND:.1f} k: there is room for {room:.1f} of "
        f"them. Every pixel of every tile of its lists would be {least:.0f} to {most:.0f} pixels a "
        f"cycle, {least / room:.1f} to {most / room:.1f} times as many; its gates come to "
        f"{raster / most:,.0f} to {raster / least:,.0f} for each.",
        "So lanes of our size cannot test every pixel of a tile for every Gaussian of its list in "
        "those gates. That the paper's do so is our reading: it says neither which pixels they "
        "visit nor in what numbers they reckon."
        if least > room
        else "At least with the shorter lists that can be.",
    ))  # fmt: skip


def measured_work(results: Results) -> Iterator[Item]:
    """The pixels of our scenes at the paper's frame rate."""
    room = PAPER_GATES["raster"] / lane(results)[0]
    rows = []
    found = of_memory(views(results))
    columns, view = of_views(found)
    for row in found:
        counts = row["counts"]
        each = [
            counts["tile_pairs"] * PIXELS, counts["pairs"] * PIXELS,
            counts["visited"] * BLOCK * BLOCK, counts["contributions"],
        ]  # fmt: skip
        rates = [pixels / CYCLES_MAX for pixels in each]
        rows.append([*view(row), *rates, rates[-1] <= room])
    yield Table(
        "pixels",
        f"Pixels a cycle on our scenes at the paper's {FPS} frames a second, by what is visited. "
        f"The last column: whether {room:.1f} lanes, the room in its stage 3 at our lane's size, "
        "could keep up with the contributions alone if each were busy in every cycle and finding "
        "them cost nothing.",
        [
            *columns, Column("all pixels of exact pairs", "a cycle", 1),
            Column("… until tiles end", "a cycle", 1), Column("blocks of 4×4", "a cycle", 1),
            Column("contributions alone", "a cycle", 1), Column("fits the paper's gates"),
        ],
        rows,
        ("synth", "scenes"),
    )  # fmt: skip
    fit = sum(row[-1] for row in rows)
    yield Text((
        f"On {fit} of {len(rows)} views the blended pixels alone would fit, on {len(rows) - fit} "
        "they would not. These are our scenes, not the paper's. What brings the pairs' pixels "
        "down to the contributions, exact tiles and 4×4 blocks, the paper does not mention.",
    ))  # fmt: skip


def long_lists(results: Results) -> Iterator[Item]:
    """Tiles of our scenes whose lists a sub-sorter of the paper's does not hold."""
    rows = []
    for name, tiles in densest(results).items():
        lengths = tiles.ravel().tolist()
        entries = sum(lengths)
        shares = []
        for limit in (SUB_SORTER_ENTRIES, BUFFERED):
            over = [length for length in lengths if length > limit]
            shares += [100 * len(over) / len(lengths), 100 * sum(over) / max(entries, 1)]
        rows.append([name, entries / len(lengths), max(lengths), *shares])
    yield Table(
        "lists",
        "Lists of tiles on our scenes, each by its densest view, exact tiles, against what the "
        f"paper's sub-sorter holds ({SUB_SORTER_ENTRIES}) and what its buffers are for "
        f"({BUFFERED:,}).",
        [
            Column("scene and camera"), Column("mean list", "splats", 0),
            Column("longest", "splats", 0),
            *(
                Column(f"{what} over {limit:,}", "%", 1)
                for limit in (SUB_SORTER_ENTRIES, BUFFERED)
                for what in ("tiles", "entries in lists")
            ),
        ],
        rows,
        ("work",),
    )  # fmt: skip
    longer = sum(row[2] > SUB_SORTER_ENTRIES for row in rows)
    yield Text((
        f"On {longer} of {len(rows)} views there are lists of more than {SUB_SORTER_ENTRIES} "
        f"entries, and the paper's own tiles have {LIST:,}. A sub-sorter gives out the largest of "
        f"the {SUB_SORTER_ENTRIES} that it holds; how parts of a longer list come into one order "
        "the paper does not describe. Its rate of output would allow it (above), its text does "
        "not say it.",
    ))  # fmt: skip


BLOCKS = (pixel_work, measured_work, long_lists)
