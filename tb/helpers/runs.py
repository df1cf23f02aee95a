"""Runs of compiled components: cases with golden outputs, counters, planted faults."""

import shutil
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from amaranth.lib import wiring

from splatcore.sim.rtl.streams import Result, Simulation
from splatcore.spec.counters import COUNTER_BITS
from tb.planted.fault import each, plant

Rows = dict[str, np.ndarray]

needs_icarus = pytest.mark.skipif(
    not shutil.which("iverilog"), reason="needs Icarus: apt-get install iverilog"
)


def marked(
    names: Iterable, slow: Collection, mark: pytest.MarkDecorator = pytest.mark.verify
) -> list:
    """Names as parameters of a test; the slow ones have the mark, outside `make test`."""
    return [pytest.param(name, marks=[mark] * (name in slow)) for name in names]


@cache
def compiled(make: Callable, *arguments: Hashable, samples: tuple[str, ...] = ()) -> Simulation:
    """Make a component from these arguments and compile it, once per process."""
    return Simulation(make(*arguments), samples)


@dataclass(frozen=True, eq=False)
class Case:
    """Inputs of a component for one run, and its expected outputs.

    inputs, expected: rows by stream
    constants: values of its other inputs
    care: for output streams with bits that do not matter, rows of ones where bits matter
    first: input streams that are sent before the others begin
    """

    inputs: Rows
    expected: Rows
    constants: Mapping = field(default_factory=dict)
    care: Rows = field(default_factory=dict)
    first: Sequence[str] = ()

    def check(self, simulation: Simulation, label: str = "", **options) -> Result:
        """Run a component and check that its output rows are exactly the expected ones.

        label: prefix of a stream's name in messages
        options: of `Simulation.run`; `constants` are added to the case's own
        """
        constants = self.constants | options.pop("constants", {})
        counts = {port: len(rows) for port, rows in self.expected.items()}
        result = simulation.run(
            self.inputs, expected=counts, constants=constants, first=self.first, **options
        )
        assert result.finished, f"{label}{result.stopped}"
        for port, rows in self.expected.items():
            found = result.outputs[port]
            assert len(found) == len(rows), f"{label}{port}: {len(found)} rows, not {len(rows)}"
            different = (found ^ rows) & self.care.get(port, 255)
            wrong = np.flatnonzero(different.any(axis=1))
            assert not len(wrong), f"{label}{port}: {len(wrong)} differ, first {wrong[0]}"
        return result

    def numbers(self) -> dict:
        """Convert to JSON values, with payloads as integers."""
        rows = {name: _numbers(getattr(self, name)) for name in ("inputs", "expected", "care")}
        constants = {name: int(value) for name, value in self.constants.items()}
        return rows | {"constants": constants, "first": list(self.first)}


def _numbers(rows: Rows) -> dict[str, list[int]]:
    return {
        name: [int.from_bytes(row.tobytes(), "little") for row in np.ascontiguousarray(part)]
        for name, part in rows.items()
    }


def counters(names: Iterable[str], bits: int) -> dict[str, int]:
    """Split the value of a port into counters by name."""
    mask = (1 << COUNTER_BITS) - 1
    return {name: bits >> k * COUNTER_BITS & mask for k, name in enumerate(names)}


def faults_are_found(
    make: Callable[[], wiring.Component],
    faults: Mapping[str, tuple],
    check: Callable[[Simulation], None],
) -> Callable:
    """Make a test function: the runs must pass without a fault and fail with each fault.

    faults: by name, as in `tb.planted.fault.planted_in`
    check: runs a simulation; an assertion fails if it detects a fault
    """

    @pytest.mark.slow
    @pytest.mark.parametrize("fault", [None, *each(faults)])
    def test(fault, monkeypatch):
        if fault is None:
            check(Simulation(make()))
        else:
            plant(monkeypatch, *faults[fault])
            with pytest.raises(AssertionError):
                check(Simulation(make()))

    return test
