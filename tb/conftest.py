"""Order of the test files: the slowest first, so that all processes finish together; long tests
that belong to `make verify`; the file of the small cell library, for `tb/eda` and `tb/study`."""

import json
from collections import defaultdict
from pathlib import Path

import pytest

SECONDS = Path(__file__).parent / "seconds.json"
"""Seconds per test file, and of each test of at least `LONG`, of a whole `make test`."""

LONG = 0.3  # seconds

VERIFY = Path(__file__).parent / "verify.txt"
"""Tests that get the mark `verify`, one per line: 6 s of CPU or more, and not the only ones of a
part or of a command."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record-seconds", action="store_true", help=f"write {SECONDS.name}")
    parser.addoption("--long", action="store_true", help=f"no mark for tests in {VERIFY.name}")
    parser.addoption("--quick", action="store_true", help=f"no test that takes {LONG} s or more")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("record_seconds") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Recorder())


class Recorder:
    """Adds up the seconds of each test and file, and writes them at the end."""

    def __init__(self):
        self.seconds = defaultdict(float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        self.seconds[report.nodeid.split("::")[0]] += report.duration

    def pytest_sessionfinish(self) -> None:
        slow = {test: round(spent, 1) for test, spent in self.seconds.items() if spent >= LONG}
        ordered = dict(sorted(slow.items(), key=lambda item: -item[1]))
        SECONDS.write_text(json.dumps(ordered, indent=1) + "\n")


@pytest.hookimpl(tryfirst=True)  # before -m selects by mark
def pytest_collection_modifyitems(config: pytest.Config, items: list) -> None:
    """Mark the tests of `VERIFY`. Put tests of slow files first; xdist needs
    `--no-loadscope-reorder` for it. With --quick, leave out long tests."""
    long = set() if config.getoption("long") else set(VERIFY.read_text().splitlines())
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.verify)
    seconds = json.loads(SECONDS.read_text())
    items.sort(key=lambda item: -seconds.get(item.nodeid.split("::")[0], 0))
    if config.getoption("quick"):
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in seconds])
        items[:] = [item for item in items if item.nodeid not in seconds]


@pytest.fixture(scope="session")
def liberty_path(tmp_path_factory):
    from tb.helpers.liberty import small_library

    file = tmp_path_factory.mktemp("liberty") / "small.lib"
    file.write_text(small_library())
    return file
