"""The rules of the house: which package imports which, and the length of files and functions."""

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from setuptools import find_packages

from tb.helpers import habits
from tb.helpers.command import ROOT

ROOMS = ("spec", "model", "golden", "hdl", "sim", "eda", "study", "app", "tb")
"""In their order: the first four import only `spec`, each other one also those before it."""

MAY_IMPORT = {room: {"spec", room} for room in ROOMS[:4]} | {
    room: set(ROOMS[: ROOMS.index(room) + 1]) for room in ROOMS[4:]
}

SPEC_MAY_USE = {"numpy", "platformdirs"}  # libraries that `spec` may import

SOURCE = ROOT / "src" / "splatcore"  # the package: links to the rooms

RIDDLES = {"told", "tell", "tells", "how", "what", "who", "said", "thing"}
"""Names that say nothing about their content."""

ALLOWED = {
    "study/bench/campaign.py": {"what"},  # a JSON key
    "app/cli/path.py": {"what"},
    "study/compression/bench.py": {"what"},
    "app/python/files.py": {"thing"},  # the Python interface
    "study/report/other.py": {"tell"},  # a file's position
}

FILE_LINES = 320
FUNCTION_LINES = 60
FILE_BYTES = 1_000_000

PACKAGES = sorted(path.parent for room in ROOMS[:-1] for path in (ROOT / room).rglob("__init__.py"))
"""Folders of all installed packages, in all rooms except `tb`."""


