"""The source texts that planted faults replace exist; most of these faults run only in
`make verify`."""

from importlib import import_module

import pytest

from tb.helpers.command import ROOT

HERE = ROOT / "tb"
FILES = [path for path in sorted((HERE / "hdl").glob("*.py")) if "each(F" in path.read_text()]


def test_files_are_found():
    assert len(FILES) >= 12


def words(text: str) -> str:
    """A text without white space."""
    return "".join(text.split())


PARTS = [*(ROOT / "hdl").rglob("*.py"), *(HERE / "formal").glob("*.py")]
TEXTS = [words(path.read_text()) for path in PARTS]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_fault_has_its_place(path):
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    for fault, (*_, old, _new) in module.FAULTS.items():
        assert any(words(old) in text for text in TEXTS), fault
