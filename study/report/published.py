"""Published accelerators for 3D Gaussian Splatting, and the report's section on them.

Figures are the authors' own, each with its source; None: not stated in the source that was read.
Figures of one machine that come from the paper of another are marked; frame rates are for each
author's own scenes, at the resolution in `pixels`.
"""

from collections.abc import Iterator
from typing import NamedTuple

from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.error import InputError
from splatcore.study.report.page import THOUSAND, Item
from splatcore.study.report.quality import PACKINGS, fps
from splatcore.study.report.results import Results


class Published(NamedTuple):
    """A machine.

    clock: MHz
    gates: thousands
    memory: KB on chip
    area: mm²
    power: W
    """

    name: str
    kind: str
    process: str | None
    clock: float | None
    gates: float | None
    memory: float | None
    area: float | None
    power: float | None
    pixels: str | None
    fps: str | None
    source: str


CHANG = "Chang and Chang, IEEE TVCG, arXiv 2604.10223"

PUBLISHED = (
    Published(
        "Chang and Chang", "ASIC, synthesis", "28 nm", 800, 1143.8, 120, 0.66, 0.219,
        "1920×1080", "129 (its set B), 181 (set A)", CHANG,
    ),
    Published(
        "GSCore", "ASIC, synthesis", "28 nm", 1000, None, 272, 3.95, 0.87, "800×600", "182",
        f"as the comparison of {CHANG}, prints it; own: Lee et al., ASPLOS 2024, "
        "doi 10.1145/3620666.3651385 (28 nm; 15.86 × a mobile GPU)",
    ),
    Published(
        "GSNorm", "ASIC", "22 nm", 500, None, None, 2.48, 0.284, "800×600", "94.6",
        f"as the comparison of {CHANG}, prints it",
    ),
    Published(
        "Neo", "ASIC", None, None, None, None, None, None, None,
        "up to 5.6 × the ASIC it compares with",
        "Oh et al., arXiv 2511.12930, abstract",
    ),
    Published(
        "Neo's cycle model", "model, 256 pixels per cycle, 51.2 GB/s", None, 1000, None, None, None,
        None, "1920×1080", "250 (flowers), 455 (skull), 694 (luma-seal)",
        "its published cycle model on three of this report's frames, without projection and "
        "writing of the picture: docs/performance.md",
    ),
    Published(
        "GCC", "ASIC", "28 nm", None, None, None, None, None, None, None,
        "Pei et al., arXiv 2507.15300, abstract",
    ),
    Published(
        "3D GS processor", "chip", None, None, None, None, None, None, None,
        "373, at 1.78 mJ per frame", "ISSCC 2025, 2.6, title and abstract",
    ),
    Published(
        "Vorion", "RISC-V GPU, prototype", "16 nm", None, None, None, None, None, None, "19",
        "arXiv 2511.16831, abstract",
    ),
    Published(
        "GauRast", "GPU's triangle rasterizer, extended", None, None, None, None, None, None, None,
        "24, and 46 with a later pipeline", "arXiv 2503.16681, abstract",
    ),
    Published(
        "Lee et al.", "FPGA", None, None, None, None, None, None, None, None,
        "A Hierarchical Sorting based Real-Time Gaussian Splatting Rendering FPGA Processor, "
        "JAKO202401668400714, abstract, which has no figures",
    ),
)  # fmt: skip
"""The published machines."""


OPEN = "open"  # a value that the source does not have


def own(results: Results) -> list:
    """This machine's row; a missing result leaves its cell open and is added to the troubles."""
    gates = memory = speed = size = None
    for facts in results.each(("synth",)):
        gates = facts["top"]["nand2"] / THOUSAND
    for facts in results.each(("memories",)):
        memory = facts["kilobytes"]
    try:
        facts, rows = results.rows("quality")
        found = [fps(row) for row in rows if row["asked"] == PACKINGS[0]]
        size = facts["size"].replace("x", "×")
        speed = f"{min(found):.0f} to {max(found):,.0f} (views of this report, cycle model)"
    except (InputError, ValueError) as error:
        results.troubles.append(str(error))
    return [
        "Splatcore", "Verilog, synthesis to NAND2", "–", CLOCK_HZ / 1e6, gates, memory, None, None,
        size, speed, "this report",
    ]  # fmt: skip


def published(results: Results) -> Iterator[Item]:
    """Table of this machine and all published ones."""
    yield Table(
        "published",
        "Published accelerators with their authors' figures and their sources; open: not stated in "
        "the source. Frame rates are for different scenes, models and resolutions, so they do not "
        "show which machine is better. The same frames on two machines: docs/performance.md.",
        [
            Column("machine"), Column("kind"), Column("process", none=OPEN),
            Column("clock", "MHz", 0, OPEN), Column("gates", "k NAND2", 1, OPEN),
            Column("memory", "KB", 1, OPEN), Column("area", "mm²", 2, OPEN),
            Column("power", "W", 3, OPEN), Column("resolution", none=OPEN),
            Column("FPS", none=OPEN), Column("source", wide=True),
        ],
        [own(results), *map(list, PUBLISHED)],
        frozenset({0}),
    )  # fmt: skip


PUBLISHED_SECTION = (published,)
