"""What tests of commands share."""

import pytest

from tb.helpers.command import write_scene


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a small scene and two cameras."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    return tmp_path