def sources(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def modules(syntax: ast.AST) -> Iterator[str]:
    """Yield the dotted names that a syntax tree imports, at any depth."""
    for node in ast.walk(syntax):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def within(name: str) -> str | None:
    """Package of this repository that holds an imported name, as `hdl.lib`; None: not ours."""
    parts = name.removeprefix("splatcore.").split(".")
    if parts[0] not in ROOMS or (parts[0] != "tb") != name.startswith("splatcore."):
        return None
    while not (ROOT.joinpath(*parts) / "__init__.py").is_file():
        parts.pop()
    return ".".join(parts)


def imported(syntax: ast.AST) -> set[str]:
    """Return the packages of this repository that a syntax tree imports from."""
    return {package for name in modules(syntax) if (package := within(name))}


def breaches(room: str, syntax: ast.AST) -> set[str]:
    return {package.split(".")[0] for package in imported(syntax)} - MAY_IMPORT[room]


def name_of(folder: Path) -> str:
    return ".".join(folder.relative_to(ROOT).parts)


def declared(folder: Path) -> set[str]:
    """Return the packages that a package's docstring allows it to import."""
    _, _, names = ast.get_docstring(tree(folder / "__init__.py")).partition("May import:")
    assert names, f"{folder}: `May import:` is missing"
    return {word.strip() for word in names.removesuffix(".").split(",")} - {"nothing"}


@pytest.mark.parametrize("room", ROOMS)
def test_rooms(room):
    for path in sources(room):
        wrong = breaches(room, tree(path))
        assert not wrong, f"{path.relative_to(ROOT)} imports {wrong}"


def test_imports_say_splatcore():
    """`import spec` works only in the repository's folder, and would load the room twice."""
    for path in (path for room in ROOMS for path in sources(room)):
        bare = {name.split(".")[0] for name in modules(tree(path))} & set(ROOMS) - {"tb"}
        assert not bare, f"{path.relative_to(ROOT)} imports {bare}"


@pytest.mark.parametrize("folder", PACKAGES, ids=name_of)
def test_packages_import_what_they_say(folder):
    """Packages import exactly what they declare; another room is declared as a whole."""
    own, used = name_of(folder), set()
    for path in folder.glob("*.py"):
        used |= imported(tree(path)) - {own}
    room = own.split(".")[0]
    used = {name if name.split(".")[0] == room else name.split(".")[0] for name in used}
    if own != "spec":
        assert used == declared(folder)
    else:
        assert not used


def test_packages_have_an_order():
    """There is no import cycle between packages, direct or indirect."""
    below = {name_of(folder): set() for folder in PACKAGES}
    for folder in PACKAGES:
        for path in folder.glob("*.py"):
            below[name_of(folder)] |= imported(tree(path)) - {name_of(folder)}
    while below:
        lowest = [name for name, used in below.items() if not used & below.keys()]
        assert lowest, f"a circle within {sorted(below)}"
        for name in lowest:
            del below[name]


def test_a_breach_is_found():
    syntax = ast.parse(
        "def f():\n    from splatcore.golden.reference import render\n"
        "    import splatcore.sim.common.output\nimport spec.config\nimport tb.helpers"
    )
    assert imported(syntax) == {"golden", "sim.common", "tb.helpers"}
    assert breaches("model", syntax) == {"golden", "sim", "tb"}


def test_no_test_imports_another():
    for path in sources("tb"):
        wrong = [name for name in modules(tree(path)) if ".test_" in name]
        assert not wrong, f"{path.relative_to(ROOT)} imports {wrong}"


def test_all_packages_are_installed():
    """`src/splatcore/` has a link to each room, through which setuptools finds every package."""
    links = {path.name: path.resolve() for path in SOURCE.iterdir() if path.is_symlink()}
    assert links == {room: ROOT / room for room in ROOMS[:-1]} | {"results": ROOT / "docs/results"}
    found = find_packages(str(ROOT / "src"))
    assert sorted(found) == sorted(
        ["splatcore", *(f"splatcore.{name_of(folder)}" for folder in PACKAGES)]
    )


def test_spec_needs_little():
    for path in sources("spec"):
        used = {name.split(".")[0] for name in modules(tree(path))}
        used -= {*sys.stdlib_module_names, "splatcore"}
        assert used <= SPEC_MAY_USE, f"{path.relative_to(ROOT)} imports {used - SPEC_MAY_USE}"


def test_short_files_and_functions():
    for room in ROOMS:
        for path in sources(room):
            assert len(path.read_text().splitlines()) <= FILE_LINES, path
            for node in ast.walk(tree(path)):
                if isinstance(node, ast.FunctionDef):
                    length = node.end_lineno - node.lineno + 1
                    assert length <= FUNCTION_LINES, f"{path}: {node.name} has {length} lines"


def test_long_tests_exist():
    """`tb/long.txt` names tests that exist, in alphabetical order."""
    names = (ROOT / "tb/long.txt").read_text().splitlines()
    assert names == sorted(set(names))
    for name in names:
        path, function = name.split("[")[0].split("::")
        assert re.search(rf"^(def )?{function}\b", (ROOT / path).read_text(), re.M), name


def test_no_large_files():
    files = [path for path in ROOT.iterdir() if path.is_file()]
    for folder in (*ROOMS, "docs", "src"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc"]
    assert len(files) > 50
    for path in files:
        assert path.stat().st_size <= FILE_BYTES, path


def riddles(syntax: ast.AST) -> set[str]:
    """Return the names of `RIDDLES` that a syntax tree uses or defines."""
    names = {node.id for node in ast.walk(syntax) if isinstance(node, ast.Name)}
    names |= {node.arg for node in ast.walk(syntax) if isinstance(node, ast.arg)}
    names |= {node.attr for node in ast.walk(syntax) if isinstance(node, ast.Attribute)}
    defined = (ast.FunctionDef, ast.ClassDef)
    names |= {node.name for node in ast.walk(syntax) if isinstance(node, defined)}
    return {name for name in names if name.lower().strip("_") in RIDDLES}


@pytest.mark.parametrize("room", habits.ROOMS)
def test_plain_words(room):
    """No prose of the repository has a habit of `habits.REFUSED`."""
    hits = [
        f"{path.relative_to(ROOT)}:{line}: {habit}: {around}"
        for path in habits.files(room)
        if path.name not in ("habits.py", "test_house.py")  # the patterns, and samples of hits
        for habit, line, around in habits.found(path, habits.REFUSED)
    ]
    assert not hits, "\n".join(hits)


@pytest.mark.parametrize("room", ROOMS)
def test_plain_names(room):
    for path in sources(room):
        name = str(path.relative_to(ROOT))
        assert not riddles(tree(path)) - ALLOWED.get(name, set()), name


def test_refused_words_are_seen(tmp_path):
    path = tmp_path / "words.py"
    path.write_text(
        '"""What a frame needs."""\n\n\ndef f(tell, who_else):\n'
        '    # the user is told\n    text = "packed anew, 3 bytes a Gaussian"\n'
        '    return f"one\'s own {text} scene"\n'
    )
    assert {habit for habit, _, _ in habits.found(path, habits.REFUSED)} == set(habits.REFUSED)
    assert [line for _, line, _ in habits.found(path, habits.REFUSED)] == [1, 6, 6, 7, 5]
    assert riddles(ast.parse(path.read_text())) == {"tell"}
    page = tmp_path / "page.md"
    page.write_text("```\nbe told\n```\nPacked anew.\n")
    assert [line for _, line, _ in habits.found(page, habits.REFUSED)] == [4]
