"""A small cell library for tests, with delays that are easy to compute; the user's libraries."""

import os
from pathlib import Path

import pytest

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


class Writer:
    """Writes the library. scale: time units per ns; swapped: loads are the rows of tables."""

    def __init__(self, scale: float, swapped: bool):
        self.scale, self.swapped = scale, swapped

    def table(self, kind: str, value) -> str:
        """A table of value(slew, load)."""
        values = [[value(slew, load) * self.scale for load in LOADS] for slew in SLEWS]
        if self.swapped:
            values = [list(column) for column in zip(*values, strict=True)]
        text = ", ".join('"' + ", ".join(f"{each:.9g}" for each in row) + '"' for row in values)
        template = "energies" if kind.endswith("power") else "times"
        return f"        {kind} ({template}) {{ values ({text}); }}\n"

    def timing(self, begin: str, kind: str, sense: str, value, steep) -> str:
        """Delays and slews from a pin, equal for both edges."""
        text = f'      timing () {{\n        related_pin : "{begin}";\n'
        text += f"        timing_type : {kind};\n        timing_sense : {sense};\n"
        for edge in ("rise", "fall"):
            text += self.table(f"cell_{edge}", value) + self.table(f"{edge}_transition", steep)
        return text + "      }\n"

    def inside(self, begin: str, effort: float = 1.0) -> str:
        """Energies of an output changed by a pin, equal for both edges."""
        text = f'      internal_power () {{\n        related_pin : "{begin}";\n'
        for edge in ("rise", "fall"):  # not scaled by the unit of time
            text += self.table(f"{edge}_power", lambda *at: inside(*at, effort) / self.scale)
        return text + "      }\n"

    def clock(self, condition: str, rise: float, fall: float) -> str:
        """Energies of the clock in a state."""
        text = "      internal_power () {\n"
        text += f'        when : "{condition}";\n' * bool(condition)
        for edge, value in {"rise": rise, "fall": fall}.items():
            text += f'        {edge}_power (scalar) {{ values ("{value}"); }}\n'
        return text + "      }\n"

    def head(self, time: str) -> str:
        """Units, the corner, thresholds, the axes of tables."""
        text = "library (small) {\n  delay_model : table_lookup;\n"
        text += f'  capacitive_load_unit (1, pf);\n  time_unit : "{time}";\n'
        text += f"  nom_process : 1;\n  nom_voltage : {VOLTS};\n  nom_temperature : 125;\n"
        text += '  leakage_power_unit : "1nW";\n'
        for edge in ("rise", "fall"):
            text += "".join(f"  {side}put_threshold_pct_{edge} : 50;\n" for side in ("in", "out"))
            for end, percent in (("lower", 20), ("upper", 80)):
                text += f"  slew_{end}_threshold_pct_{edge} : {percent};\n"
        axes = [
            ("input_net_transition", [slew * self.scale for slew in SLEWS]),
            ("total_output_net_capacitance", LOADS),
        ]
        for kind, name in {"lu_table": "times", "power_lut": "energies"}.items():
            text += f"  {kind}_template ({name}) {{\n"
            for number, (variable, axis) in enumerate(axes[:: -1 if self.swapped else 1], 1):
                if kind == "power_lut":
                    variable = variable.replace("input_net_transition", "input_transition_time")
                index = ", ".join(f"{each:g}" for each in axis)
                text += f'    variable_{number} : {variable};\n    index_{number} ("{index}");\n'
            text += "  }\n"
        return text

    def gate(self, name: str, size: float) -> str:
        function, effort, area = GATES[name]
        pins = [pin for pin in "ABC" if pin in function]
        sense = {"XOR2": "non_unate", "BUF": "positive_unate"}.get(name, "negative_unate")
        text = f"  cell ({name}_{size:g}) {{\n    area : {area * size};\n"
        text += f"    cell_leakage_power : {LEAKAGE * area * size};\n"
        for pin in pins:
            capacitance = f"{INPUT * effort * size:g}"
            text += f"    pin ({pin}) {{ direction : input; capacitance : {capacitance}; }}\n"
        text += f'    pin (Y) {{\n      direction : output;\n      function : "{function}";\n'
        for pin in pins:
            text += self.timing(
                pin, "combinational", sense, lambda slew, load: delay(slew, load, effort, size),
                lambda _, load: transition(load, size),
            )  # fmt: skip
            text += self.inside(pin, effort)
        return text + "    }\n  }\n"

    def flip_flop(self) -> str:
        text = f"  cell (DFF_1) {{\n    area : {AREA_FF};\n"
        text += f"    cell_leakage_power : {LEAKAGE * AREA_FF};\n"
        text += '    ff (IQ, IQN) { clocked_on : "CK"; next_state : "D"; }\n'
        text += "    pin (CK) {\n      direction : input;\n      clock : true;\n"
        text += f"      capacitance : {CLOCK};\n" + self.clock("", 8.0, 8.0)
        for condition in ("D*Q", "!D !Q"):
            text += self.clock(condition, RISE, FALL)
        text += self.clock("D*!Q", 9.0, 9.0) + "    }\n"
        text += f"    pin (D) {{\n      direction : input;\n      capacitance : {DATA};\n"
        text += '      timing () {\n        related_pin : "CK";\n'
        text += "        timing_type : setup_rising;\n"
        for edge in ("rise", "fall"):
            text += f'        {edge}_constraint (scalar) {{ values ("{SETUP * self.scale:g}"); }}\n'
        text += "      }\n    }\n"
        text += '    pin (Q) {\n      direction : output;\n      function : "IQ";\n'
        text += self.timing(
            "CK", "rising_edge", "non_unate", lambda slew, load: delay(slew, load, first=LAUNCH),
            lambda _, load: transition(load),
        )  # fmt: skip
        return text + self.inside("CK") + "    }\n  }\n"


def small_library(time: str = "1ns", swapped: bool = False, leave_out: tuple[str, ...] = ()) -> str:
    """Text of the library.

    time: its unit, 1ns or 1ps
    swapped: whether its tables are by load and slew
    leave_out: prefixes of the names of cells to leave out
    """
    writer = Writer({"1ns": 1.0, "1ps": 1000.0}[time], swapped)
    cells = [writer.gate(name, size) for name in GATES for size in SIZES]
    text = "".join([writer.head(time), *cells, writer.flip_flop(), "}\n"])
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
