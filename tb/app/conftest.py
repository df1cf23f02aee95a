"""Fixtures of the command-line tests."""

import pytest

from splatcore.study.bench import campaign
from tb.helpers.command import write_scene


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a small scene and two cameras."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path)
    return tmp_path


@pytest.fixture
def in_turn(monkeypatch):
    """Campaign tasks run in this process, the last one first; yields those that ran."""
    ran = []

    def serve(tasks):
        for task in reversed(tasks):
            ran.append(task)
            yield task, task.function(*task.arguments)

    monkeypatch.setattr(campaign, "in_processes", serve)
    return ran
