"""Fixtures of the tests of compression: a garden, its own pictures, and a folder for steps."""

import pytest

from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.model.generate.generate import generate
from splatcore.spec.scene import Scene
from tb.helpers.compression_scene import SIZE, garden_with_harmonics

PLAIN = ("test_checkpoint.py", "test_prune.py")  # files of tests that run without PyTorch


class WithTorch(pytest.Module):
    """A test file that needs PyTorch: skipped if it is not installed."""

    def collect(self):
        pytest.importorskip("torch")
        self.add_marker("compress")
        return super().collect()


def pytest_pycollect_makemodule(module_path, parent):
    kind = pytest.Module if module_path.name in PLAIN else WithTorch
    return kind.from_parent(parent, path=module_path)


@pytest.fixture(scope="session")
def garden() -> Scene:
    return generate("garden", 700)


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The garden with harmonics up to degree 3."""
    return garden_with_harmonics()


@pytest.fixture(scope="session")
def targets(scene):
    """The scene's own pictures; they need PyTorch."""
    from splatcore.model.compress.teacher import teacher_targets

    return teacher_targets(scene, 8, SIZE, 0)


@pytest.fixture(scope="session")
def cameras(targets):
    return [target.camera for target in targets]


@pytest.fixture
def checkpoints(tmp_path) -> Checkpoints:
    return Checkpoints(tmp_path / "steps", "key")
