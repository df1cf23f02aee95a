"""Cases of a stage's cocotb testbench, frame by frame, and their run in a simulator."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from amaranth.lib import wiring

from splatcore.sim.rtl.cocotb_runner import run_testbench
from tb.helpers.runs import Rows

KINDS = ("empty", "full", "tie", "saturated")
"""Cases that each stage has: nothing to do; as much as fits, or more; numbers that are equal, or at
the bound that they are compared with; numbers at the ends of their formats."""


@dataclass(frozen=True, eq=False)
class Feed:
    """What goes in to a stage in a frame, and what must come out.

    inputs, expected: rows by stream. constants: values of its other inputs. care: of an out stream
    whose rows do not matter in all bits, those that do, as rows of ones. first: in streams that are
    through before the others begin.
    """

    inputs: Rows
    expected: Rows
    constants: Mapping[str, int] = field(default_factory=dict)
    care: Rows = field(default_factory=dict)
    first: Sequence[str] = ()

    def numbers(self) -> dict:
        """The same for JSON, with payloads as integers."""
        return {
            "inputs": _numbers(self.inputs),
            "expected": _numbers(self.expected),
            "constants": {name: int(value) for name, value in self.constants.items()},
            "care": _numbers(self.care),
            "first": list(self.first),
        }


def _numbers(rows: Rows) -> dict[str, list[int]]:
    return {
        name: [int.from_bytes(row.tobytes(), "little") for row in np.ascontiguousarray(part)]
        for name, part in rows.items()
    }


def run_cases(
    stage: str,
    component: wiring.Component,
    cases: Mapping[str, Feed | dict],
    folder: Path,
    simulator: str = "verilator",
    few: bool = False,
) -> None:
    """Run all cases in a simulator, and print a line for each run about what was compared.

    few: both sides of all streams are in bursts, and there is one reset, for a slow simulator.

    cases: feeds, or what the testbench of stages on memory takes.
    """
    streams = {name: case.numbers() for name, case in cases.items() if isinstance(case, Feed)}
    (folder / "cases.json").write_text(json.dumps(streams or cases))
    told = folder / "told"
    told.touch()
    module = f"tb.testbenches.{'stage' if streams else 'memory'}"
    try:
        run_testbench(component, module, simulator=simulator, folder=str(folder), few=few)
    finally:
        for line in told.read_text().splitlines():
            print(f"{stage} under {simulator}: {line}")
