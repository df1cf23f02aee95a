"""The report's sections on hard cases, power, FPGA and custom machines."""

import base64
import io
import shlex
from collections.abc import Iterator
from dataclasses import fields, replace

from PIL import Image, UnidentifiedImageError

from splatcore.eda.paper import FPS, MEMORY_POWER
from splatcore.sim.common.table import Column, Table
from splatcore.spec.error import InputError
from splatcore.study.bench.hard_output import SHEET
from splatcore.study.report.page import MILLI, MILLION, Card, Figure, Item, Text
from splatcore.study.report.results import Facts, Results, read
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import HardCase
from splatcore.study.results.machines import Logic, Placed

HARD_SOURCES = ("hard", "hard-rtl", "hard-paper")

FPGA_SOURCES = ("fpga-whole", "fpga-tiny", "fpga")

SHEET_BYTES, SHRINK = 1_000_000, 0.85
"""Maximum bytes of a picture within the page, and the factor by which its sides shrink to fit."""


def cases(results: Results) -> Iterator[Item]:
    """Table of hard cases: PSNR, largest error and bound for each machine."""
    found = {
        f"{facts['preset']}, {facts['engine']}": facts
        for facts in results.each(HARD_SOURCES)
        if facts["cases"]
    }
    if not found:
        return
    shown = [Column("case"), Column("difficulty", wide=True)]
    for machine, facts in found.items():
        psnr, error, passed = columns(HardCase, "psnr_db_machine max_error_machine passed")
        bounds = dict.fromkeys(case["bound"] for case in facts["cases"].values())
        met = passed.called("bound met", unit="; ".join(bounds))
        shown += [replace(each, get=f"{machine}.{each.get}", maybe=True)
                  for each in (psnr.called(machine), error, met)]  # fmt: skip
    yield Table.of(
        "hard",
        "Hard cases. PSNR (machine): 8-bit picture against the float64 reference on the same "
        "packed model; –: equal pictures, or a case that the machine does not support. The bound "
        "is on the PSNR against the reference with the machine's own rule for skipping faint "
        "splats. In RTL every bit of the picture must also equal the golden model's. Largest error "
        "per channel: between 8-bit pictures.",
        shown, hard_rows(found),
    )  # fmt: skip
    for machine, facts in found.items():
        passed = sum(case["passed"] for case in facts["cases"].values())
        if not machine.startswith("PAPER"):
            yield Card(
                "How exact", f"{passed} of {len(facts['cases'])}",
                f"hard cases meet their bound ({machine})",
            )  # fmt: skip


def hard_rows(found: dict[str, Facts]) -> Iterator[dict]:
    """All cases that were run on any of the machines, each with its results by machine."""
    names = dict.fromkeys(name for facts in found.values() for name in facts["cases"])
    for name in names:
        by = {machine: f["cases"][name] for machine, f in found.items() if name in f["cases"]}
        case = next(iter(by.values()))
        yield {"case": name.replace("_", " "), "difficulty": case["about"]} | by


def sheet(results: Results) -> Iterator[Item]:
    """Contact sheet of all cases with error maps."""
    path = results.folder_of("hard") / SHEET
    try:
        with Image.open(path) as image:
            data = shrunk(image.convert("RGB"))
    except FileNotFoundError:
        raise InputError(f"{path}: does not exist") from None
    except (UnidentifiedImageError, OSError) as error:
        raise InputError(f"{path}: not a picture ({error})") from None
    yield Figure(
        "hard-cases",
        "Each case as rendered by the golden model (left), with its error map (right): error per "
        "pixel against the float64 reference on the same packed model; dark is equal, the colour "
        "bar below has the scale.",
        "Contact sheet of the hard cases.",
        uri="data:image/png;base64," + base64.b64encode(data).decode(),
    )


def shrunk(image: Image.Image, most: int = SHEET_BYTES) -> bytes:
    """Encode a picture as PNG of at most `most` bytes, shrinking it as needed."""
    while True:
        buffer = io.BytesIO()
        image.save(buffer, "PNG", optimize=True)
        if buffer.tell() <= most:
            return buffer.getvalue()
        image = image.resize([max(1, int(side * SHRINK)) for side in image.size], Image.LANCZOS)


