"""A plugin of pytest that ends a run at its first failure: exit status 1 where a test has caught a
fault, 3 where hardware with the fault cannot even be built.

    python -m pytest -p tb.planted.verdict TEST …

The current folder must hold the package `splatcore` with the fault in it.
"""

from pathlib import Path

import pytest

import splatcore.hdl
from splatcore.sim.rtl import streams

CAUGHT, NOT_BUILT = 1, 3

CYCLES_MAX = 5_000_000
"""Cycles of a run at most: a fault may make hardware that gives items for ever."""


def pytest_configure() -> None:
    [folder] = splatcore.hdl.__path__
    assert Path(folder).is_relative_to(Path.cwd()), f"{folder} is tested"
    streams.CYCLES_MAX = CYCLES_MAX


def pytest_exception_interact(call: pytest.CallInfo) -> None:
    why = call.excinfo.value
    caught = isinstance(why, AssertionError | pytest.fail.Exception)
    pytest.exit(f"{type(why).__name__}: {why}", CAUGHT if caught else NOT_BUILT)
