"""A report: its sections, each from its results; a section says what it lacks, the others stand."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from splatcore.sim.common.output import write
from splatcore.sim.report import (
    budget,
    campaigns,
    compression,
    other,
    paper_tables,
    published,
    quality,
    scenes,
    sweep,
)
from splatcore.sim.report.page import Item, Part, facts, html
from splatcore.sim.report.results import Results
from splatcore.spec.error import InputError

Block = Callable[[Results], Iterable[Item]]  # a part of a section that stands or falls as a whole

SECTIONS: dict[str, tuple[str, str, tuple[Block, ...]]] = {
    "scenes": (
        "Real scenes in RTL simulation",
        "The whole machine, from the packed model in memory to the pixels in memory, simulated "
        "cycle by cycle. Every picture is compared with the golden model's bit for bit, and with "
        "a float64 renderer's of the same packed model (machine) and of the scene as it is "
        "(scene), 8-bit pictures of all.",
        scenes.BLOCKS,
    ),
    "quality": (
        "What bytes buy",
        "Packed models from few bytes a Gaussian to many, all at once as the machine renders them: "
        "its picture against the scene as it is, and cycles by the cycle model.",
        quality.QUALITY,
    ),
    "budget": (
        "Where the error comes from",
        "The 8-bit picture against the scene as it is, all harmonics, in float64: what packing "
        "takes, part by part, and what the machine's numbers, its order and its output take.",
        budget.BUDGET,
    ),
    "sweep": (
        "What each size and each number format buys",
        "One thing changed at a time, beside DEFAULT and PAPER (the paper's choices to the "
        "letter, as far as it states them). Cycles by the cycle model, pictures by the golden "
        "model; points simulated in RTL say so.",
        sweep.BLOCKS,
    ),
    "paper": (
        "Beside the paper",
        "Chang and Chang, “A 129FPS Full HD Real-Time Accelerator for 3D Gaussian Splatting” "
        "(IEEE TVCG): its tables with ours beside them. Where its numbers agree with each other "
        "and where they cannot: docs/paper.md.",
        paper_tables.BLOCKS,
    ),
    "published": (
        "Published accelerators",
        "Other machines for 3D Gaussian Splatting, by what their authors print.",
        published.PUBLISHED_SECTION,
    ),
    "ablation": (
        "What each idea buys",
        "The same scenes with the machine's savings switched on one after the other.",
        campaigns.ABLATION,
    ),
    "work": (
        "How much work a frame is",
        "Rates of culling and of early termination, how busy the processing elements are, and "
        "how many splats reach each tile.",
        campaigns.WORK,
    ),
    "compression": (
        "Compression",
        "Pruning, distillation and quantisation with fine-tuning between, to models that the "
        "machine reads as they are: docs/compression.md.",
        compression.COMPRESSION,
    ),
    "power": (
        "Power: an estimate",
        "First order: changes of nets in RTL simulation, times gates, times an energy for each. "
        "Nothing is laid out; a factor of two either way is within what this is good for.",
        other.POWER,
    ),
    "hard": (
        "Hard cases",
        "Small scenes on which renderers go wrong, each against the float64 reference on the same "
        "packed model.",
        other.HARD,
    ),
    "fpga": (
        "On an FPGA",
        "Parts placed and routed on a Lattice ECP5, each on its own. The machine is made for "
        "800 MHz in 28 nm; this shows that its parts can be placed and routed.",
        other.FPGA,
    ),
    "fit": (
        "Machines made to measure",
        "The smallest machines that reach a frame rate and a picture quality on given scenes, as "
        "users have asked for them.",
        other.FIT,
    ),
}
"""Title, introduction and blocks by name, in the order of the page."""


def compose(name: str, results: Results) -> Part:
    """A section; a block that cannot be made is a problem of it."""
    title, about, blocks = SECTIONS[name]
    part = Part(name, title, about)
    for block in blocks:
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
    for card in part.shown("card"):
        card.section = name
    for item in (*part.shown("table"), *part.shown("figure")):
        item.commands += [results.command(source) for source in dict.fromkeys(item.sources)]
        versions = map(results.version, dict.fromkeys(item.sources))
        item.versions = list(dict.fromkeys(filter(None, versions)))
        item.commands = item.commands or [f"splatcore report --section {name} -o DIR"]
    return part


def write_report(folder: Path, parts: list[Part]) -> list[Path]:
    """Write the page, the JSON file and the tables; returns their paths."""
    files = {
        folder / "report.html": html(parts),
        folder / "report.json": json.dumps(facts(parts), indent=1, ensure_ascii=False) + "\n",
    }
    place = folder / "tables"
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{place}: {error.strerror}") from None
    for table in (table for part in parts for table in part.shown("table")):
        files[place / f"{table.key}.csv"] = table.comma_separated()
    for path, text in files.items():
        write(path, text.encode())
    return list(files)
