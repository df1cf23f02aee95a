"""Keys of results: editing a file changes the keys that depend on it, and no others."""

import shutil

import pytest

from splatcore.sim.common.sources import ROOT, closure, code_key, files_key
from splatcore.sim.frame import choose
from splatcore.study.bench import campaigns, sweep

CAMPAIGNS = {
    "sweep": "study/bench/sweep.py", "gates and memories": "study/bench/campaigns.py",
}  # fmt: skip
MEASURES = CAMPAIGNS | {"packing": "sim/frame/choose.py"}
"""Measurement → the file of its task function; and the file of the function that packs."""

DECIDES = {
    "spec/number.py": MEASURES,
    "spec/__init__.py": MEASURES,
    "model/pack/codebook.py": MEASURES,
    "model/pack/steps.py": MEASURES,
    "sim/frame/choose.py": MEASURES,
    "golden/raster.py": CAMPAIGNS,
    "sim/cycles/raster.py": CAMPAIGNS,
    "sim/frame/shot.py": CAMPAIGNS,
    "sim/frame/engines.py": ["gates and memories"],
    "hdl/raster/blend.py": CAMPAIGNS,
    "eda/gates/synth.py": ["gates and memories"],
    "sim/machine/memory.hpp": CAMPAIGNS,
    "study/bench/campaigns.py": ["gates and memories"],
    "app/cli/scene.py": [],
    "study/report/page.py": [],
}
"""Edited file → results whose key must change."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package's rooms."""
    root = tmp_path_factory.mktemp("splatcore")
    for room in ("spec", "model", "golden", "hdl", "sim", "eda", "study", "app"):
        shutil.copytree(ROOT / room, root / room, ignore=shutil.ignore_patterns("__pycache__"))
    for init in ROOT.glob("__init__.py"):
        shutil.copy(init, root)
    return root


def keys(root) -> dict[str, str]:
    return {name: files_key(root / file, root) for name, file in MEASURES.items()}


@pytest.fixture(scope="module")
def before(copy):
    return keys(copy)


@pytest.mark.parametrize("file", DECIDES)
def test_a_changed_file_changes_the_keys_that_depend_on_it(copy, before, file):
    path = copy / file
    text = path.read_text()
    path.write_text(f"{text}# changed\n")
    changed = {name for name, key in keys(copy).items() if key != before[name]}
    path.write_text(text)
    assert changed == set(DECIDES[file])
    assert keys(copy) == before


def test_keys_are_those_of_the_functions_modules(before):
    functions = sweep.measure, campaigns.machine_size, choose.packed
    assert [code_key(function) for function in functions] == list(before.values())


def test_imports_are_followed(tmp_path):
    """Imports within functions, indirect and circular imports, and files of other languages."""

    def write(name, text=""):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    start = write("a/start.py", "from splatcore.b import one\nimport numpy, splatcore.nowhere\n")
    files = {start, write("a/__init__.py"), write("b/__init__.py")}
    files.add(write("b/one.py", "def f():\n    from splatcore.b.two import X\n"))
    files.add(write("b/two.py", "import splatcore.a.start\n"))
    files.add(write("b/table.hpp"))
    new = write("b/three.py", "import splatcore.c.four")
    four, other = write("c/four.py"), write("c/other.cpp")
    assert closure(start, tmp_path) == files
    write("b/two.py", "import splatcore.a.start\nimport splatcore.b.three\n")
    assert closure(start, tmp_path) == files | {new, four, other}
