"""Order of the test files: the slowest first, so that all processes finish together; long tests
that belong to `make verify`; the file of the small cell library, for `tb/eda` and `tb/study`."""

import json
from collections import defaultdict
from pathlib import Path

import pytest

SECONDS = Path(__file__).parent / "seconds.json"
"""Seconds per test file, and per test, of those of at least `SLOW`, of a whole `make test`."""

SLOW = 0.5  # seconds

QUICK = 1  # second
ALWAYS = "tb/test_house.py"
"""With --quick: files that take less than `QUICK` in all, so that no fixture is long either, and
the rules of the repository."""

LONG = Path(__file__).parent / "long.txt"
"""Tests that get the mark `long`, one per line: 6 s of CPU or more, and not the only ones of a part
or of a command. `make verify` and the judges of planted faults run them."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record-seconds", action="store_true", help=f"write {SECONDS.name}")
    parser.addoption("--quick", action="store_true", help=f"only files of less than {QUICK} s")


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
        slow = {test: round(spent, 1) for test, spent in self.seconds.items() if spent >= SLOW}
        ordered = dict(sorted(slow.items(), key=lambda item: -item[1]))
        SECONDS.write_text(json.dumps(ordered, indent=1) + "\n")


@pytest.hookimpl(tryfirst=True)  # before -m selects by mark
def pytest_collection_modifyitems(config: pytest.Config, items: list) -> None:
    """Mark the tests of `LONG` as long. Put tests of slow files first; xdist needs
    `--no-loadscope-reorder` for it. With --quick, leave out long files."""
    long = set(LONG.read_text().splitlines())
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.long)
    seconds = json.loads(SECONDS.read_text())

    def spent(item: pytest.Item) -> float:
        return seconds.get(item.nodeid.split("::")[0], 0)

    items.sort(key=lambda item: -spent(item))
    if config.getoption("quick"):
        quick = [item.nodeid.startswith(ALWAYS) or spent(item) < QUICK for item in items]
        config.hook.pytest_deselected(items=[i for i, q in zip(items, quick, strict=True) if not q])
        items[:] = [item for item, kept in zip(items, quick, strict=True) if kept]


@pytest.fixture(scope="session")
def liberty_path(tmp_path_factory):
    from tb.helpers.liberty import small_library

    file = tmp_path_factory.mktemp("liberty") / "small.lib"
    file.write_text(small_library())
    return file
