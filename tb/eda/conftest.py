"""Fixtures: the small cell library; register files of all machines; the Verilog of TINY."""

from pathlib import Path

import pytest

from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.deliver.register_files import DRIVER, FILES, write_register_files
from splatcore.eda.deliver.verilog import write_top
from splatcore.sim.common.sources import code_key
from splatcore.spec.cache import kept_folder
from splatcore.spec.config import TINY
from tb.helpers.command import run
from tb.helpers.configs import MAPS


@pytest.fixture(scope="session")
def library(liberty_path):
    return read_liberty(liberty_path)


@pytest.fixture(scope="session")
def register_files(tmp_path_factory):
    """Folder of the register files by machine."""
    folders = {}
    for config in MAPS:
        folders[config] = tmp_path_factory.mktemp(config.name)
        paths = write_register_files(config, folders[config])
        assert [path.name for path in paths] == [*FILES, *DRIVER]
    return folders


@pytest.fixture(params=MAPS, ids=lambda config: config.name)
def files(request, register_files):
    """A machine, and the folder with its register files."""
    return request.param, register_files[request.param]


@pytest.fixture
def tiny_files(register_files):
    return register_files[TINY]


def tiny_verilog(*words: str) -> Path:
    """The files that `splatcore verilog --preset TINY` writes with these arguments; written again
    only after a change of code."""

    def written(folder: Path):
        assert run("verilog", "--preset", "TINY", *words, "-o", folder / "rtl") == 0

    made_from = [code_key(write_top), code_key(run), TINY, *words]
    return kept_folder("tiny", made_from, written) / "rtl"


@pytest.fixture(scope="session")
def tiny_rtl() -> Path:
    """The files of the machine TINY."""
    return tiny_verilog()


@pytest.fixture(scope="session")
def tiny_stages() -> Path:
    """The files of TINY's stages."""
    return tiny_verilog("--part", "stages")
