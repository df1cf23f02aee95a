"""A small cell library for tests, with delays that are easy to compute; the user's libraries."""

import os
import sys
from pathlib import Path

import pytest

from splatcore.eda.cells.liberty import EDGES
from splatcore.eda.template import ENVIRONMENT

VARIABLE = "SPLATCORE_LIBERTY"
"""Environment variable that names a folder of liberty files."""

SIZES = (1.0, 4.0)

GATES = {
    "INV": ("!A", 1.0, 2.0), "BUF": ("A", 1.0, 3.0), "NAND2": ("!(A*B)", 1.2, 3.0),
    "NOR2": ("!(A+B)", 1.4, 3.0), "AOI21": ("!((A*B)+C)", 1.6, 4.0), "XOR2": ("A^B", 2.0, 6.0),
}  # fmt: skip
"""Function, logical effort of an input (inverter: 1), um² of the smallest size."""

INPUT = 0.002  # pF of an inverter's input of size 1
AREA_FF = 16.0
DATA, SETUP = 0.003, 0.05  # pF, ns
LAUNCH = 0.15  # ns of a flip-flop without load
VOLTS = 0.9
CLOCK = 0.001  # pF of a flip-flop's clock
RISE, FALL = 0.002, 0.004  # pJ of a flip-flop's clock while its value stays
LEAKAGE = 3.0  # nW per um²

SLEWS, LOADS = (0.01, 0.1, 1.0), (0.001, 0.01, 0.1)


def delay(slew: float, load: float, effort: float = 1.0, size: float = 1.0, first: float = 0.02):
    """Delay of an output in ns."""
    return first * effort + 0.1 * slew + 5.0 * load / size


def transition(load: float, size: float = 1.0) -> float:
    """Slew of an output in ns."""
    return 0.01 + 4.0 * load / size


def inside(slew: float, load: float, effort: float = 1.0) -> float:
    """Internal energy of a changing output in pJ."""
    return 0.001 * effort + 0.002 * slew + 0.003 * load


def small_library(time: str = "1ns", swapped: bool = False, leave_out: tuple[str, ...] = ()) -> str:
    """Text of the library.

    time: its unit, 1ns or 1ps
    swapped: whether its tables are by load and slew
    leave_out: prefixes of the names of cells to leave out
    """
    scale = {"1ns": 1.0, "1ps": 1000.0}[time]

    def values(template: str, function, *rest) -> str:
        """A table of function(slew, load, ...); energies do not depend on the unit of time."""
        unit = scale if template == "times" else 1.0
        rows = [[function(slew, load, *rest) * unit for load in LOADS] for slew in SLEWS]
        rows = zip(*rows, strict=True) if swapped else rows
        return ", ".join('"' + ", ".join(f"{each:.9g}" for each in row) + '"' for row in rows)

    def axes(slew: str) -> list[tuple[str, str]]:
        """Variable and index of both axes. slew: name of that variable."""
        found = {slew: [slew * scale for slew in SLEWS], "total_output_net_capacitance": LOADS}
        texts = [(name, ", ".join(f"{v:g}" for v in axis)) for name, axis in found.items()]
        return texts[::-1] if swapped else texts

    template = Path(__file__).with_name("small.lib.jinja").read_text()
    text = ENVIRONMENT.from_string(template).render(
        at=sys.modules[__name__], edges=EDGES, time=time, scale=scale, values=values, axes=axes,
        delay=delay, inside=inside, steep=lambda _, load, size: transition(load, size),
    )  # fmt: skip
    return without_cells(text, leave_out)


def without_cells(text: str, names: tuple[str, ...]) -> str:
    """Remove cells whose names begin with one of `names` from a library's text."""
    head, *cells = text.removesuffix("}\n").split("  cell (")
    return (
        head
        + "".join(f"  cell ({c}" for c in cells if not names or not c.startswith(names))
        + "}\n"
    )


def liberty_files() -> list[Path]:
    """Libraries in the folder named by `VARIABLE`."""
    folder = os.environ.get(VARIABLE)
    return sorted(path for path in Path(folder).iterdir() if ".lib" in path.name) if folder else []


needs_libraries = pytest.mark.skipif(
    not liberty_files(), reason=f"needs standard-cell libraries: set {VARIABLE}"
)
