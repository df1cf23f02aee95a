"""A pytest plugin that ends a run at its first failure: exit status 1 if a test has caught a fault,
3 if hardware with the fault cannot be built.

    python -m pytest -p tb.planted.verdict TEST …

The current folder must hold the package `splatcore` with the fault in it.
"""

from pathlib import Path

import pytest

import splatcore.hdl
from splatcore.sim.rtl import streams

CAUGHT, NOT_BUILT = 1, 3

CYCLES_MAX = 5_000_000
"""Maximum cycles of a run: hardware with a fault may output items forever."""


def pytest_configure() -> None:
    [folder] = splatcore.hdl.__path__
    assert Path(folder).is_relative_to(Path.cwd()), f"tests use {folder}, not the current folder"
    streams.CYCLES_MAX = CYCLES_MAX


def pytest_exception_interact(call: pytest.CallInfo) -> None:
    why = call.excinfo.value
    caught = isinstance(why, AssertionError | pytest.fail.Exception)
    pytest.exit(f"{type(why).__name__}: {why}", CAUGHT if caught else NOT_BUILT)
