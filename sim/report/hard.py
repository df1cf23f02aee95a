"""The report's section of hard cases: three machines, the bound, and the contact sheet."""

import base64
import io
from collections.abc import Iterator

from PIL import Image, UnidentifiedImageError

from splatcore.sim.bench.hard_cases import SHEET
from splatcore.sim.common.metric import LEVELS
from splatcore.sim.report.page import Card, Column, Figure, Item, Table
from splatcore.sim.report.results import Facts, Results
from splatcore.spec.error import InputError

SOURCES = ("hard", "hard-rtl", "hard-paper")

SHEET_BYTES = 1_000_000
"""A picture within the page is no larger."""

SHRINK = 0.85
"""Of its sides, until it is small enough."""


def cases(results: Results) -> Iterator[Item]:
    """A line for each case, and for each machine PSNR and whether the bound is met."""
    found = {
        f"{facts['preset']}, {facts['engine']}": facts
        for facts in results.each(SOURCES)
        if facts["cases"]
    }
    if not found:
        return
    columns = [Column("case"), Column("what is hard", wide=True)]
    for machine, facts in found.items():
        bounds = dict.fromkeys(case["bound"] for case in facts["cases"].values())
        columns += [
            Column(machine, "PSNR, dB", 2), Column("max error", f"of {LEVELS}", 0),
            Column("bound met", "; ".join(bounds)),
        ]  # fmt: skip
    yield Table(
        "hard",
        "The hard cases, PSNR of the 8-bit picture against the float64 reference on the same "
        "packed model; none: equal pictures, or a case that the machine does not take. In RTL the "
        "picture must also be the golden model's, every bit of it. Largest errors are those of "
        "the 8-bit pictures.",
        columns, list(rows(found)), SOURCES,
    )  # fmt: skip
    for machine, facts in found.items():
        passed = sum(case["passed"] for case in facts["cases"].values())
        if not machine.startswith("PAPER"):
            yield Card(
                "How exact", f"{passed} of {len(facts['cases'])}",
                f"hard cases meet their bound ({machine})",
            )  # fmt: skip


def rows(found: dict[str, Facts]) -> Iterator[list]:
    """Cells of all cases that any of the machines was given."""
    names = dict.fromkeys(name for facts in found.values() for name in facts["cases"])
    for name in names:
        all = [facts["cases"].get(name) for facts in found.values()]
        first = next(case for case in all if case)
        row = [name.replace("_", " "), first["about"]]
        for case in all:
            if case is None:
                row += [None] * 3
            else:
                error = case["max_error"]
                row += [case["psnr_db"], None if error is None else error * LEVELS, case["passed"]]
        yield row


def sheet(results: Results) -> Iterator[Item]:
    """All cases' pictures with their errors."""
    path = results.path("hard").parent / SHEET
    try:
        with Image.open(path) as image:
            data = shrunk(image.convert("RGB"))
    except FileNotFoundError:
        raise InputError(f"{path}: is not there") from None
    except (UnidentifiedImageError, OSError) as error:
        raise InputError(f"{path}: is no picture ({error})") from None
    yield Figure(
        "hard-cases",
        "Each case as the golden model renders it, with the map of its errors on the right.",
        "Contact sheet of the hard cases.",
        uri="data:image/png;base64," + base64.b64encode(data).decode(),
        sources=("hard",),
    )


def shrunk(image: Image.Image) -> bytes:
    """A picture as PNG, made smaller until the page can take it."""
    while True:
        buffer = io.BytesIO()
        image.save(buffer, "PNG", optimize=True)
        if buffer.tell() <= SHEET_BYTES:
            return buffer.getvalue()
        image = image.resize([max(1, int(side * SHRINK)) for side in image.size], Image.LANCZOS)


BLOCKS = (cases, sheet)
