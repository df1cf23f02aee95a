"""Fixtures: a stand-in for compression; samples of all results, their report and kept tables."""

from pathlib import Path

import pytest

from tb.helpers.command import run
from tb.helpers.compression_stand_in import installed
from tb.helpers.report_samples import everything


@pytest.fixture
def fake(tmp_path, monkeypatch):
    return installed(tmp_path, monkeypatch)


@pytest.fixture(scope="session")
def samples(tmp_path_factory) -> Path:
    """A folder with samples of all results, their report, and their kept tables."""
    folder = tmp_path_factory.mktemp("samples")
    everything(folder / "results")
    words = ["-o", str(folder / "measured"), "--results", str(folder / "results")]
    assert run("report", *words, "--keep", str(folder / "kept")) == 0
    return folder
