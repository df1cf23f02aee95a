"""PE arrays under stalls against the golden programs, bit for bit, on items of the garden."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from splatcore.golden.points import Points, project_points
from splatcore.golden.program import Values, run
from splatcore.hdl.points.array import Array
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT
from splatcore.spec.microprogram import program, projection
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from tb.helpers.parts import SideBySide
from tb.helpers.runs import Case

ITEMS = 300

PROGRAMS = {
    "cull": (program("cull"), "culled"),
    "place": (program("place"), "placed"),
    "project_sh": (projection(DEFAULT), "projected"),
}

pytestmark = pytest.mark.slow


@cache
def garden() -> Points:
    model, _ = pack(replace(generate("garden", 2000), antialiased=True))
    return project_points(DEFAULT, model, generated_camera("garden"))


def packed(names: tuple[str, ...], values: Values, count: int) -> np.ndarray:
    """Return rows of codes in the format of an array's ports."""
    format = DEFAULT.arithmetic
    record = Record("row", {name: Bits(format.width) for name in names})
    codes = {}
    for name in names:
        code = format.encode(values[name])
        codes[name] = code[:count] if code.ndim else np.broadcast_to(code, count)
    return record.pack(codes)


def rows(name: str, count: int, **changed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return fields, outputs and constants of a program's first items."""
    steps, part = PROGRAMS[name]
    values = garden().frame.constants | getattr(garden(), part) | changed
    if "stored_attenuation" in steps.fields:
        values["stored_attenuation"] = values["attenuation"]
    values |= run(DEFAULT, steps, values)  # stage 0's own depths are finer
    fields, outputs = (packed(names, values, count) for names in (steps.fields, steps.outputs))
    return fields, outputs, packed(steps.constants, values, 1)


@cache
def arrays() -> Simulation:
    return Simulation(
        SideBySide({name: Array(DEFAULT, steps) for name, (steps, _) in PROGRAMS.items()})
    )


def check(given: dict[str, tuple], stall: float = 0, seed: int = 0):
    """Check that all items come out in order, bit for bit."""
    expected = {f"{name}__o": outputs for name, (_, outputs, _) in given.items()}
    inputs = {f"{name}__i": fields for name, (fields, _, _) in given.items()}
    constants = {f"{name}__constants": row for name, (_, _, row) in given.items()}
    Case(inputs, expected, constants).check(arrays(), stall=stall, seed=seed)


def test_under_stalls():
    given = {name: rows(name, ITEMS) for name in PROGRAMS}
    for seed, stall in enumerate((0, 0.2, 0.5, 0.8)):
        check(given, stall, seed)


def test_a_wrong_bit_is_named():
    given = {name: rows(name, ITEMS) for name in PROGRAMS}
    given["cull"][1][ITEMS // 2, 0] ^= 1
    with pytest.raises(AssertionError, match="cull__o"):
        check(given)
