"""Cases of a stage's cocotb testbench, one per frame, and their run in a simulator."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from amaranth.lib import wiring

from splatcore.sim.rtl.cocotb_runner import run_testbench
from tb.helpers.runs import Rows

KINDS = ("empty", "full", "tie", "saturated")
"""Cases of each stage: no input; as much as fits, or more; equal numbers, or numbers at the bound
that they are compared with; numbers at the ends of their formats."""


@dataclass(frozen=True, eq=False)
class Feed:
    """Inputs and expected outputs of a stage for one frame.

    inputs, expected: rows by stream
    constants: values of its other inputs
    care: for output streams with bits that do not matter, rows of ones where bits matter
    first: input streams that are sent before the others begin
    """

    inputs: Rows
    expected: Rows
    constants: Mapping[str, int] = field(default_factory=dict)
    care: Rows = field(default_factory=dict)
    first: Sequence[str] = ()

    def numbers(self) -> dict:
        """Convert to JSON values, with payloads as integers."""
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
    """Run all cases in a simulator, and print one line per run.

    cases: feeds, or the cases for the testbench of stages on memory
    few: one stall pattern and one reset only, for a slow simulator
    """
    streams = {name: case.numbers() for name, case in cases.items() if isinstance(case, Feed)}
    (folder / "cases.json").write_text(json.dumps(streams or cases))
    summary = folder / "summary"
    summary.touch()
    module = f"tb.testbenches.{'stage' if streams else 'memory'}"
    try:
        run_testbench(component, module, simulator=simulator, folder=str(folder), few=few)
    finally:
        for line in summary.read_text().splitlines():
            print(f"{stage} under {simulator}: {line}")
