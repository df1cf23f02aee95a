"""The rules of the house: who imports whom, how long files and functions are."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

ROOMS = ("spec", "model", "golden", "hdl", "tb", "sim")

MAY_IMPORT = {
    "spec": {"spec"},
    "model": {"model", "spec"},
    "golden": {"golden", "spec"},
    "hdl": {"hdl", "spec"},
    "tb": set(ROOMS),
    "sim": set(ROOMS) - {"tb"},
}

SPEC_MAY_USE = {"numpy"}
"""What `spec` imports besides itself and the standard library."""

FILE_LINES = 320
FUNCTION_LINES = 60
FILE_BYTES = 1_000_000


def sources(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


def imported(tree: ast.AST) -> set[str]:
    """First words of all modules that a syntax tree imports, at any depth."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("room", ROOMS)
def test_imports(room):
    for path in sources(room):
        wrong = imported(ast.parse(path.read_text())) & set(ROOMS) - MAY_IMPORT[room]
        assert not wrong, f"{path.relative_to(ROOT)} imports {wrong}"


def test_spec_needs_only_numpy():
    for path in sources("spec"):
        used = imported(ast.parse(path.read_text())) - set(sys.stdlib_module_names) - {"spec"}
        assert used <= SPEC_MAY_USE, f"{path.relative_to(ROOT)} imports {used - SPEC_MAY_USE}"


def test_the_rule_sees_a_breach():
    tree = ast.parse("def f():\n    from golden.reference import render\n    import sim.output")
    assert imported(tree) & set(ROOMS) - MAY_IMPORT["model"] == {"golden", "sim"}


def test_short_files_and_functions():
    for room in ROOMS:
        for path in sources(room):
            text = path.read_text()
            assert len(text.splitlines()) <= FILE_LINES, path
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.FunctionDef):
                    length = node.end_lineno - node.lineno + 1
                    assert length <= FUNCTION_LINES, f"{path}: {node.name} has {length} lines"


def test_no_large_files():
    files = [path for path in ROOT.iterdir() if path.is_file()]
    for folder in (*ROOMS, "docs"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc"]
    assert len(files) > 50
    for path in files:
        assert path.stat().st_size <= FILE_BYTES, path