def power(results: Results) -> Iterator[Item]:
    """mW by stage and of memories, from the estimate of `splatcore power`."""
    facts = results.facts("power")
    fps, paper = facts["fps"], facts["paper"]
    rows = [
        logic | {"part": stage, "paper": paper["logic_w"].get(stage)}
        | {"watts": (logic["switching"] + logic["clock"]) * fps + logic["leakage"]}
        for stage, logic in facts["stages"].items()
    ]  # fmt: skip
    for stage, memory in facts["stage_memories"].items():
        name, _ = MEMORY_POWER.get(stage, (None, None))
        text = f"memories of {stage}" + (f"; the paper's: {name}" if name else "")
        watts = memory["access"] * fps + memory["leakage"]
        rows.append({"part": text, "watts": watts, "paper": paper["memory_w"].get(name)})
    whole, dram = "whole chip, estimate", "DRAM, estimate, not included"
    rows.append({"part": whole, "watts": facts["power_w"], "paper": paper["power_w"]})
    rows.append({"part": dram, "watts": facts["dram_w"]})
    blank = {"nand2": None, "activity": None}
    size = "×".join(map(str, facts["size"]))
    setting = f"{facts['scene']} at {size}, {fps:.1f} frames per second, preset {facts['preset']}"
    yield Table.of(
        "power",
        f"Estimated power of {setting}. The paper's figures: its own scenes at {FPS} frames per "
        f"second, gate-level simulation. Ours: {facts['power_w'] / fps / MILLI:.3f} mJ per frame, "
        f"{facts['pixels_per_j'] / MILLION:,.0f} Mpixels/J (an estimate) without DRAM.",
        [
            Column("part"), *columns(Logic, "nand2 activity"),
            Column("estimate", "mW", 2, get="watts", per=MILLI),
            Column("the paper", "mW", 2, get="paper", per=MILLI),
        ],
        [blank | row for row in rows], frozenset({len(rows) - 2}),
    )  # fmt: skip
    yield Card(
        "How large",
        f"≈ {facts['power_w'] / MILLI:,.0f} mW",
        f"first-order estimate: {setting}; the paper: {paper['power_w'] / MILLI:.0f} mW at {FPS}",
    )


def placed(results: Results) -> Iterator[Item]:
    """A whole machine on an FPGA, and parts of two others."""
    rows = []
    for facts in results.each(FPGA_SOURCES):
        for name, why in facts["failed"].items():
            results.troubles.append(f"{facts.file}: {name} is not placed: {why}")
        try:
            rows += parts(facts)
        except InputError as error:
            results.troubles.append(str(error))
    if not rows:
        return
    yield Table(
        "fpga",
        "Placed and routed on a Lattice ECP5 by yosys and nextpnr: a whole machine with several "
        "seeds, and parts of machines, each alone. From, to: ends of the path that limits Fmax. "
        "The registers around single parts are subtracted.",
        [Column("machine"), Column("device"), Column("part"), *PLACED],
        rows,
    )  # fmt: skip


PLACED = columns(Placed, " ".join(each.name for each in fields(Placed)))


def parts(facts: Facts) -> list[list]:
    """Cells of a machine's parts, or of the whole machine for each seed."""
    seeds = {f"whole, seed {n}": part for n, part in enumerate(facts.get("seeds", ()), 1)}
    device = f"LFE5U-{facts['device'].upper()}-{facts['speed']}"
    return [
        [facts["preset"], device, name, *(column.value(part) for column in PLACED)]
        for name, part in (seeds or facts["parts"]).items()
    ]


def fitted(results: Results) -> Iterator[Item]:
    """Machines found by `splatcore fit`, if any."""
    place = results.folder / "fit"
    paths = sorted(place.glob("*.json"))
    if not paths:
        yield Text(
            f"No machines in {place}. Create one: splatcore fit SCENE --fps F -o "
            f"{place}/NAME.toml --json {place}/NAME.json"
        )
        return
    knobs, views, commands = [], [], []
    for path in paths:
        try:
            facts = read(path)
            psnr = facts["psnr_db_machine"]
            asked = f"{facts['scene']}, {facts['fps']:g} FPS" + (
                f", {psnr:g} dB, machine" if psnr else ""
            )
            words = ["splatcore", "fit", facts["scene"], "--fps", f"{facts['fps']:g}"]
            words += ["--psnr", f"{psnr:g}"] if psnr else []
            words += ["-o", str(path.with_suffix(".toml")), "--json", str(path)]
            knobs += [
                [path.stem, name, field["default"], field["chosen"], field["reason"]]
                for name, field in facts["fields"].items()
            ]
            for name, view in facts["views"].items():
                found = view["frame"] / MILLION, view["fps"], view["psnr_db_machine"]
                views.append([path.stem, asked, name, *found])
            commands.append(shlex.join(words))
        except InputError as error:
            results.troubles.append(str(error))
    if not views:
        return
    yield Table(
        "fit",
        "The machines by view, by cycle model and golden model. PSNR: against the reference on the "
        "same packed model. The commands may lack the cameras and sizes that were used.",
        [
            Column("machine"), Column("target"), Column("view"), Column("frame", "M cycles", 2),
            Column("FPS", "at 800 MHz", 1), Column("PSNR, machine", "dB", 2, none="exact"),
        ],
        views, commands=list(commands),
    )  # fmt: skip
    yield Table(
        "fit-knobs",
        "Fields of each machine, and the reason why each is not smaller.",
        [
            Column("machine"), Column("field"), Column("DEFAULT"), Column("chosen"),
            Column("reason"),
        ],
        knobs, commands=list(commands),
    )  # fmt: skip


HARD, POWER, FPGA, FIT = (cases, sheet), (power,), (placed,), (fitted,)
