"""Fixtures of the small cell library: its file, and the library read from it."""

import pytest

from splatcore.eda.cells.liberty_file import read_liberty
from tb.helpers.liberty import small_library


@pytest.fixture(scope="module")
def liberty_path(tmp_path_factory):
    file = tmp_path_factory.mktemp("liberty") / "small.lib"
    file.write_text(small_library())
    return file


@pytest.fixture(scope="module")
def library(liberty_path):
    return read_liberty(liberty_path)
