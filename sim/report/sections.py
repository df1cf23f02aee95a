"""A report: its sections, each from its results; what one lacks is said, and the others stand."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.sim.report import ablation as report_ablation
from splatcore.sim.report import checks as report_checks
from splatcore.sim.report import hard as report_hard
from splatcore.sim.report import other as report_other
from splatcore.sim.report import paper_tables as report_paper
from splatcore.sim.report import pixels as report_pixels
from splatcore.sim.report import power as report_power
from splatcore.sim.report import scenes as report_scenes
from splatcore.sim.report import sweep as report_sweep
from splatcore.sim.report import work as report_work
from splatcore.sim.report.page import Item, Part, facts, html, tables
from splatcore.sim.report.results import PROGRAM, Results
from splatcore.spec.error import InputError

Block = Callable[[Results], Iterable[Item]]
"""A part of a section that stands or falls as a whole."""


@dataclass(frozen=True)
class Section:
    """A chapter of the page. about: what it says, in a sentence or two."""

    title: str
    about: str
    blocks: tuple[Block, ...]


SECTIONS = {
    "scenes": Section(
        "Real scenes in RTL simulation",
        "The whole machine, from the packed model in memory to the pixels in memory, simulated "
        "cycle by cycle. Every picture is compared with the golden model's bit for bit, and with "
        "a float64 renderer's of the same packed model after 8-bit output.",
        report_scenes.BLOCKS,
    ),
    "sweep": Section(
        "What each size and each number format buys",
        "One thing changed at a time, beside DEFAULT and PAPER (the paper's choices to the "
        "letter, as far as it states them). Cycles by the cycle model, pictures by the golden "
        "model; points simulated in RTL say so.",
        report_sweep.BLOCKS,
    ),
    "paper": Section(
        "Beside the paper",
        "Chang and Chang, “A 129FPS Full HD Real-Time Accelerator for 3D Gaussian Splatting” "
        "(IEEE TVCG): its tables with ours beside them, and where its numbers can be checked "
        "against each other.",
        (*report_paper.BLOCKS, *report_checks.BLOCKS, *report_pixels.BLOCKS),
    ),
    "ablation": Section(
        "What each idea buys",
        "The same scenes with the machine's savings switched on one after the other.",
        report_ablation.BLOCKS,
    ),
    "work": Section(
        "How much work a frame is",
        "Rates of culling and of early termination, how busy the processing elements are, and "
        "how many splats reach each tile.",
        report_work.BLOCKS,
    ),
    "power": Section(
        "Power: an estimate",
        "First order: changes of nets in RTL simulation, times gates, times an energy for each. "
        "Nothing is laid out; a factor of two either way is within what this is good for.",
        report_power.BLOCKS,
    ),
    "hard": Section(
        "Hard cases",
        "Small scenes on which renderers go wrong, each against the float64 reference on the same "
        "packed model.",
        report_hard.BLOCKS,
    ),
    "fpga": Section(
        "On an FPGA",
        "Parts placed and routed on a Lattice ECP5, each on its own. The machine is made for "
        "800 MHz in 28 nm; this shows that its parts can be placed and routed.",
        report_other.FPGA,
    ),
    "fit": Section(
        "Machines made to measure",
        "The smallest machines that reach a frame rate and a picture quality on given scenes, as "
        "users have asked for them.",
        report_other.FIT,
    ),
}  # fmt: skip
"""By name, in the order of the page."""


def compose(names: Iterable[str], results: Results) -> list[Part]:
    """Sections from results."""
    return [section(name, results) for name in names]


def section(name: str, results: Results) -> Part:
    """A section; a block that cannot be made is a problem of it."""
    about = SECTIONS[name]
    part = Part(name, about.title, about.about)
    for block in about.blocks:
        results.used.clear()
        try:
            part.items += list(block(results))
        except InputError as error:
            part.problems.append(str(error))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            what = ", ".join(dict.fromkeys(results.used)) or "results"
            kind = type(error).__name__
            part.problems.append(f"{what}: not as they should be ({kind}: {error})")
        part.problems += results.troubles
        results.troubles.clear()
    part.problems = list(dict.fromkeys(part.problems))
    for item in (*part.shown("table"), *part.shown("figure")):
        item.commands += [results.command(source) for source in dict.fromkeys(item.sources)]
        item.commands = item.commands or [f"{PROGRAM} report --section {name} -o DIR"]
    return part


def write_report(folder: Path, parts: list[Part]) -> list[Path]:
    """The page, the JSON file and the tables; their paths."""
    files = {
        folder / "report.html": html(parts),
        folder / "report.json": json.dumps(facts(parts), indent=1, ensure_ascii=False) + "\n",
    }
    place = folder / "tables"
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{place}: {error.strerror}") from None
    files |= {place / name: text for name, text in tables(parts).items()}
    for path, text in files.items():
        write(path, text.encode())
    return list(files)
